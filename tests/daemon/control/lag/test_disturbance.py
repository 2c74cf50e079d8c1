"""What takes the tip off more and more is led ahead; noise is not, nor what came at once."""

import numpy as np

from daemon.control.lag.disturbance import Disturbance
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


def test_what_grows_is_expected_to_go_on_growing() -> None:
    t_s = DT_S * np.arange(80)[:, None]
    change = shown(t_s * np.array([[8.0, 0.0, -6.0]])).change_mm(LAG_S)
    # A slope of 10 mm/s is believed to 1 - 2²/10².
    np.testing.assert_allclose(change, 0.96 * LAG_S * np.array([8.0, 0.0, -6.0]), rtol=1e-9)


def test_noise_and_a_little_are_not_led() -> None:
    noise = 0.25 * np.random.default_rng(3).normal(size=(400, 3))
    sizes = [float(np.linalg.norm(shown(noise[:k]).change_mm(LAG_S))) for k in range(100, 400, 10)]
    assert np.mean(sizes) < 0.2
    slow = DT_S * np.arange(80)[:, None] * np.array([[1.5, 0.0, 0.0]])
    assert not shown(slow).change_mm(LAG_S).any()


def test_nothing_is_expected_before_enough_is_seen() -> None:
    t_s = DT_S * np.arange(15)[:, None]
    assert not shown(t_s * np.array([[20.0, 0.0, 0.0]])).change_mm(LAG_S).any()


def test_a_jump_is_no_slope_and_the_way_back_from_it_ends() -> None:
    off = np.zeros((120, 3))
    off[60:, 0] = 14.0
    at_once, later = shown(off[:62]), shown(off)
    assert at_once.jumped(61 * DT_S)
    assert not at_once.change_mm(LAG_S).any()
    assert not later.change_mm(LAG_S).any()
    assert later.just_jumped(60 * DT_S + 1.3)
    assert not later.just_jumped(60 * DT_S + 1.8)
    assert later.jumped(60 * DT_S + 1.9)
    assert not later.jumped(60 * DT_S + 2.5)


def test_what_is_told_otherwise_than_it_comes_is_no_jump() -> None:
    told = np.zeros((80, 3))
    told[:, 0] = 60.0 * DT_S * np.arange(80)
    assert not shown(-0.3 * told, told).jumped(79 * DT_S)


def test_motion_that_begins_anew_knows_of_no_jump() -> None:
    off = np.zeros((70, 3))
    off[60:, 0] = 14.0
    disturbance = shown(off)
    disturbance.begin()
    assert not disturbance.jumped(70 * DT_S)
    assert not disturbance.just_jumped(70 * DT_S)
