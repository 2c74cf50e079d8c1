"""What the gate lets through of a motion, and how it brakes, however frames come."""

from collections.abc import Sequence
from math import inf, nan

import pytest

from safety.gate import Gate, Measured
from safety.limits import CountLimits
from safety.risk_source import NoModel
from tests.safety.gate.gate_rig import (
    LATEST_S,
    LIMITS,
    STEP_NS,
    THRESHOLD,
    Rig,
    change,
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
