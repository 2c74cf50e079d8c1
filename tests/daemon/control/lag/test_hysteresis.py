"""A body's hysteresis is found while it is followed, and what sticks is not told to have come."""

import numpy as np
import pytest

from daemon.control.lag.body_lag import BodyLag
from daemon.control.lag.hysteresis import Hysteresis
from daemon.learning.forward.stop_operators import HeldBack, StopOperators
from drivers.pose import Vector

DT_S = 0.025
TRAVEL = np.full(3, 50.0)
JACOBIAN = np.array([[3.0, 0.4, 0.0], [0.2, 4.0, -0.5], [0.0, 0.3, 1.0]])
NOISE_MM = 0.15


def turning(t_s: float) -> Vector:
    return np.asarray(25.0 + 12.0 * np.sin(t_s * np.array([0.9, 1.1, 0.7])))


def straight(t_s: float) -> Vector:
    """From end to end in twenty seconds."""
    return np.asarray(1.0 + 2.4 * t_s * np.array([1.0, 0.9, 0.8]))


def to_and_fro(t_s: float) -> Vector:
    """Steps of a millimetre, a second apart."""
    return np.asarray(25.0 + np.array([1.0, -1.0, 1.0]) * (int(t_s) % 2))


def lag_of(lag_s: float) -> BodyLag:
    return BodyLag(lag_s)


class Arm:
    """A linear one that holds back `share`, and makes `gain` of what is left."""

    def __init__(self, share: float, gain: float = 1.0) -> None:
        self._stops, self._share, self._gain = StopOperators(), share, gain
        self._first: Vector | None = None
        self._random = np.random.default_rng(1)

    def seen(self, u: Vector) -> Vector:
        if self._first is None:
            self._first = u
        free = u - self._share * self._stops.follow(u / TRAVEL) * TRAVEL
        tip = self._gain * JACOBIAN @ (free - self._first)
        return np.asarray(tip + NOISE_MM * self._random.normal(size=3))


def followed(
    hysteresis: Hysteresis, arm: Arm, way: object, duration_s: float, probes: bool = False
) -> Hysteresis:
    assert callable(way)
    before = way(0.0)
    for k in range(round(duration_s / DT_S)):
        t_s = k * DT_S
        targets = way(t_s)
        hysteresis.follow(targets, DT_S)
        hysteresis.moved_mm(JACOBIAN @ (targets - before), JACOBIAN)
        before, tip_mm = targets, arm.seen(targets)
        if probes:
            hysteresis.see_probe(t_s, DT_S, tip_mm)
        else:
            hysteresis.learn(t_s, DT_S, tip_mm, lag_of(0.0))
    if probes:
        hysteresis.end_probe(lag_of(0.0))
    return hysteresis


def expected(share: float = 0.15) -> Hysteresis:
    return Hysteresis(HeldBack(share, TRAVEL))


@pytest.mark.parametrize("share", [0.0, 0.15, 0.3, 0.45])
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.15])
def test_a_path_that_turns_tells_how_much_is_held_back_whatever_the_gain(
    share: float, gain: float
) -> None:
    found = followed(expected(), Arm(share, gain), turning, 20.0)
    assert found.share == pytest.approx(share, abs=0.03)


def test_a_way_without_turns_tells_nothing_of_it() -> None:
    """A tip that goes less far than told is then one with another gain."""
    found = followed(expected(), Arm(0.15, gain=0.7), straight, 15.0)
    assert found.share == pytest.approx(0.15, abs=0.06)


def test_small_motions_to_and_fro_and_the_way_after_them_tell_it_together() -> None:
    arm, hysteresis = Arm(0.35, gain=0.95), expected()
    followed(hysteresis, arm, to_and_fro, 4.0, probes=True)
    found = followed(hysteresis, arm, lambda t_s: to_and_fro(3.9) + 1.5 * t_s, 8.0)
    assert found.share == pytest.approx(0.35, abs=0.1)


def test_before_anything_is_seen_it_is_as_pre_training_told_it() -> None:
    hysteresis = expected(0.2)
    hysteresis.learn(0.0, DT_S, np.zeros(3), lag_of(0.1))
    assert hysteresis.share == 0.2


def test_an_axis_that_goes_on_shows_all_of_its_motion_and_one_that_turned_less() -> None:
    hysteresis = expected(0.2)
    for place in [*np.linspace(0.0, 45.0, 200), *np.linspace(45.0, 43.0, 40)]:
        hysteresis.follow(np.array([place, min(place, 44.0), 45.0]), DT_S)
    turned, _, still = hysteresis.shown
    assert turned == pytest.approx(0.8, abs=0.051)
    assert still == pytest.approx(0.8), "all of a first motion sticks, either way"
    for place in np.linspace(0.0, 45.0, 200):
        hysteresis.follow(np.array([45.0, 45.0, place]), DT_S)
    assert hysteresis.shown[2] == pytest.approx(1.0)


def test_what_sticks_is_not_told_to_have_come() -> None:
    hysteresis = expected(0.2)
    arm, before, told = Arm(0.2), turning(0.0), np.zeros(3)
    for k in range(400):
        targets = turning(k * DT_S)
        hysteresis.follow(targets, DT_S)
        told = told + hysteresis.moved_mm(JACOBIAN @ (targets - before), JACOBIAN)
        before, tip_mm = targets, arm.seen(targets)
    np.testing.assert_allclose(tip_mm, told, atol=4.0 * NOISE_MM)
    by_axes = JACOBIAN @ (hysteresis.free(before) - turning(0.0))
    np.testing.assert_allclose(by_axes, told, atol=1e-9)


def test_what_pre_training_told_nothing_of_is_not_looked_for() -> None:
    """Receptive fields were learnt with what was held back in them."""
    arm, unknown = Arm(0.35), Hysteresis(HeldBack(None, TRAVEL))
    followed(unknown, arm, to_and_fro, 4.0, probes=True)
    found = followed(unknown, arm, turning, 20.0)
    assert found.share == 0.0
    np.testing.assert_array_equal(found.shown, np.ones(3))
