"""Dead-man, clutch, scale, leash: where a hand leads the tip."""

from math import cos, isclose, pi, sin, sqrt

import pytest

from daemon.steering.hand import Hand, HandSettings, Target, direction_of
from daemon.steering.input_events import EV_KEY, EV_REL, InputEvent
from tests.daemon.steering.scripted import (
    CLUTCH,
    CLUTCH_OUT,
    DEAD_MAN,
    LET_GO,
    PERIOD_NS,
    TIP,
    Bench,
    push,
)

RIGHT = push(0, 350)


def at(target: Target | None) -> tuple[float, float, float]:
    assert target is not None
    return target.position_mm


def test_nothing_is_asked_for_before_the_dead_man_is_held() -> None:
    bench = Bench()
    assert bench.steps(10, RIGHT) is None


def test_a_target_begins_where_the_tip_is() -> None:
    bench = Bench()
    assert at(bench.step(DEAD_MAN, RIGHT)) == TIP


def test_the_target_goes_on_as_fast_as_the_device_is_pushed() -> None:
    bench = Bench(HandSettings(speed_mm_s=8.0))
    bench.step(DEAD_MAN)
    x, y, z = at(bench.steps(20, RIGHT))
    assert (x - TIP[0], y, z) == pytest.approx((8.0 * 20 * 0.025, TIP[1], TIP[2]))


def test_let_go_means_silence_at_once() -> None:
    bench = Bench()
    bench.step(DEAD_MAN)
    bench.steps(10, RIGHT)
    assert bench.step(LET_GO, RIGHT) is None
    assert bench.steps(10, RIGHT) is None


def test_pressed_again_it_begins_anew_where_the_tip_is_then() -> None:
    bench = Bench()
    bench.step(DEAD_MAN)
    bench.steps(20, RIGHT)
    bench.step(LET_GO)
    bench.tip = (11.0, 22.0, 155.0)
    assert at(bench.step(DEAD_MAN)) == bench.tip


def test_with_the_clutch_the_hand_goes_and_the_target_stays() -> None:
    bench = Bench()
    bench.step(DEAD_MAN)
    before = at(bench.steps(20, RIGHT))
    assert at(bench.step(CLUTCH)) == before
    assert at(bench.steps(40, RIGHT)) == before
    x, _, _ = at(bench.step(CLUTCH_OUT, RIGHT))
    assert 0.0 < x - before[0] < 0.3


def test_a_mouse_is_put_back_with_the_clutch_and_goes_on_from_there() -> None:
    """Each stroke moves the target, the ways back do not: so it goes farther than the desk."""
    bench = Bench(HandSettings(scale=0.1, leash_mm=1e3), "mouse")
    bench.step(InputEvent(EV_KEY, 0x110, 1))
    target = None
    for _ in range(5):
        bench.step(InputEvent(EV_REL, 0, 400))
        bench.step(InputEvent(EV_KEY, 0x111, 1))
        bench.step(InputEvent(EV_REL, 0, -400))
        target = bench.step(InputEvent(EV_KEY, 0x111, 0))
    assert at(target)[0] - TIP[0] == pytest.approx(5 * 0.1 * 25.4)


def test_the_target_is_never_farther_ahead_than_the_leash() -> None:
    bench = Bench(HandSettings(leash_mm=3.0))
    bench.step(DEAD_MAN)
    x, y, z = at(bench.steps(200, RIGHT, push(1, -350)))
    away = sqrt((x - TIP[0]) ** 2 + (y - TIP[1]) ** 2 + (z - TIP[2]) ** 2)
    assert away == pytest.approx(3.0)


def test_a_stalled_program_does_not_make_up_for_what_it_missed() -> None:
    bench = Bench(HandSettings(speed_mm_s=10.0, leash_mm=1e3))
    bench.step(DEAD_MAN)
    bench.step(RIGHT)
    before = at(bench.step(RIGHT))
    bench.t_ns += 3_000_000_000
    assert at(bench.step(RIGHT))[0] - before[0] <= 1.0 + 1e-9


def test_without_a_tip_there_is_no_target() -> None:
    bench = Bench()
    bench.step(DEAD_MAN)
    bench.steps(5, RIGHT)
    for _ in range(18):
        bench.t_ns += PERIOD_NS
        assert bench.station.advance(bench.t_ns) is not None
    bench.t_ns += 5 * PERIOD_NS
    assert bench.station.advance(bench.t_ns) is None


def test_a_tip_that_is_no_place_is_not_taken() -> None:
    hand = Hand(HandSettings())
    hand.tip(0, (float("nan"), 0.0, 0.0), None)
    assert hand.advance(1, True, False, (0.0,) * 6) is None


def test_unplugged_it_is_let_go() -> None:
    bench = Bench()
    bench.step(DEAD_MAN)
    bench.station.unplugged()
    assert bench.step() is None
    assert bench.station.gone


def test_a_target_that_is_refused_is_taken_back() -> None:
    """At the edge of the workspace the hand stands at the last place that was followed."""
    bench = Bench(HandSettings(leash_mm=1e3))
    bench.step(DEAD_MAN)
    targets = [bench.step(RIGHT) for _ in range(6)]
    refused = targets[3]
    assert refused is not None
    bench.station.refused(refused.sequence)
    again = bench.step(RIGHT)
    assert again is not None
    assert again.position_mm == at(targets[2])
    assert again.sequence == at_number(targets[5]) + 1
    bench.station.refused(12345)
    stood = at(bench.steps(20, RIGHT, push(1, -350)))
    assert stood[0] == pytest.approx(at(targets[2])[0])
    assert stood[1] > TIP[1] + 3.0, "along the wall it goes on"
    assert at(bench.steps(4, push(0, -350)))[0] < stood[0] - 0.5
    assert at(bench.steps(110, RIGHT))[0] > stood[0] + 0.5, "whether the wall stands is tried anew"


def at_number(target: Target | None) -> int:
    assert target is not None
    return target.sequence


@pytest.mark.parametrize(
    ("axes", "expected"),
    [("+x+y+z", (1.0, 0.0, 0.0)), ("-y+x+z", (0.0, -1.0, 0.0)), ("+z-y+x", (0.0, 0.0, 1.0))],
)
def test_the_hands_right_leads_where_it_is_said_to(
    axes: str, expected: tuple[float, float, float]
) -> None:
    bench = Bench(HandSettings(speed_mm_s=10.0, axes=axes))
    bench.step(DEAD_MAN)
    found = at(bench.step(RIGHT))
    way = tuple(b - a for a, b in zip(TIP, found, strict=True))
    assert way == pytest.approx(tuple(0.25 * one for one in expected))


@pytest.mark.parametrize("axes", ["", "xyz", "+x+y+y", "+x+y+z+x", "*x+y+z"])
def test_axes_that_are_none_are_refused(axes: str) -> None:
    with pytest.raises(ValueError, match="axes are such as"):
        HandSettings(axes=axes)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["speed_mm_s", "turn_rad_s", "scale", "leash_mm", "leash_rad"])
def test_settings_that_make_no_sense_are_refused(name: str, wrong: float) -> None:
    with pytest.raises(ValueError, match="finite and more than 0"):
        HandSettings(**{name: wrong})  # type: ignore[arg-type]


# Pointing.


def test_the_direction_is_asked_for_where_it_is_steered_alone() -> None:
    for pointing in (False, True):
        bench = Bench(HandSettings(pointing=pointing))
        target = bench.step(DEAD_MAN)
        assert target is not None
        assert (target.direction is not None) == pointing


def test_a_direction_turns_as_fast_as_the_device_is_turned_and_stays_of_unit_length() -> None:
    bench = Bench(HandSettings(pointing=True, turn_rad_s=0.4, leash_rad=1.0))
    bench.step(DEAD_MAN)
    target = bench.steps(40, push(3, 350))
    assert target is not None
    assert target.direction is not None
    x, y, z = target.direction
    angle = 0.4 * 40 * 0.025
    assert (x, y, z) == pytest.approx((0.0, -sin(angle), cos(angle)))
    assert isclose(x * x + y * y + z * z, 1.0, rel_tol=1e-12)


def test_rolling_about_the_direction_changes_nothing() -> None:
    bench = Bench(HandSettings(pointing=True))
    bench.step(DEAD_MAN)
    target = bench.steps(40, push(5, 350))
    assert target is not None
    assert target.direction == pytest.approx((0.0, 0.0, 1.0))


def test_the_direction_has_a_leash_too() -> None:
    bench = Bench(HandSettings(pointing=True, leash_rad=0.1))
    bench.step(DEAD_MAN)
    target = bench.steps(400, push(3, 350))
    assert target is not None
    assert target.direction is not None
    assert target.direction[1] == pytest.approx(-sin(0.1))


def test_a_tip_whose_direction_nobody_knows_is_led_without() -> None:
    bench = Bench(HandSettings(pointing=True))
    bench.direction = None
    target = bench.step(DEAD_MAN)
    assert target is not None
    assert target.direction is None


@pytest.mark.parametrize(
    ("quaternion", "direction"),
    [
        ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((cos(pi / 4), sin(pi / 4), 0.0, 0.0), (0.0, -1.0, 0.0)),
        ((2.0, 0.0, 2.0, 0.0), (1.0, 0.0, 0.0)),
    ],
)
def test_the_direction_of_a_pose_is_its_z_axis(
    quaternion: tuple[float, float, float, float], direction: tuple[float, float, float]
) -> None:
    found = direction_of(quaternion)
    assert found == pytest.approx(direction, abs=1e-12)
    assert direction_of((0.0, 0.0, 0.0, 0.0)) is None
    assert direction_of((float("nan"), 0.0, 0.0, 0.0)) is None
