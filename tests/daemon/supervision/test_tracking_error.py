"""Who leads the tip away from its reference, or nowhere, is noticed; who only comes late is not."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from config.loader import load_robot
from config.robot import Robot
from daemon.supervision.tracking_error import TrackingError
from tests import SHIPPED_ROBOTS, SOFT_ARM

TENDON_ARM = SHIPPED_ROBOTS / "tendon_arm.yaml"
ALLOWED_MM, PATIENCE_S = 7.0, 4.0
NOISE_MM = 0.15
FRAMES_HZ = 40
Course = Callable[[float], tuple[float, float, float]]
"""Of the time in seconds: a place in mm."""


def monitor() -> TrackingError:
    return TrackingError(ALLOWED_MM, PATIENCE_S)


def alarm_s(
    tip: Course, reference: Course, lasts_s: float, look: TrackingError | None = None
) -> tuple[float, str]:
    """When it is raised, and what is said; infinite if it never is."""
    judge, noise = look or monitor(), np.random.default_rng(1)
    for frame in range(round(lasts_s * FRAMES_HZ)):
        t_s = frame / FRAMES_HZ
        seen = (np.array(tip(t_s)) + NOISE_MM * noise.normal(size=3)).tolist()
        told = judge.look(round(t_s * 1e9), seen, reference(t_s))
        if told:
            return t_s, told
    return math.inf, ""


def stays(t_s: float) -> tuple[float, float, float]:
    del t_s
    return 0.0, 0.0, 0.0


def circle(radius_mm: float, speed_mm_s: float, late_s: float = 0.0) -> Course:
    def at(t_s: float) -> tuple[float, float, float]:
        angle = speed_mm_s / radius_mm * max(t_s - late_s, 0.0)
        return radius_mm * math.cos(angle), radius_mm * math.sin(angle), 0.0

    return at


def simulated(
    gain_per_s: float,
    reference: Course,
    lag_s: float = 0.1,
    dead_s: float = 0.0,
    push: Course = stays,
    lasts_s: float = 60.0,
    fastest_mm_s: float = 25.0,
) -> Course:
    """A controller that goes by the error, and a body that comes late."""
    step_s = 1.0 / FRAMES_HZ
    told, body = np.array(reference(0.0)), np.array(reference(0.0))
    queue = [told.copy() for _ in range(round(dead_s / step_s) + 1)]
    pushed, course = np.array(push(0.0)), []
    for frame in range(round(lasts_s / step_s)):
        t_s = frame * step_s
        pushed += (np.array(push(t_s)) - pushed) * min(step_s / lag_s, 1.0)
        course.append(body + pushed)
        wanted = gain_per_s * (np.array(reference(t_s)) - course[-1])
        length = float(np.linalg.norm(wanted))
        told = told + wanted * min(1.0, fastest_mm_s / max(length, 1e-9)) * step_s
        queue.append(told)
        body = body + (queue.pop(0) - body) * min(step_s / lag_s, 1.0)

    def at(t_s: float) -> tuple[float, float, float]:
        x, y, z = course[min(round(t_s / step_s), len(course) - 1)].tolist()
        return x, y, z

    return at


# Who runs away.


@pytest.mark.parametrize("speed_mm_s", [0.0, 2.0, 10.0, 20.0])
def test_who_leads_the_wrong_way_is_noticed_within_centimetres(speed_mm_s: float) -> None:
    reference = circle(40.0, speed_mm_s)
    off = simulated(-3.0, reference, push=lambda t_s: (0.5, 0.0, 0.0))
    when_s, told = alarm_s(off, reference, 30.0)
    error_mm = math.dist(off(when_s), reference(when_s))
    assert error_mm < 20.0 + speed_mm_s
    assert re.fullmatch(r"the tip goes away from its reference, \d+ mm by now", told)


@pytest.mark.parametrize("gain_per_s", [-0.6, -1.0])
@pytest.mark.parametrize(("lag_s", "dead_s"), [(0.1, 0.0), (0.2, 0.05), (0.5, 0.25)])
def test_who_leads_a_slow_body_the_wrong_way_is_noticed(
    gain_per_s: float, lag_s: float, dead_s: float
) -> None:
    reference = circle(40.0, 10.0)
    off = simulated(gain_per_s, reference, lag_s, dead_s)
    when_s, _ = alarm_s(off, reference, 30.0)
    assert math.dist(off(when_s), reference(when_s)) < 35.0


def test_who_goes_away_slowly_is_noticed_in_half_the_time_of_who_stands() -> None:
    def away(t_s: float) -> tuple[float, float, float]:
        return ALLOWED_MM + 1.9 * t_s, 0.0, 0.0

    def stands(t_s: float) -> tuple[float, float, float]:
        del t_s
        return 15.0, 0.0, 0.0

    assert alarm_s(away, stays, 30.0)[0] == pytest.approx(PATIENCE_S / 2, abs=0.5)
    assert alarm_s(stands, stays, 30.0)[0] == pytest.approx(PATIENCE_S, abs=0.5)


@pytest.mark.parametrize("speed_mm_s", [1.9, 10.0, 20.0])
def test_who_does_nothing_at_all_is_noticed(speed_mm_s: float) -> None:
    when_s, _ = alarm_s(lambda _: (40.0, 0.0, 0.0), circle(40.0, speed_mm_s), 60.0)
    assert speed_mm_s * when_s < 2 * ALLOWED_MM + speed_mm_s * (PATIENCE_S + 2.0)


@pytest.mark.parametrize("period_s", [0.8, 2.0, 4.0])
@pytest.mark.parametrize("moves", [False, True])
def test_who_swings_farther_and_farther_is_noticed(period_s: float, moves: bool) -> None:
    reference = circle(40.0, 2.0) if moves else stays

    def swings(t_s: float) -> tuple[float, float, float]:
        x, y, z = reference(t_s)
        return x + math.exp(0.2 * t_s) * math.sin(2 * math.pi * t_s / period_s), y, z

    when_s, _ = alarm_s(swings, reference, 60.0)
    assert math.exp(0.2 * when_s) < 40.0


def test_who_goes_round_its_reference_farther_and_farther_is_noticed() -> None:
    def round_it(t_s: float) -> tuple[float, float, float]:
        radius_mm = math.exp(0.3 * t_s)
        return radius_mm * math.cos(2.0 * t_s), radius_mm * math.sin(2.0 * t_s), 0.0

    when_s, _ = alarm_s(round_it, stays, 60.0)
    assert math.exp(0.3 * when_s) < 6 * ALLOWED_MM


def test_swings_that_do_not_grow_any_more_are_noticed_and_named() -> None:
    def swings(t_s: float) -> tuple[float, float, float]:
        return 20.0 * math.sin(math.pi * t_s), 0.0, 0.0

    _, told = alarm_s(swings, stays, 30.0)
    assert told == "the tip swings about its reference, 20, 20, 20, 20 mm, one after the other"


# Who only comes late.


@pytest.mark.parametrize("jump_mm", [14.0, 28.0, 40.0])
@pytest.mark.parametrize(
    ("lag_s", "dead_s", "gain_per_s"), [(0.1, 0.0, 3.0), (0.2, 0.05, 2.0), (0.5, 0.25, 0.6)]
)
@pytest.mark.parametrize("speed_mm_s", [0.0, 10.0])
def test_a_load_that_is_hung_on_is_no_alarm(
    jump_mm: float, lag_s: float, dead_s: float, gain_per_s: float, speed_mm_s: float
) -> None:
    reference = circle(40.0, speed_mm_s)
    tip = simulated(
        gain_per_s, reference, lag_s, dead_s, lambda t_s: (0.0, 0.0, -jump_mm * (t_s >= 10.0))
    )
    assert max(math.dist(tip(0.1 * k), reference(0.1 * k)) for k in range(600)) > 0.6 * jump_mm
    assert alarm_s(tip, reference, 60.0) == (math.inf, "")


@pytest.mark.parametrize("rate_mm_s", [5.0, 20.0, 80.0])
def test_a_load_that_is_hung_on_by_hand_is_no_alarm(rate_mm_s: float) -> None:
    def push(t_s: float) -> tuple[float, float, float]:
        return 0.0, 0.0, -min(max(t_s - 10.0, 0.0) * rate_mm_s, 30.0)

    for reference in (stays, circle(40.0, 10.0)):
        tip = simulated(3.0, reference, push=push)
        assert alarm_s(tip, reference, 60.0) == (math.inf, "")


@pytest.mark.parametrize("late_s", [0.3, 0.95])
@pytest.mark.parametrize("speed_mm_s", [10.0, 20.0])
def test_a_late_body_that_goes_on_after_its_reference_has_turned_round_is_no_alarm(
    late_s: float, speed_mm_s: float
) -> None:
    def to_and_fro(t_s: float) -> tuple[float, float, float]:
        return abs((speed_mm_s * t_s) % 80.0 - 40.0), 0.0, 0.0

    def tip(t_s: float) -> tuple[float, float, float]:
        return to_and_fro(max(t_s - late_s, 0.0))

    assert alarm_s(tip, to_and_fro, 60.0) == (math.inf, "")


@pytest.mark.parametrize("load_s", [3.0, 6.0])
def test_loads_hung_on_and_taken_off_again_and_again_are_no_alarm(load_s: float) -> None:
    tip = simulated(3.0, stays, push=lambda t_s: (0.0, 0.0, -20.0 * (t_s % (2 * load_s) < load_s)))
    when_s, told = alarm_s(tip, stays, 60.0)
    assert when_s == math.inf, told


@pytest.mark.parametrize(("speed_mm_s", "late_s"), [(20.0, 1.5), (20.0, 0.95), (40.0, 1.0)])
def test_a_slow_body_is_late_and_no_alarm(speed_mm_s: float, late_s: float) -> None:
    """17 to 30 mm behind at 20 mm/s."""
    when_s, told = alarm_s(circle(50.0, speed_mm_s, late_s), circle(50.0, speed_mm_s), 120.0)
    assert when_s == math.inf, told


@pytest.mark.parametrize("speed_mm_s", [60.0, 126.0])
def test_a_reference_that_is_too_fast_for_the_axes_is_no_alarm(speed_mm_s: float) -> None:
    reference = circle(40.0, speed_mm_s)
    when_s, told = alarm_s(simulated(3.0, reference, lasts_s=60.0), reference, 60.0)
    assert when_s == math.inf, told


def test_set_points_that_jump_are_no_alarm() -> None:
    def jumps(t_s: float) -> tuple[float, float, float]:
        return 50.0 * (t_s % 10.0 >= 5.0), 0.0, 0.0

    when_s, told = alarm_s(simulated(2.0, jumps, 0.2), jumps, 60.0)
    assert when_s == math.inf, told


# What does not count.


def test_a_gap_of_the_tracker_counts_as_no_more_than_a_late_frame() -> None:
    judge = monitor()
    assert alarm_s(lambda _: (15.0, 0.0, 0.0), stays, PATIENCE_S - 0.5, judge)[1] == ""
    assert judge.look(100_000_000_000, (15.0, 0.0, 0.0), (0.0, 0.0, 0.0)) == ""


def test_what_hinders_stops_the_clock_and_does_not_set_it_back() -> None:
    judge, t_ns, alarm_ns = monitor(), 0, 0
    for frame in range(1000):
        t_ns = frame * 25_000_000
        if 80 <= frame < 800:
            judge.hinder()
        elif judge.look(t_ns, (15.0, 0.0, 0.0), (0.0, 0.0, 0.0)):
            alarm_ns = t_ns
            break
    assert alarm_ns * 1e-9 == pytest.approx(18.0 + PATIENCE_S, abs=0.2)


def test_each_motion_begins_anew() -> None:
    judge = monitor()
    for _ in range(5):
        assert alarm_s(lambda _: (15.0, 0.0, 0.0), stays, PATIENCE_S - 0.5, judge)[1] == ""
        judge.begin()


def test_what_is_no_number_is_left_to_others() -> None:
    judge = monitor()
    for frame in range(1000):
        assert judge.look(frame * 25_000_000, (math.nan, 0.0, 0.0), (0.0, 0.0, 0.0)) == ""


# What it goes by.


@pytest.mark.parametrize(("path", "allowed_mm"), [(SOFT_ARM, 7.06), (TENDON_ARM, 9.7)])
def test_without_a_word_the_workspace_says_how_far_is_far(path: Path, allowed_mm: float) -> None:
    robot = load_robot(path).robot
    assert told_beyond(robot, allowed_mm * 1.1)
    assert not told_beyond(robot, allowed_mm * 0.9)


def test_a_robot_file_may_say_it_and_need_not_have_a_workspace() -> None:
    robot = load_robot(SOFT_ARM).robot
    none = robot.model_copy(update={"workspace": None})
    assert told_beyond(none, 9.0)
    assert not told_beyond(none, 7.5)
    said = robot.supervision.model_copy(update={"tracking_error_mm": 3.0})
    assert told_beyond(robot.model_copy(update={"supervision": said}), 3.5)
    with pytest.raises(ValueError, match=r"not 0\.0 mm"):
        TrackingError(0.0, 1.0)


def told_beyond(robot: Robot, error_mm: float) -> bool:
    judge = TrackingError.of(robot)
    looks = [judge.look(k * 25_000_000, (error_mm, 0.0, 0.0), (0.0, 0.0, 0.0)) for k in range(300)]
    return any(looks)
