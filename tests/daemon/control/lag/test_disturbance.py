"""A tip that was taken off at once is known as such, once, and until it is back."""

import numpy as np
import pytest

from daemon.control.lag.disturbance import Disturbance, Jump
from drivers.pose import Vector

DT_S = 0.025
LAG_S = 0.5


def shown(off_mm: Vector, told_mm: Vector | None = None) -> Disturbance:
    """(n, 3) step by step."""
    disturbance = Disturbance()
    told = np.zeros_like(off_mm) if told_mm is None else told_mm
    for k, (off, arrived) in enumerate(zip(off_mm, told, strict=True)):
        disturbance.add(k * DT_S, off, arrived, LAG_S)
    return disturbance


def test_a_jump_is_noticed_once_and_the_way_back_from_it_ends() -> None:
    off = np.zeros((120, 3))
    off[60:, 0] = 14.0
    disturbance, still = Disturbance(), np.zeros(3)
    jumps = [disturbance.add(k * DT_S, place, still, LAG_S) for k, place in enumerate(off)]
    [(noticed, jump)] = [(k, jump) for k, jump in enumerate(jumps) if jump is not None]
    assert noticed == 60
    assert jump.from_mm.tolist() == [0.0, 0.0, 0.0]
    assert jump.by_mm.tolist() == [14.0, 0.0, 0.0]
    later = shown(off)
    assert later.just_jumped(60 * DT_S + 1.3)
    assert not later.just_jumped(60 * DT_S + 1.8)
    assert later.jumped(60 * DT_S + 1.9)
    assert not later.jumped(60 * DT_S + 2.5)


def test_what_is_told_otherwise_than_it_comes_is_no_jump() -> None:
    told = np.zeros((80, 3))
    told[:, 0] = 60.0 * DT_S * np.arange(80)
    assert not shown(-0.3 * told, told).jumped(79 * DT_S)


def test_a_body_that_goes_twice_as_far_as_told_all_the_time_is_not_pushed() -> None:
    """A load made it soft: what it is off by, it was off by before, and turns with the path."""
    angle = 29.0 / 28.0 * DT_S * np.arange(240)
    path = 14.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(240)])
    assert not shown(path, path).jumped(239 * DT_S)
    loaded = path.copy()
    loaded[180:, 2] += 12.0
    assert shown(loaded, path).jumped(239 * DT_S)


def test_a_tip_that_is_off_to_and_fro_was_not_pushed() -> None:
    """By 3 mm one way and then the other: the difference is 6 mm, and nothing was as far off."""
    times = DT_S * np.arange(240)
    off = 1.6 * np.sin(2.0 * np.pi * times / 0.6)[:, None] * np.array([0.8, 0.6, 0.0])
    for k in range(240):
        assert not shown(off[: k + 1]).jumped(k * DT_S)
    pushed = off.copy()
    pushed[200:, 2] += 12.0
    assert shown(pushed).jumped(239 * DT_S)


def test_noise_and_what_grows_slowly_are_no_jump() -> None:
    noise = 0.3 * np.random.default_rng(3).normal(size=(400, 3))
    assert not shown(noise).jumped(400 * DT_S)
    slow = DT_S * np.arange(80)[:, None] * np.array([[8.0, 0.0, -6.0]])
    assert not shown(slow).jumped(80 * DT_S)


def test_motion_that_begins_anew_knows_of_no_jump() -> None:
    off = np.zeros((70, 3))
    off[60:, 0] = 14.0
    disturbance = shown(off)
    disturbance.begin()
    assert not disturbance.jumped(70 * DT_S)
    assert not disturbance.just_jumped(70 * DT_S)


REST_MM = np.array([0.0, 0.0, 210.0])


def on_a_circle(turns: float) -> Vector:
    angle = 2.0 * np.pi * turns
    return np.array([30.0 * np.cos(angle), 30.0 * np.sin(angle), 185.0])


def scaled(place_mm: Vector, share: float) -> Jump:
    """All of the body's ways from its rest become so much longer."""
    return Jump(place_mm, share * (place_mm - REST_MM))


@pytest.mark.parametrize("ratio", [0.6, 1.6], ids=["stiffer with it", "softer with it"])
@pytest.mark.parametrize("turns", [0.0, 0.1, 0.3, 0.5, 0.9])
def test_a_load_that_is_taken_off_elsewhere_undoes_what_hanging_it_on_did(
    ratio: float, turns: float
) -> None:
    on = scaled(on_a_circle(0.0), ratio - 1.0)
    off = scaled(on_a_circle(turns), 1.0 / ratio - 1.0)
    more = scaled(on_a_circle(turns), ratio - 1.0)
    for known in (0.9 * ratio + 0.1, ratio, 1.1 * ratio - 0.1):
        assert off.undoes(on, known)
        assert not more.undoes(on, known)


def test_a_force_that_changes_no_gain_is_undone_by_its_opposite() -> None:
    pushed = Jump(on_a_circle(0.0), np.array([0.0, 0.0, -9.0]))
    released = Jump(on_a_circle(0.4), np.array([0.0, 0.5, 8.0]))
    aside = Jump(on_a_circle(0.4), np.array([0.0, 8.0, 0.5]))
    assert released.undoes(pushed, 1.01)
    assert not aside.undoes(pushed, 1.01)
    assert not pushed.undoes(pushed, 1.01)


def test_a_heavier_load_is_not_the_one_that_was_taken_off_before() -> None:
    off = scaled(on_a_circle(0.0), 1.0 / 1.7 - 1.0)
    again, heavier = scaled(on_a_circle(0.4), 0.7), scaled(on_a_circle(0.4), 2.0)
    assert again.undoes(off, 1.0 / 1.7)
    assert not heavier.undoes(off, 1.0 / 1.7)
