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


def test_a_fault_reset_that_was_cut_short_does_not_reset_a_later_fault() -> None:
    one = channel()
    says(one, FAULT)
    one.begin_fault_reset(0)
    assert sent(one)[0] == 0x00
    one.forget()
    says(one, FAULT)
    one.set_goal(PowerGoal.OFF, 0)
    assert {sent(one)[0] for _ in range(10)} == {0x00}


VELOCITY_MODES = pytest.mark.parametrize("mode", ["csv", "pv"])


def velocities(one: AxisChannel, following: PermittedStep, *at_ms: int) -> list[int]:
    return [sent(one, t_ms * MS, following)[1] for t_ms in at_ms]


def enabled_at(mode: str, position: int, **drive: Any) -> AxisChannel:
    one = channel(mode, **drive)
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING, position)
    return one


@VELOCITY_MODES
def test_a_velocity_drive_is_brought_to_the_steps_velocity_and_led_back_to_its_line(
    mode: str,
) -> None:
    one = enabled_at(mode, 50_000)
    one_step = step(50_000, 51_000)
    # 2000 more in each cycle of 10 ms is what the axis may accelerate.
    assert velocities(one, one_step, 0, 10, 20, 30, 40) == [0, 2000, 4000, 6000, 8000]
    says(one, FOLLOWING, 50_490)
    assert velocities(one, one_step, 50, 60) == [10_000, 10_000 + 5 * 110]
    says(one, FOLLOWING, 51_010)  # 10 further than the step leads
    assert velocities(one, one_step, 200, 210, 220, 230, 240) == [6550, 4550, 2550, 550, -5 * 10]


@VELOCITY_MODES
def test_frames_that_are_sent_twice_for_one_sync_accelerate_once(mode: str) -> None:
    one = enabled_at(mode, 50_000)
    one_step = step(50_000, 51_000)
    assert velocities(one, one_step, 0, 10, 10, 10, 20) == [0, 2000, 2000, 2000, 4000]


def test_after_a_gap_a_velocity_changes_by_no_more_than_in_the_longest_cycle() -> None:
    one = enabled_at("csv", 50_000)
    one_step = step(50_000, 51_000)
    assert velocities(one, one_step, 0, 90) == [0, 4000]


def test_a_velocity_is_bounded_and_in_the_drives_own_unit() -> None:
    one = enabled_at("csv", 10_000, velocity_unit_counts_s=10.0)
    far = step(90_000, 91_000)
    assert velocities(one, far, *range(0, 200, 10))[-1] == 2000  # 20000 counts/s


@VELOCITY_MODES
def test_a_velocity_leaves_the_way_to_stop_if_it_is_the_last_that_is_heard(mode: str) -> None:
    one = enabled_at(mode, 99_000, setpoint_timeout_s=0.1)
    far = step(200_000, 200_000, 0, 10_000 * MS)
    heard = velocities(one, far, *range(0, 300, 10))[-1]
    goes_on, brakes = heard * 0.1, heard * heard / (2 * 200_000)
    assert goes_on + brakes + heard * 0.02 == pytest.approx(1000.0, abs=0.2)
    says(one, FOLLOWING, 100_001)
    assert velocities(one, far, 310)[0] <= 0


@VELOCITY_MODES
def test_a_drive_that_waits_for_set_points_is_not_left_without_a_word(mode: str) -> None:
    one = channel(mode)
    says(one, DISABLED)
    assert one.output(0, None) is None  # nobody has wanted anything of it
    one.set_goal(PowerGoal.ENABLED, 0)
    says(one, FOLLOWING)
    sent(one)
    says(one, FAULT)
    assert one.goal is None
    assert sent(one) == (0x00, 0)
    quick_stop_active = 0x617
    says(one, quick_stop_active)
    assert sent(one) == (0x02, 0)
    says(one, READY)
    assert sent(one) == (0x06, 0)
    says(one, SWITCHED_ON)
    assert sent(one) == (0x07, 0)
    says(one, ENABLED)
    assert one.output(0, None) is None, "what enables a drive again is somebody's decision"
    one.forget()
    says(one, DISABLED)
    assert one.output(0, None) is None


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
