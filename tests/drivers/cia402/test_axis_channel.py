"""What one axis is sent, cycle after cycle, from what it says."""

from struct import pack, unpack
from typing import Any

import pytest
from pydantic import TypeAdapter

from config.axis import Axis
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.power_state import PowerGoal, PowerState
from safety.limits import CountLimits
from safety.permit import PermittedStep, permit

MS = 1_000_000
DISABLED, READY, SWITCHED_ON, ENABLED, FOLLOWING, FAULT = 0x250, 0x631, 0x633, 0x637, 0x1637, 0x238
LIMITS = CountLimits(-(10**9), 10**9, 10**9, 10**12, 10**9)


def channel(mode: str = "csp", **drive: Any) -> AxisChannel:
    axis = TypeAdapter[Axis](Axis).validate_python(
        {
            "name": "a",
            "kind": "linear_stepper",
            "drive": {
                "bus": "can0",
                "node": 3,
                "counts_per_turn": 4000,
                "rated_torque_nmm": 400.0,
                "mode": mode,
                **drive,
            },
            "lead_mm": 2.0,
            "travel_mm": [0.0, 50.0],
            "max_velocity_mm_s": 10.0,
            "max_acceleration_mm_s2": 100.0,
            "quick_stop_deceleration_mm_s2": 200.0,
            "following_error_mm": 1.0,
        }
    )
    return AxisChannel(axis, 0)


def step(start: int, end: int, begins_ns: int = 0, duration_ns: int = 100 * MS) -> PermittedStep:
    permitted = permit(
        from_counts=[start],
        to_counts=[end],
        measured_counts=[start],
        velocities_before=[0.0],
        begins_ns=begins_ns,
        duration_ns=duration_ns,
        limits=[LIMITS],
    )
    assert isinstance(permitted, PermittedStep)
    return permitted


def says(one: AxisChannel, statusword: int, position: int = 0, t_ns: int = 0) -> None:
    assert one.receive(pack("<Hih", statusword, position, 0), t_ns)


def sent(
    one: AxisChannel, t_ns: int = 0, following: PermittedStep | None = None
) -> tuple[int, int]:
    output = one.output(t_ns, following)
    assert output is not None
    controlword, target = unpack("<Hi", output)
    return controlword, target


def test_a_drive_that_nobody_wants_anything_of_is_sent_nothing() -> None:
    one = channel()
    says(one, DISABLED)
    assert one.output(0, None) is None


def test_a_drive_that_has_said_nothing_is_sent_nothing() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    assert one.output(0, None) is None


def test_its_words_are_kept_as_they_are() -> None:
    one = channel()
    assert one.receive(pack("<Hih", ENABLED, -123456, -250), 42)
    assert (one.state, one.position_counts) == (PowerState.OPERATION_ENABLED, -123456)
    assert (one.torque_permille, one.received_ns) == (-250, 42)


@pytest.mark.parametrize("data", [b"", bytes(7), bytes(9)])
def test_words_of_another_length_are_refused(data: bytes) -> None:
    one = channel()
    assert not one.receive(data, 0)
    assert one.received_ns is None


def test_enabling_goes_state_by_state_and_the_target_is_where_the_axis_stands() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    seen = []
    for position, word in enumerate((DISABLED, READY, SWITCHED_ON, ENABLED, FOLLOWING)):
        says(one, word, 1000 + position)
        seen.append(sent(one, following=step(0, 5000)))
    assert [controlword for controlword, _ in seen] == [0x06, 0x07, 0x0F, 0x0F, 0x0F]
    assert [target for _, target in seen[:4]] == [1000, 1001, 1002, 1003]


def test_while_the_brake_opens_the_target_stays_where_the_axis_sags_to() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, ENABLED, 500)
    says(one, ENABLED, 480, 20 * MS)
    assert not one.following
    assert sent(one)[1] == 480
    says(one, FOLLOWING, 480, 40 * MS)
    says(one, FOLLOWING, 470, 60 * MS)
    assert sent(one)[1] == 480


def test_a_drive_without_the_following_bit_counts_as_following_after_half_a_second() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, ENABLED, 0, 0)
    says(one, ENABLED, 0, 400 * MS)
    assert not one.following
    says(one, ENABLED, 0, 501 * MS)
    assert one.following


def test_an_axis_waits_until_the_others_can_be_enabled() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    one.waits_for_others = True
    says(one, SWITCHED_ON)
    assert sent(one)[0] == 0x07
    one.waits_for_others = False
    assert sent(one)[0] == 0x0F


def test_a_followed_step_is_met_point_by_point_and_its_end_is_held() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING, 0)
    one_step = step(0, 1000)
    assert [sent(one, t, one_step)[1] for t in (0, 50 * MS, 100 * MS, 500 * MS)] == [
        0,
        500,
        1000,
        1000,
    ]
    assert sent(one, 600 * MS)[1] == 1000


def test_an_axis_that_was_disabled_does_not_remember_its_old_target() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING, 0)
    sent(one, 200 * MS, step(0, 1000))
    says(one, FAULT, 700)
    assert one.output(0, None) is None
    one.begin_fault_reset(0)
    assert [sent(one)[0] for _ in range(5)] == [0x00, 0x00, 0x80, 0x80, 0x00]
    assert one.goal is PowerGoal.OFF
    one.set_goal(PowerGoal.ENABLED, 0)
    for word in (DISABLED, READY, SWITCHED_ON, FOLLOWING):
        says(one, word, 640)
        assert sent(one)[1] == 640


def test_a_drive_that_does_not_do_what_it_is_told_is_unwilling_after_two_seconds() -> None:
    one = channel()
    says(one, SWITCHED_ON)
    one.set_goal(PowerGoal.ENABLED, 0)
    assert not one.is_unwilling(1999 * MS)
    assert one.is_unwilling(2001 * MS)
    says(one, FOLLOWING)
    assert not one.is_unwilling(2001 * MS)


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (PowerGoal.OFF, {FOLLOWING: 0x00, SWITCHED_ON: 0x00, FAULT: 0x00}),
        (PowerGoal.QUICK_STOP, {FOLLOWING: 0x02, 0x617: 0x02, DISABLED: 0x00}),
        (PowerGoal.STANDBY, {FOLLOWING: 0x06, DISABLED: 0x06}),
    ],
)
def test_other_goals(goal: PowerGoal, words: dict[int, int]) -> None:
    one = channel()
    one.set_goal(goal, 0)
    for statusword, controlword in words.items():
        says(one, statusword)
        assert sent(one)[0] == controlword
        assert not one.following


def test_a_drive_that_stopped_by_itself_is_not_enabled_again_by_itself() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING)
    says(one, DISABLED)
    assert one.goal is None
    says(one, READY)
    assert one.output(0, None) is None


def test_after_it_is_forgotten_it_has_to_speak_first() -> None:
    one = channel()
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING)
    one.forget()
    assert (one.goal, one.state, one.following) == (None, PowerState.UNKNOWN, False)
    assert one.output(0, None) is None


@pytest.mark.parametrize("mode", ["csv", "pv"])
def test_a_velocity_drive_gets_the_steps_velocity_and_is_led_back_to_its_line(mode: str) -> None:
    one = channel(mode)
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING, 0)
    one_step = step(0, 1000)
    assert sent(one, 0, one_step)[1] == 10_000
    says(one, FOLLOWING, 490)
    assert sent(one, 50 * MS, one_step)[1] == 10_000 + 50
    says(one, FOLLOWING, 1010)
    assert sent(one, 200 * MS, one_step)[1] == -50


def test_a_velocity_is_bounded_and_in_the_drives_own_unit() -> None:
    one = channel("csv", velocity_unit_counts_s=10.0)
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING, 0)
    assert sent(one, 0, step(0, 1000))[1] == 1000
    says(one, FOLLOWING, -(10**8))
    assert sent(one, 0, step(0, 1000))[1] == 2000


def test_profile_positions_are_handed_over_one_by_one_and_the_newest_wins() -> None:
    one = channel("pp")
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, ENABLED, 0)
    new, immediately, acknowledged = 1 << 4, 1 << 5, 1 << 12
    assert sent(one) == (0x0F | immediately, 0)
    assert sent(one, 0, step(0, 100)) == (0x0F | immediately | new, 100)
    assert sent(one, 0, step(100, 200)) == (0x0F | immediately | new, 100)
    says(one, ENABLED | acknowledged, 0)
    assert sent(one, 0, step(200, 300)) == (0x0F | immediately, 100)
    assert sent(one, 0, step(300, 400)) == (0x0F | immediately, 100)
    says(one, ENABLED, 0)
    assert sent(one) == (0x0F | immediately | new, 400)
