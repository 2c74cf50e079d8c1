"""The gate: what it lets through, what it reduces, what it refuses."""

from collections.abc import Sequence
from math import inf, nan

import pytest

from safety import gate
from safety.gate import RISK, RISK_UNAVAILABLE, Gate, Measured
from safety.limits import CountLimits, Violation
from safety.permit import PermittedHoming, PermittedStep, permit
from safety.risk_source import GIVEN_TIP, Leaving, NoModel, RiskAnswers, RiskReading
from tests.safety.gate_rig import (
    LATEST_S,
    LIMITS,
    NEAREST,
    STEP_NS,
    THRESHOLD,
    Rig,
    ToldRisk,
    change,
    risky_beyond,
)

# Setting up.


def make_gate(
    limits: Sequence[CountLimits] = (LIMITS,),
    scales: Sequence[float] = (1.0,),
    tensions: Sequence[tuple[float, float] | None] = (None,),
    threshold: float = THRESHOLD,
) -> Gate:
    return Gate(limits, scales, tensions, NoModel(), threshold, LATEST_S)


def test_each_axis_has_limits_a_scale_and_tension_limits() -> None:
    for change_ in ({"limits": ()}, {"scales": ()}, {"tensions": ()}):
        with pytest.raises(ValueError, match="for each axis"):
            make_gate(**change_)  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", [0.0, nan, inf])
def test_a_scale_can_be_divided_by(scale: float) -> None:
    with pytest.raises(ValueError, match="a scale is finite"):
        make_gate([LIMITS] * 2, [1.0, scale], [None] * 2)


@pytest.mark.parametrize("threshold", [-0.01, 1.01, nan])
def test_a_threshold_is_a_probability(threshold: float) -> None:
    with pytest.raises(ValueError, match="is not a probability"):
        make_gate(threshold=threshold)


@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_a_threshold_may_be_none_or_all(threshold: float) -> None:
    make_gate(threshold=threshold)


# What goes through.


def test_a_modest_step_goes_through_as_it_is() -> None:
    rig = Rig(2)
    decision = rig.decide(50_100, 49_900)
    assert decision.step is not None
    assert decision.step.from_counts == (50_000, 50_000)
    assert decision.step.to_counts == (50_100, 49_900)
    assert (decision.step.begins_ns, decision.step.ends_ns) == (STEP_NS, 2 * STEP_NS)
    assert (decision.scale, decision.limits, decision.refused) == (1.0, (), "")
    assert (decision.risk, decision.body_point_risk) == (0.0, 0.0)
    assert decision.risk_detail == "as told"


def test_targets_need_not_be_whole_counts() -> None:
    decision = Rig().decide(50_000.4)
    assert (change(decision), decision.scale, decision.limits) == (0, 1.0, ())
    for target in (50_099.6, 50_100.4):
        decision = Rig().decide(target)
        assert (change(decision), decision.scale, decision.limits) == (100, 1.0, ())


def test_a_gate_that_was_never_settled_begins_where_the_axes_are() -> None:
    decision = make_gate().decide([70_050], Measured([70_000], [None]), 0, STEP_NS)
    assert decision.step is not None
    assert decision.step.from_counts == (70_000,)


def test_steps_join_on() -> None:
    rig = Rig()
    first, second = rig.decide(50_100).step, rig.decide(50_300).step
    assert first is not None
    assert second is not None
    assert second.from_counts == first.to_counts
    assert second.begins_ns == first.ends_ns


def test_settling_begins_anew_at_rest() -> None:
    rig = Rig()
    rig.run_up(90_000)
    rig.gate.settle([20_000])
    decision = rig.decide(90_000, measured=rig.measured(20_010))
    assert decision.step is not None
    assert decision.step.from_counts == (20_000,)
    assert change(decision) == 125


def test_all_axes_are_settled_at_once() -> None:
    with pytest.raises(ValueError, match="1 positions for 2 axes"):
        Rig(2).gate.settle([0])


# Velocity.


def test_all_axes_are_scaled_by_the_same_factor() -> None:
    rig = Rig(3)
    rig.run_up(90_000, 70_000, 40_000)
    at = rig.at
    decision = rig.decide(at[0] + 1000, at[1] + 500, at[2] - 250)
    assert [change(decision, axis) for axis in range(3)] == [500, 250, -125]
    assert decision.limits == ("velocity: axis 0",)
    assert decision.scale == 0.5


def test_the_axis_that_is_furthest_beyond_sets_the_factor() -> None:
    rig = Rig(2)
    rig.run_up(70_000, 90_000)
    decision = rig.decide(rig.at[0] + 600, rig.at[1] + 1000)
    assert decision.limits[0] == "velocity: axis 1"
    rig = Rig(2)
    rig.run_up(90_000, 70_000)
    decision = rig.decide(rig.at[0] + 1000, rig.at[1] + 600)
    assert decision.limits[0] == "velocity: axis 0"


def test_the_highest_velocity_itself_is_allowed() -> None:
    rig = Rig()
    rig.run_up(90_000)
    decision = rig.decide(rig.at[0] + 500)
    assert (change(decision), decision.scale, decision.limits) == (500, 1.0, ())


def test_an_axis_that_wants_out_of_its_travel_does_not_slow_the_others() -> None:
    rig = Rig(2, at=100_000)
    decision = rig.decide(1e300, 99_900)
    assert [change(decision, axis) for axis in range(2)] == [0, -100]
    assert decision.limits == ("position: axis 0",)
    assert decision.scale == 0.0


# Acceleration.


def test_speed_is_gained_and_lost_step_by_step() -> None:
    rig = Rig()
    changes = [change(rig.decide(90_000)) for _ in range(6)]
    assert changes == [125, 250, 375, 500, 500, 500]
    back = Rig()
    assert [-change(back.decide(10_000)) for _ in range(6)] == changes
    slowing = [rig.decide(rig.at[0]) for _ in range(5)]
    assert [change(decision) for decision in slowing] == [375, 250, 125, 0, 0]
    assert slowing[0].limits == ("acceleration: axis 0",)
    assert slowing[3].limits == ()


def test_only_what_is_limited_is_named() -> None:
    decision = Rig(2).decide(50_100, 50_200)
    assert decision.limits == ("acceleration: axis 1",)
    assert decision.scale == 125 / 200


def test_a_step_against_the_motion_counts_as_nothing_of_the_proposal() -> None:
    rig = Rig()
    rig.run_up(90_000)
    decision = rig.decide(rig.at[0] - 100)
    assert change(decision) == 375
    assert decision.scale == 0.0


def test_an_axis_starts_from_rest() -> None:
    weak = CountLimits(0, 100_000, 20_000, 1, 2_000)
    rig = Rig(limits=weak)
    decision = rig.gate.decide([50_100], rig.measured(), 0, 2_000_000_000)
    assert change(decision) == 4


# Frames come early and late.


@pytest.mark.parametrize(
    ("late_ns", "beyond", "changed"),
    [
        (0, 0, 500),
        (1_000_000, 20, 500),
        (12_500_000, 235, 500),
        (50_000_000, 750, 375),
        (100_000_000, 1000, 125),
        (4_000_000_000, 1000, 125),
    ],
)
def test_an_axis_brakes_until_a_late_frame_comes(late_ns: int, beyond: int, changed: int) -> None:
    rig = Rig()
    rig.run_up(90_000)
    end = rig.at[0]
    rig.t_ns += late_ns
    decision = rig.decide(90_000)
    assert decision.step is not None
    assert decision.step.from_counts == (end + beyond,)
    assert change(decision) == changed


def test_after_a_late_frame_an_axis_brakes_from_the_velocity_that_it_has() -> None:
    rig = Rig()
    rig.run_up(90_000)
    rig.t_ns += STEP_NS // 4
    assert change(rig.hold()) == 344, "31 less while it waited, 125 less in the step"


def test_a_step_that_was_not_sent_is_taken_back() -> None:
    rig = Rig()
    rig.run_up(90_000)
    before = rig.at[0]
    lost = rig.decide(90_000)
    assert lost.step is not None
    rig.gate.take_back(lost.step)
    # Half a step later the axes brake behind the step before: 250 less 15. The lost one goes on.
    decision = rig.gate.decide([90_000], rig.measured(before), rig.t_ns + STEP_NS // 2, STEP_NS)
    assert decision.step is not None
    assert decision.step.from_counts == (before + 235,)
    rig.gate.take_back(lost.step)  # only the last one can be taken back
    begins_ns = rig.t_ns + STEP_NS // 2 + STEP_NS
    again = rig.gate.hold(rig.measured(decision.step.to_counts[0]), begins_ns, STEP_NS)
    assert again.step is not None
    assert again.step.from_counts == decision.step.to_counts


def test_what_was_before_the_axes_settled_is_not_gone_back_to() -> None:
    rig = Rig()
    rig.run_up(90_000)
    rig.gate.settle([1000])
    first = rig.gate.decide([1100], rig.measured(1000), rig.t_ns, STEP_NS)
    assert first.step is not None
    rig.gate.take_back(first.step)
    again = rig.gate.hold(rig.measured(1000), rig.t_ns, STEP_NS)
    assert again.step is not None
    assert again.step.from_counts == (1000,)


def test_an_early_frame_cuts_the_step_short_where_it_is() -> None:
    rig = Rig()
    rig.run_up(90_000)
    begins_ns = rig.t_ns + STEP_NS * 4 // 5
    decision = rig.gate.decide([90_000], rig.measured(), begins_ns, STEP_NS)
    assert decision.step is not None
    assert decision.step.from_counts == (rig.at[0] - 100,)
    assert change(decision) == 500


def test_frames_in_a_burst_do_not_add_up_to_a_jump() -> None:
    rig = Rig()
    changes = []
    for t_ns in (0, 1, 2, 3, 3 + STEP_NS // 5):
        decision = rig.gate.decide([90_000], rig.measured(), t_ns, STEP_NS)
        changes.append(change(decision))
    assert changes == [125, 125, 125, 125, 150]


def test_a_frame_from_the_past_does_not_speed_anything_up() -> None:
    rig = Rig()
    rig.run_up(90_000)
    start = rig.at[0] - 500
    decision = rig.gate.decide([90_000], rig.measured(), rig.t_ns - 10 * STEP_NS, STEP_NS)
    assert decision.step is not None
    assert decision.step.from_counts == (start,)
    assert change(decision) == 500


def test_steps_need_not_be_of_one_length() -> None:
    rig = Rig()
    rig.run_up(90_000)
    decision = rig.gate.decide([90_000], rig.measured(), rig.t_ns + STEP_NS, 2 * STEP_NS)
    assert change(decision) == 1000
    rig.at = [rig.at[0] + 1000]
    decision = rig.gate.hold(rig.measured(), rig.t_ns + 3 * STEP_NS, STEP_NS)
    assert change(decision) == 375


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


# Holding.


def test_a_hold_brakes_to_rest_and_stays() -> None:
    rig = Rig(2)
    rig.run_up(90_000, 10_000)
    held = [rig.hold() for _ in range(6)]
    assert [change(decision, 0) for decision in held] == [375, 250, 125, 0, 0, 0]
    assert [change(decision, 1) for decision in held] == [-375, -250, -125, 0, 0, 0]
    assert {decision.refused for decision in held} == {""}
    assert {decision.scale for decision in held} == {1.0}
    assert {decision.risk for decision in held} == {None}
    assert {decision.limits for decision in held} == {()}


# Risk.


def test_the_risk_is_asked_for_the_whole_way_until_the_body_has_stopped() -> None:
    rig = Rig(2)
    rig.run_up(90_000, 10_000)
    rig.risk.asked.clear()
    start = list(rig.at)
    rig.decide(start[0] + 500, start[1] - 500, measured=rig.measured(start[0] - 40, start[1]))
    u_from, u_to, t_ns = rig.risk.asked[0]
    assert u_from == [(start[0] - 40) / 2000.0, start[1] / 2000.0]
    braking = 500 * 500 / 2 / 125
    assert u_to == [(start[0] + 500 + braking) / 2000.0, (start[1] - 500 - braking) / 2000.0]
    assert t_ns == rig.t_ns
    assert len(rig.risk.asked) == 1


def test_a_risk_at_the_threshold_may_be_taken() -> None:
    decision = Rig(risk=ToldRisk(THRESHOLD)).decide(50_100)
    assert (change(decision), decision.risk, decision.refused) == (100, THRESHOLD, "")
    assert decision.body_point_risk == THRESHOLD / 10
    assert decision.nearest is NEAREST


@pytest.mark.parametrize(("wall", "changed"), [(50_140.0, 100), (50_139.9, 50), (50_059.9, 25)])
def test_a_step_is_shortened_until_its_risk_may_be_taken(wall: float, changed: int) -> None:
    rig = Rig(risk=risky_beyond(wall / 2000.0))
    decision = rig.decide(50_100)
    assert (change(decision), decision.refused) == (changed, "")
    assert decision.limits == ((RISK,) if changed < 100 else ())
    assert decision.scale == changed / 100
    assert (decision.risk, decision.risk_detail) == (0.0, "a wall")


def test_a_body_that_touches_something_may_leave_it() -> None:
    out = Leaving(at_start=0.8, added=0.003)
    rig = Rig(risk=ToldRisk(lambda _, __: RiskReading(0.8, 0.1, 0.001, "told", leaving=out)))
    decision = rig.decide(50_100)
    assert (change(decision), decision.risk, decision.refused) == (100, 0.8, "")
    assert decision.limits == ()
    assert len(rig.risk.asked) == 1


def test_a_body_that_leaves_one_thing_is_not_led_into_another() -> None:
    def between(_: object, u_to: Sequence[float]) -> RiskReading:
        added = 0.0 if u_to[0] < 50_070 / 2000.0 else 0.5
        return RiskReading(0.8, 0.1, 0.001, "told", leaving=Leaving(at_start=0.8, added=added))

    rig = Rig(risk=ToldRisk(between))
    decision = rig.decide(50_100)
    assert (change(decision), decision.limits) == (50, (RISK,))


def test_a_step_of_which_no_part_is_safe_is_refused_and_braked() -> None:
    rig = Rig()
    rig.run_up(90_000)
    rig.risk.risk = 0.051
    rig.risk.asked.clear()
    decision = rig.decide(90_000)
    assert (decision.refused, decision.risk, decision.scale) == (RISK, 0.051, 0.0)
    assert decision.risk_detail == "as told"
    assert decision.body_point_risk == pytest.approx(0.0051)
    assert decision.nearest is NEAREST
    assert "velocity: axis 0" in decision.limits
    assert change(decision) == 375
    assert len(rig.risk.asked) == 3


def test_a_shortened_step_keeps_to_the_acceleration() -> None:
    rig = Rig()
    rig.run_up(90_000)
    at = rig.at[0]
    brakes = (at + 375 + 375 * 375 / 250) / 2000.0
    rig.risk.risk = risky_beyond(brakes).risk
    decision = rig.decide(90_000)
    assert (change(decision), decision.limits) == (375, ("velocity: axis 0", RISK))


@pytest.mark.parametrize("threshold", [0.05, 1.0])
def test_a_risk_that_is_not_known_refuses_whatever_the_threshold(threshold: float) -> None:
    risk = ToldRisk(lambda _, __: None)
    one = Gate([LIMITS], [2000.0], [None], risk, threshold, LATEST_S)
    decision = one.decide([50_100], Measured([50_000], [None]), 0, STEP_NS)
    assert change(decision) == 0
    assert (decision.refused, decision.risk) == (RISK_UNAVAILABLE, 1.0)
    assert decision.risk_detail == "no answer"
    assert len(risk.asked) == 1, "what gave no answer is not asked again"


def test_a_source_that_fails_refuses() -> None:
    def fail(_: object, __: object) -> RiskReading:
        raise ValueError("not a body")

    decision = Rig(risk=ToldRisk(fail)).decide(50_100)
    assert (decision.refused, decision.risk, change(decision)) == (RISK_UNAVAILABLE, 1.0, 0)
    assert decision.risk_detail == "told failed: ValueError: not a body"


def test_all_answers_together_have_the_time_of_one() -> None:
    def slow(_: object, u_to: Sequence[float]) -> RiskReading:
        return RiskReading(float(u_to[0] > 50_059.9 / 2000.0), None, took_s, "told")

    took_s = LATEST_S / 3 - 1e-6
    assert not Rig(risk=ToldRisk(slow)).decide(50_100).refused
    took_s = LATEST_S / 3 + 1e-6
    decision = Rig(risk=ToldRisk(slow)).decide(50_100)
    assert decision.refused == RISK_UNAVAILABLE
    assert "late" in decision.risk_detail


def test_a_hold_is_not_asked_about() -> None:
    rig = Rig(risk=ToldRisk(1.0))
    assert change(rig.hold()) == 0
    assert rig.risk.asked == []


# The last check.


def test_what_the_last_check_finds_is_braked(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[object] = []

    def check(**arguments: object) -> object:
        if not found:
            found.append(arguments["to_counts"])
            return (Violation(0, "velocity", 2, 1), Violation(1, "acceleration", 2, 1))
        return permit(**arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(gate, "permit", check)
    decision = Rig(2).decide(50_100, 50_200)
    assert found == [[50_100, 50_125]]
    assert [change(decision, axis) for axis in range(2)] == [0, 0]
    assert decision.refused == "axis 0: velocity 2 is beyond 1; axis 1: acceleration 2 is beyond 1"
    assert (decision.scale, decision.risk) == (0.0, 0.0)
    assert decision.limits == ("acceleration: axis 1",)


def test_a_refused_step_is_not_remembered() -> None:
    rig = Rig()
    assert rig.decide(50_100, measured=rig.measured(10_000)).step is None
    decision = rig.decide(50_100)
    assert isinstance(decision.step, PermittedStep)
    assert decision.step.from_counts == (50_000,)


# Homing.


def test_only_axes_that_exist_are_homed() -> None:
    rig = Rig(2)
    permitted = rig.gate.permit_homing(1, [0, 0])
    assert isinstance(permitted, PermittedHoming)
    assert permitted.axis == 1
    assert rig.gate.permit_homing(0, [None, None]).axis == 0
    for axis in (-1, 2):
        with pytest.raises(ValueError, match=f"no axis {axis}"):
            rig.gate.permit_homing(axis, [0, 0])
    with pytest.raises(ValueError, match="1 places for 2 axes"):
        rig.gate.permit_homing(0, [0])


# At rest.


def test_a_body_at_rest_is_asked_about_where_it_is_measured() -> None:
    rig = Rig(2)
    assert rig.gate.refuses_rest(rig.measured(2000, -4000), 77) == ""
    assert rig.risk.asked == [([1.0, -2.0], [1.0, -2.0], 77)]


def test_a_body_at_rest_that_touches_may_not_be_energised() -> None:
    assert Rig(risk=ToldRisk(THRESHOLD)).gate.refuses_rest(Rig().measured(), 0) == ""
    refused = Rig(risk=ToldRisk(0.051)).gate.refuses_rest(Rig().measured(), 0)
    assert refused == (
        "the body touches something where it stands, or may at any moment: clearance 2.0 mm at "
        "150 mm along the body, there (0, 1, 2) mm; the risk is 0.051, and 0.05 is allowed"
    )


@pytest.mark.parametrize(("detail", "where"), [("a wall", "a wall"), ("", "it is not known where")])
def test_where_nobody_says_the_place_what_is_said_stands_for_it(detail: str, where: str) -> None:
    source = ToldRisk(lambda _from, _to: RiskReading(0.9, None, 0.001, "told", detail))
    refused = Rig(risk=source).gate.refuses_rest(Rig().measured(), 0)
    assert f"at any moment: {where}; the risk is 0.9" in refused


def test_the_answers_that_the_risk_is_one_of_go_with_the_decision() -> None:
    answers = RiskAnswers(0.3, 0.01, GIVEN_TIP)
    told = RiskReading(0.01, None, 0.001, "told", answers=answers)
    rig = Rig(risk=ToldRisk(lambda _from, _to: told))
    assert rig.decide(50_100).answers is answers
    assert rig.gate.hold(rig.measured(), 0, STEP_NS).answers is None


def test_a_way_out_does_not_make_a_contact_at_rest_bearable() -> None:
    out = Leaving(at_start=0.9, added=0.0)
    source = ToldRisk(lambda _from, _to: RiskReading(0.9, None, 0.001, "told", leaving=out))
    assert Rig(risk=source).gate.refuses_rest(Rig().measured(), 0)


def test_a_body_whose_risk_is_not_known_may_not_be_energised() -> None:
    assert Rig(risk=ToldRisk(nan)).gate.refuses_rest(Rig().measured(), 0) == (
        "the risk of touching something is not known here: nan is not a probability"
    )
    late = ToldRisk(lambda _from, _to: RiskReading(0.0, None, 1.0, "told"))
    assert "late" in Rig(risk=late).gate.refuses_rest(Rig().measured(), 0)


def test_a_body_that_is_not_measured_may_not_be_energised() -> None:
    rig = Rig(2)
    assert rig.gate.refuses_rest(rig.measured(0, None), 0) == "not measured: axis 1"
    assert rig.risk.asked == []
