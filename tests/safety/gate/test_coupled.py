"""The gate of axes that are coupled: what is cut, told and asked, and what is never on the bus."""

from dataclasses import replace
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.coupling import AxisSum, Condition, CoupledLimit
from safety.gate import RISK, Gate, Measured
from safety.permit import PermittedStep
from safety.risk_source import NoModel, RiskReading
from tests.safety.examples import examples
from tests.safety.gate.gate_rig import LATEST_S, LIMITS, STEP_NS, THRESHOLD, ToldRisk

WIDE = replace(LIMITS, lowest=-100_000)
ORDER = CoupledLimit("order", AxisSum(((0, 1.0), (1, -1.0))), -1000.0, 1000.0)
GUARD = CoupledLimit(
    "guard", AxisSum(((1, 1.0),)), 0.0, inf, (Condition(AxisSum(((2, 1.0),)), 2000, 500, 10_000),)
)
MS = 1_000_000


class CoupledRig:
    """A gate of three axes, which are measured where they were last told to be."""

    def __init__(
        self,
        at: tuple[int, int, int] = (0, 0, 0),
        coupled: tuple[CoupledLimit, ...] = (ORDER, GUARD),
        risk: ToldRisk | None = None,
    ) -> None:
        self.risk = risk or ToldRisk()
        self.gate = Gate([WIDE] * 3, [2.0] * 3, [None] * 3, self.risk, THRESHOLD, LATEST_S, coupled)
        self.gate.settle(at)
        self.at: tuple[int, ...] = at
        self.t_ns = 0

    def decide(self, *targets: float) -> tuple[list[int], tuple[str, ...]]:
        """The changes of one step, and what was cut."""
        self.t_ns += STEP_NS
        decision = self.gate.decide(targets, self.measured(), self.t_ns, STEP_NS)
        assert decision.step is not None, decision.refused
        return self._moved(decision.step), decision.limits

    def hold(self) -> list[int]:
        """The changes of one step that brakes."""
        self.t_ns += STEP_NS
        decision = self.gate.hold(self.measured(), self.t_ns, STEP_NS)
        assert decision.step is not None
        return self._moved(decision.step)

    def measured(self) -> Measured:
        return Measured(list(self.at), [None] * 3)

    def _moved(self, step: PermittedStep) -> list[int]:
        self.at = step.to_counts
        return [b - a for a, b in zip(step.from_counts, step.to_counts, strict=True)]


def at_full_speed() -> CoupledRig:
    """500 and 100 counts a step, along a limit that leaves little room beside that line."""
    beside = CoupledLimit("beside", AxisSum(((0, 0.2), (1, -1.0))), -60.0, 60.0)
    rig = CoupledRig(coupled=(beside,))
    for change in (125, 250, 375, 500, 500):
        assert rig.decide(rig.at[0] + change, rig.at[1] + change / 5, 0)[1] == ()
    return rig


def test_what_is_no_limit_of_these_axes_is_refused() -> None:
    for wrong in (
        ORDER._replace(sum=AxisSum(((3, 1.0),))),
        ORDER._replace(highest=-1000.0),
    ):
        with pytest.raises(ValueError, match="order"):
            Gate([WIDE] * 3, [1.0] * 3, [None] * 3, NoModel(), 0.5, 0.02, (wrong,))


def test_a_cut_is_told_with_the_limits_name_and_as_a_scale() -> None:
    rig = CoupledRig((992, 0, 0))
    rig.t_ns += STEP_NS
    decision = rig.gate.decide([1092, 0, 0], rig.measured(), rig.t_ns, STEP_NS)
    assert decision.limits == ("coupled limit: order",)
    assert decision.scale == 0.0
    assert decision.refused == ""


def test_every_limit_is_come_to_and_kept_at_full_speed() -> None:
    rig = CoupledRig()
    for _ in range(60):
        rig.decide(50_000, -50_000, 0)
    assert 970 <= rig.at[0] - rig.at[1] <= 992
    for _ in range(60):
        rig.decide(-50_000, 50_000, 0)
    assert -992 <= rig.at[0] - rig.at[1] <= -970


def test_along_a_limit_the_axes_go_on_together() -> None:
    rig = CoupledRig((992, 0, 0))
    for _ in range(40):
        rig.decide(50_000, 50_000, 0)
    assert rig.at[1] >= 15_000
    assert rig.at[0] - rig.at[1] <= 992


def test_a_guard_stops_on_either_side_and_lets_through_once_it_is_kept_otherwise() -> None:
    rig = CoupledRig((-200, -300, 0))
    for _ in range(20):
        rig.decide(-200, -300, 2000)
    assert 1450 <= rig.at[2] <= 1496  # before the band
    for _ in range(30):
        rig.decide(300, 300, 2000)
    assert rig.at[1] >= 290
    assert abs(rig.at[2] - 2000) <= 1  # through, once it is above
    for _ in range(30):
        rig.decide(0, -500, 2000)
    assert 4 <= rig.at[1] <= 30  # and now it is the other that stops
    for _ in range(40):
        rig.decide(0, -500, 4000)
    assert rig.at[1] <= -450


def test_a_hold_brakes_on_one_line() -> None:
    rig = at_full_speed()
    first, second, _ = rig.hold()
    assert (first, second) == (375, 75)
    assert rig.hold()[:2] == [250, 50]


def test_far_from_all_limits_each_axis_brakes_as_hard_as_it_may() -> None:
    rig = CoupledRig(coupled=(ORDER._replace(lowest=-1e6, highest=1e6),))
    for change in (125, 250, 375, 500, 500):
        rig.decide(rig.at[0] + change, rig.at[1] + change / 5, 0)
    assert rig.hold() == [375, 0, 0]


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_what_is_not_finite_is_braked_on_one_line(bad: float) -> None:
    rig = at_full_speed()
    assert rig.decide(bad, 0, 0)[0] == [375, 75, 0]


def test_a_refused_risk_is_braked_on_one_line_and_asked_where_that_ends() -> None:
    rig = at_full_speed()
    before = rig.at
    rig.risk.risk = lambda _from, _to: RiskReading(1.0, None, 0.001, "told", "")
    rig.t_ns += STEP_NS
    decision = rig.gate.decide(
        [before[0] + 500, before[1] + 100, 0], rig.measured(), rig.t_ns, STEP_NS
    )
    assert decision.refused == RISK
    u_to = rig.risk.asked[-3][1]
    # 500 and 100 a step come to rest 1000 and 200 further, of 2 counts per unit.
    assert u_to == [(before[0] + 1500) / 2, (before[1] + 300) / 2, 0.0]


def test_a_smaller_share_of_a_step_keeps_to_the_limits_too() -> None:
    rig = CoupledRig((800, 0, 0))
    rig.risk.risk = lambda _from, to: RiskReading(
        float(to[0] > 440.0), None, 0.001, "told", "a wall"
    )
    for _ in range(30):
        changes, _ = rig.decide(50_000, 0, 0)
        assert rig.at[0] <= 992
    assert changes[0] >= 0


def test_where_nothing_keeps_to_a_limit_the_last_step_ends_by_itself() -> None:
    rig = CoupledRig((0, 0, 0), coupled=(ORDER,))
    for _ in range(8):
        rig.decide(rig.at[0] + 400, rig.at[1] + 400, 0)
    # A limit that nobody knew of, just ahead and too near to stop.
    rig.gate._coupled = (ORDER._replace(sum=AxisSum(((0, 1.0),)), highest=rig.at[0] + 50.0),)
    rig.t_ns += STEP_NS
    decision = rig.gate.decide([50_000, 50_000, 0], rig.measured(), rig.t_ns, STEP_NS)
    assert decision.step is None
    assert "coupled limit order: the way does not keep to it" in decision.refused


@examples(150)
@given(
    start=st.tuples(st.integers(-400, 400), st.integers(-400, 400), st.integers(-3000, 20_000)),
    goals=st.lists(
        st.tuples(*[st.integers(-20_000, 20_000)] * 2, st.integers(-3000, 20_000)),
        min_size=1,
        max_size=6,
    ),
    after_ms=st.lists(
        st.one_of(st.just(25.0), st.floats(0.0, 60.0), st.sampled_from([0.0, 0.5, 37.4, 200.0])),
        min_size=1,
        max_size=8,
    ),
    steps=st.integers(1, 60),
)
def test_nothing_outside_goes_on_the_bus_whenever_frames_come(
    start: tuple[int, int, int],
    goals: list[tuple[int, ...]],
    after_ms: list[float],
    steps: int,
) -> None:
    def outside(at: tuple[int, ...]) -> bool:
        return abs(at[0] - at[1]) > 1000 or (
            at[1] < 0 and abs((at[2] + 3000) % 10_000 - 5000) < 500
        )

    if outside(start):
        return
    rig = CoupledRig(start)
    last: PermittedStep | None = None
    for number in range(steps):
        goal = goals[number * len(goals) // steps]
        for ms in range(0, int(after_ms[number % len(after_ms)]) + 1, 2):
            if last is not None:
                rig.at = last.targets(rig.t_ns + ms * MS)
                assert not outside(rig.at)
        rig.t_ns += round(after_ms[number % len(after_ms)] * MS)
        rig.at = last.targets(rig.t_ns) if last is not None else rig.at
        decision = rig.gate.decide(goal, rig.measured(), rig.t_ns, STEP_NS)
        assert "beyond" not in decision.refused
        last = decision.step or last
