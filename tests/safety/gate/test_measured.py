"""What measurements leave of a step, and which proposals and measurements cannot be used."""

from math import inf, nan

import pytest

from safety.gate import Gate, Measured
from safety.risk_source import NoModel
from tests.safety.gate.gate_rig import (
    LATEST_S,
    LIMITS,
    STEP_NS,
    THRESHOLD,
    Rig,
    change,
)

# The ends of travel, and what the sensors say.


def test_an_axis_comes_to_rest_at_the_end_of_its_travel() -> None:
    rig = Rig(at=95_000)
    decisions = [rig.decide(200_000) for _ in range(40)]
    assert rig.at == [100_000]
    assert max(change(decision) for decision in decisions) == 500
    assert any("braking distance: axis 0" in decision.limits for decision in decisions)
    assert decisions[-1].limits == ("position: axis 0",)


def test_an_axis_outside_its_travel_is_not_moved_unasked() -> None:
    for outside in (100_500, -500):
        rig = Rig(at=outside)
        decision = rig.decide(outside)
        assert (change(decision), decision.limits) == (0, ())
        assert change(rig.hold()) == 0


def test_an_axis_outside_its_travel_may_come_back() -> None:
    assert change(Rig(at=100_500).decide(100_400)) == -100
    assert change(Rig(at=-500).decide(-400)) == 100
    assert change(Rig(at=100_500).decide(100_600)) == 0
    assert change(Rig(at=-500).decide(-600)) == 0


def test_a_target_does_not_run_away_from_an_axis_that_is_stuck() -> None:
    rig = Rig()
    stuck = rig.measured(50_000)
    limits: list[str] = []
    for _ in range(60):
        decision = rig.decide(rig.at[0] + 100, measured=stuck)
        limits.extend(decision.limits)
    assert rig.at == [52_000]
    assert set(limits) == {"distance from measured: axis 0"}
    assert decision.scale == 0.0


@pytest.mark.parametrize(("ask", "kept"), [(100_000, 1.0), (100_400, 0.0)])
def test_of_an_axis_that_has_to_turn_nothing_is_kept_but_of_one_at_its_end_all(
    ask: int, kept: float
) -> None:
    """Slow drives take a second to turn. Who took that for a robot that gets nowhere held it."""
    rig = Rig(2, at=100_000)
    for _ in range(20):
        rig.decide(rig.at[0] - 400, 100_000)
    turning = 0
    while (decision := rig.decide(rig.at[0] + 400, ask)).step is not None:
        if decision.step.to_counts[0] >= decision.step.from_counts[0]:
            break
        turning += 1
        assert (decision.scale, decision.kept) == (0.0, kept)
    assert turning > 1


def test_an_axis_that_is_far_from_its_target_gets_no_step() -> None:
    rig = Rig()
    far = rig.measured(47_999)
    for decision in (rig.decide(50_100, measured=far), rig.hold(far)):
        assert decision.step is None
        assert decision.refused == "axis 0: distance from measured 2001 is beyond 2000"
        assert decision.scale == 0.0
    assert rig.decide(nan, measured=far).refused == "the target is nan: axis 0"
    assert not rig.decide(50_100, measured=rig.measured(48_200)).refused


def test_the_tendon_that_is_too_tense_may_only_be_released() -> None:
    for counts_per_unit in (2000.0, -2000.0):
        pull = 100 if counts_per_unit > 0 else -100
        rig = Rig(tension_limits_n=(1.0, 20.0), counts_per_unit=counts_per_unit)
        rig.tension_n = 25.0
        decision = rig.decide(50_000 + pull)
        assert (change(decision), decision.limits) == (0, ("tension: axis 0",))
        assert decision.scale == 0.0
        decision = rig.decide(50_000 - pull)
        assert (change(decision), decision.limits) == (-pull, ())


def test_the_tendon_that_is_too_slack_may_only_be_pulled() -> None:
    for counts_per_unit in (2000.0, -2000.0):
        pull = 100 if counts_per_unit > 0 else -100
        rig = Rig(tension_limits_n=(1.0, 20.0), counts_per_unit=counts_per_unit)
        rig.tension_n = 0.5
        decision = rig.decide(50_000 - pull)
        assert (change(decision), decision.limits) == (0, ("tension: axis 0",))
        decision = rig.decide(50_000 + pull)
        assert (change(decision), decision.limits) == (pull, ())


def test_a_tendon_of_unknown_tension_stands() -> None:
    rig = Rig(tension_limits_n=(1.0, 20.0))
    assert [change(rig.decide(rig.at[0] + way)) for way in (100, -100)] == [0, 0]


def test_a_tendon_that_is_pulled_too_hard_in_motion_is_braked_not_jerked() -> None:
    rig = Rig(tension_limits_n=(1.0, 20.0))
    rig.tension_n = 10.0
    rig.run_up(90_000)
    rig.tension_n = 25.0
    assert [change(rig.decide(90_000)) for _ in range(4)] == [375, 250, 125, 0]


def test_tension_and_lag_may_limit_one_axis_each() -> None:
    one = Gate([LIMITS] * 2, [1.0] * 2, [(1.0, 20.0), None], NoModel(), THRESHOLD, LATEST_S)
    one.settle([50_000, 50_000])
    decision = one.decide([50_100, 50_100], Measured([50_000, 48_050], [30.0, None]), 0, STEP_NS)
    assert [change(decision, axis) for axis in range(2)] == [0, 50]
    assert decision.limits == ("tension: axis 0", "distance from measured: axis 1")
    assert decision.scale == 0.0


# What cannot be used.


@pytest.mark.parametrize("target", [nan, inf, -inf])
def test_a_target_that_is_not_finite_is_refused_and_braked(target: float) -> None:
    rig = Rig(2)
    rig.run_up(90_000, 90_000)
    decision = rig.decide(90_000, target)
    assert decision.refused == f"the target is {target}: axis 1"
    assert [change(decision, axis) for axis in range(2)] == [375, 375]
    assert (decision.scale, decision.risk, decision.limits) == (0.0, None, ())


@pytest.mark.parametrize("targets", [(), (50_000.0,), (50_000.0,) * 3])
def test_a_wrong_number_of_targets_is_refused_and_braked(targets: tuple[float, ...]) -> None:
    rig = Rig(2)
    rig.run_up(90_000, 90_000)
    decision = rig.decide(*targets)
    assert decision.refused == f"{len(targets)} targets for 2 axes"
    assert change(decision) == 375


def test_an_axis_that_is_not_measured_stops_everything() -> None:
    rig = Rig(2)
    rig.run_up(90_000, 90_000)
    for decision in (
        rig.decide(90_000, 90_000, measured=rig.measured(50_000, None)),
        rig.hold(rig.measured(50_000, None)),
    ):
        assert decision.step is None
        assert (decision.refused, decision.scale) == ("not measured: axis 1", 0.0)
        assert (decision.limits, decision.risk, decision.risk_detail) == ((), None, "")


@pytest.mark.parametrize(
    "measured", [Measured([50_000], [None, None]), Measured([50_000, 50_000], [None])]
)
def test_measurements_that_do_not_fit_stop_everything(measured: Measured) -> None:
    rig = Rig(2)
    decision = rig.decide(50_000, 50_000, measured=measured)
    assert decision.step is None
    assert decision.refused == "not one measurement for each of 2 axes"


def test_a_step_may_be_as_short_as_time_can_be() -> None:
    rig = Rig()
    assert not rig.gate.decide([50_000], rig.measured(), 0, 1).refused


@pytest.mark.parametrize("duration_ns", [0, -1])
def test_a_step_without_a_duration_is_refused(duration_ns: int) -> None:
    rig = Rig()
    for decision in (
        rig.gate.decide([50_000], rig.measured(), 0, duration_ns),
        rig.gate.hold(rig.measured(), 0, duration_ns),
    ):
        assert decision.step is None
        assert decision.refused == "the step has no duration"
