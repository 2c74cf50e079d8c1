"""A step keeps what axes may not do together, and the other axes do for the tip what is left."""

from collections.abc import Callable

import numpy as np
import pytest

from config.coupling.sums import AxesCondition, AxesLimit, AxesSum
from config.loader import load_robot
from daemon.control.avoidance import CoupledKeeping
from daemon.control.avoidance_kernels import keep_coupled
from daemon.robot.axes import AxisRanges
from daemon.robot.coupled_axes import CoupledAxes, count_coupling
from drivers.axis_scale import axis_scale, count_limits
from drivers.pose import Vector
from safety.gate import Decision, Gate, Measured
from safety.risk_source import NoModel
from tests import SHIPPED_ROBOTS

DT_S = 0.025
CLOSER = 4.0 * DT_S
ALONG_X = np.array([[1.0, 1.0, 1.0], [0.0, 0.3, -0.3], [0.0, 0.0, 0.1]])
"""Every axis moves the tip along x."""
TUBES = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
STEP_NS = 25_000_000


def axes(*limits: AxesLimit) -> AxisRanges:
    none = np.zeros(3)
    ten = none + 10.0
    names = ("a", "b", "c")
    return AxisRanges(names, -ten, ten, none + 5.0, 2.0 * ten, none, CoupledAxes(limits))


def of_sum(lowest: float, *only_while: AxesCondition) -> AxesLimit:
    """The first two axes together are no lower."""
    return AxesLimit("ab", "", AxesSum(np.array([1.0, 1.0, 0.0])), lowest, np.inf, only_while)


def near_zero(within: float) -> AxesCondition:
    """The third axis is."""
    return AxesCondition(AxesSum(np.array([0.0, 0.0, 1.0])), 0.0, within, None)


def kept(step: list[float], limit: AxesLimit, at: tuple[float, float, float]) -> Vector:
    return CoupledKeeping(axes(limit)).kept(np.array(step), np.array(at), ALONG_X, DT_S)


def test_a_step_that_stays_far_enough_from_a_limit_is_not_touched() -> None:
    step = np.array([-0.1, 0.0, 0.0])
    assert CoupledKeeping(axes(of_sum(-9.0))).kept(step, np.zeros(3), ALONG_X, DT_S) is step


def test_at_a_limit_the_other_axes_do_for_the_tip_what_is_left() -> None:
    found = kept([-0.1, 0.0, 0.0], of_sum(0.0), at=(0.0, 0.0, 0.0))
    assert found[0] + found[1] == pytest.approx(0.0, abs=1e-3)
    assert found[2] == pytest.approx(-0.1, abs=0.02)
    assert ALONG_X[0] @ found == pytest.approx(-0.1, abs=0.01)


def test_a_limit_is_come_nearer_to_the_more_slowly_the_nearer_it_is() -> None:
    for room in (0.4, 0.2, 0.05):
        found = kept([-0.1, 0.0, 0.0], of_sum(-room), at=(0.0, 0.0, 0.0))
        assert found[0] + found[1] == pytest.approx(-CLOSER * room, abs=1e-3)


def test_a_step_away_from_a_limit_stays_as_it_is() -> None:
    assert kept([0.1, 0.0, -0.1], of_sum(0.0), at=(0.0, 0.0, 0.0)).tolist() == [0.1, 0.0, -0.1]


def test_a_limit_that_does_not_count_asks_for_nothing() -> None:
    step = [-0.1, 0.0, 0.0]
    assert kept(step, of_sum(0.0, near_zero(1.0)), at=(0.0, 0.0, 4.0)).tolist() == step


def test_beyond_its_sum_a_limit_is_kept_by_what_makes_it_not_count() -> None:
    found = kept([0.0, 0.0, -0.1], of_sum(0.0, near_zero(1.0)), at=(-3.0, 0.0, 1.0))
    assert found[2] == pytest.approx(0.0, abs=1e-3)
    assert ALONG_X[0] @ found == pytest.approx(-0.1, abs=0.01)


@pytest.mark.parametrize("step", [[-0.1, 0.0, 0.02], [-0.02, 0.0, -0.1]])
def test_where_both_keep_a_limit_that_is_kept_by_which_leaves_more_of_the_step(
    step: list[float],
) -> None:
    found = kept(step, of_sum(0.0, near_zero(1.0)), at=(0.0, 0.0, 1.0))
    by_sum = found[0] + found[1] >= -1e-3
    by_condition = found[2] >= -1e-3
    assert by_sum or by_condition
    larger = int(np.argmax(np.abs(step)))
    if larger == 0:  # the third axis goes out of its band, and the first may go on
        assert found.tolist() == step
    else:
        assert by_sum
        assert found[2] <= -0.1


def test_beyond_a_limit_axes_need_not_come_back_at_once_but_go_no_further() -> None:
    found = kept([-0.1, 0.0, 0.0], of_sum(1.0), at=(0.0, 0.0, 0.0))
    assert found[0] + found[1] == pytest.approx(0.0, abs=1e-3)


def test_no_axis_is_asked_for_more_than_its_speed_and_its_travel() -> None:
    found = kept([-0.125, 0.0, 0.0], of_sum(0.0), at=(0.0, 0.0, -9.99))
    assert (np.abs(found) <= 5.0 * DT_S + 1e-9).all()
    assert found[2] >= -0.01 - 1e-9


def beside_the_guard() -> Vector:
    """Axes of the shipped tubes: the inner one opposite to both others, with 26 mm out."""
    return np.array([0.0, 0.0, np.pi, 0.0, 26.0 - 53.5])


def gone(ask: Callable[[Vector, Vector], Vector], step: Vector) -> tuple[Vector, list[Decision]]:
    """Where the shipped tubes are after four seconds of such a step, as the gate lets them."""
    scales = np.array([axis_scale(axis).counts_per_unit for axis in TUBES.axes])
    gate = Gate(
        [count_limits(axis) for axis in TUBES.axes],
        scales.tolist(),
        [None] * len(TUBES.axes),
        NoModel(),
        0.01,
        1.0,
        count_coupling(TUBES),
    )
    at = [round(value) for value in (beside_the_guard() * scales).tolist()]
    gate.settle(at)
    decisions = []
    for number in range(160):
        targets = np.array(at) / scales
        wanted = ((targets + ask(step, targets)) * scales).tolist()
        measured = Measured(tuple(at), (None,) * len(at))
        decision = gate.decide(wanted, measured, number * STEP_NS, STEP_NS)
        decisions.append(decision)
        assert decision.step is not None
        at = list(decision.step.to_counts)
    return np.array(at) / scales, decisions


def test_the_gate_takes_nothing_more_from_tubes_that_go_along_the_guard_against_snapping() -> None:
    ranges = AxisRanges.of(TUBES)
    keeping = CoupledKeeping(ranges)
    tip = np.array([[0.0, 9.0, 20.0, 0.0, 0.5], [20.0, 0.0, 5.0, 0.0, 0.0], [0, 0, 1.0, 1.0, 0.6]])
    inwards = np.array([0.005, 0.0, 0.0, 0.0, -0.05])
    end, decisions = gone(lambda step, at: keeping.kept(step, at, tip, DT_S), inwards)
    assert all(decision.scale > 0.5 for decision in decisions[40:])
    assert bool(ranges.coupled.inside(end))
    assert end[0] > 0.5, "what does not lead beyond it goes on"
    assert end[3] < -2.0, "the other carriage does what the inner one may not"
    _, as_asked = gone(lambda step, at: step, inwards)
    assert as_asked[-1].scale < 0.02, "else nothing of the inner tube's way is left"


def test_what_is_compiled_beforehand_is_all_that_a_step_needs() -> None:
    keeping = CoupledKeeping(axes(of_sum(0.0)))
    keeping.kept(np.zeros(3), np.zeros(3), ALONG_X, DT_S)
    known = len(keep_coupled.signatures)
    keeping.kept(np.array([-0.1, 0.0, 0.0]), np.zeros(3), ALONG_X, DT_S)
    assert len(keep_coupled.signatures) == known
