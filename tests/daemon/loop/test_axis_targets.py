"""What rounding to whole counts leaves of a step comes with the next ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.axis import Axis
from config.loader import load_robot
from daemon.loop.axis_targets import AxisTargets
from drivers.axis_scale import axis_scale, count_limits
from drivers.cia402.axis_channel import AxisChannel
from safety.gate import Gate, Measured
from safety.risk_source import NoModel
from tests import SOFT_ARM

AXIS: Axis = load_robot(SOFT_ARM).robot.axes[0]
SCALE = axis_scale(AXIS)
COUNT = 1.0 / SCALE.counts_per_unit
"""mm"""
STEP_NS = 25_000_000
MIDDLE = 0.5 * sum(AXIS.travel)


class Rig:
    """One axis that is where it is told to be, a real gate, and frames that come about in time."""

    def __init__(self, at: float = MIDDLE) -> None:
        channel = AxisChannel(AXIS, 0)
        self.targets = AxisTargets([channel])
        limits = count_limits(AXIS)
        self.gate = Gate([limits], [SCALE.counts_per_unit], [None], NoModel(), 0.05, 1.0)
        self.t_ns = 0
        self.start = round(at * SCALE.counts_per_unit)
        self.gate.settle([self.start])
        self.limits: tuple[str, ...] = ()
        self._told = False

    @property
    def counts(self) -> int:
        """From where it started."""
        return (self.targets.counts(self.t_ns)[0] if self._told else self.start) - self.start

    def ask(self, delta_counts: float, after_ns: int = STEP_NS) -> None:
        """A step, and the next frame so much later."""
        place = self.targets.in_units([self.start + self.counts])
        asked = self.targets.asked(place + delta_counts * COUNT)
        measured = Measured([self.start + self.counts], [None])
        decision = self.gate.decide(asked, measured, self.t_ns, STEP_NS)
        self.targets.keep_rest(asked, None if decision.refused else decision.step)
        assert decision.step is not None
        self.limits = decision.limits
        self.targets.take(decision.step)
        self._told = True
        self.t_ns += after_ns


@given(
    delta=st.floats(-3.0, 3.0),
    early_ns=st.integers(-300_000, 300_000),
)
def test_an_axis_goes_as_far_as_it_is_asked_to_however_small_the_steps(
    delta: float, early_ns: int
) -> None:
    rig = Rig()
    for _ in range(60):
        rig.ask(delta, STEP_NS - early_ns)
    assert rig.counts == pytest.approx(60 * delta, abs=1.5)


def test_steps_up_and_down_lose_alike() -> None:
    up, down = Rig(), Rig()
    for _ in range(40):
        up.ask(0.7)
        down.ask(-0.7)
    assert up.counts == -down.counts


def test_steps_that_hover_round_nothing_go_nowhere() -> None:
    rig, random = Rig(), np.random.default_rng(1)
    for _ in range(400):
        rig.ask(float(random.uniform(-0.4, 0.4)) - 0.1 * rig.counts)
    assert abs(rig.counts) <= 5


def test_what_is_left_asks_for_no_more_than_the_travel() -> None:
    highest = AXIS.travel[1] * SCALE.counts_per_unit
    rig = Rig(at=AXIS.travel[1] - 3.0 * COUNT)
    for _ in range(20):
        rig.ask(min(0.7, highest - rig.start - rig.counts))
    assert not any(limit.startswith("position") for limit in rig.limits)
    assert rig.counts == round(highest) - rig.start


def test_what_the_gate_takes_away_does_not_come_back() -> None:
    rig = Rig()
    rig.ask(1e6)
    far = rig.counts
    for _ in range(20):
        rig.ask(0.0)
    assert rig.counts - far <= far  # it brakes, and stands
    stands = rig.counts
    rig.ask(0.0)
    assert rig.counts == stands
