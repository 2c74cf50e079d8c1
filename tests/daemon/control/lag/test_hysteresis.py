"""A body's hysteresis is found while it is followed, and what sticks is not told to have come."""

from typing import Any

import numpy as np
import pytest

from daemon.control import tip_following
from daemon.control.lag.body_lag import BodyLag
from daemon.control.lag.hysteresis import Hysteresis
from daemon.learning.forward import stop_operator_kernels as kernels
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
        self._stops, self._gain = StopOperators(np.array([share])), gain
        self._first: Vector | None = None
        self._random = np.random.default_rng(1)

    def seen(self, u: Vector) -> Vector:
        if self._first is None:
            self._first = u
        free = self._stops.follow(u / TRAVEL)[0] * TRAVEL
        tip = self._gain * JACOBIAN @ (free - self._first)
        return np.asarray(tip + NOISE_MM * self._random.normal(size=3))


def followed(
    hysteresis: Hysteresis,
    arm: Arm,
    way: object,
    duration_s: float,
    probes: bool = False,
    on_path: bool = False,
) -> Hysteresis:
    assert callable(way)
    for k in range(round(duration_s / DT_S)):
        t_s = k * DT_S
        targets = way(t_s)
        hysteresis.follow(targets, DT_S)
        hysteresis.moved_mm(JACOBIAN)
        tip_mm = arm.seen(targets)
        if probes:
            hysteresis.see_probe(t_s, DT_S, tip_mm)
        else:
            hysteresis.learn(t_s, DT_S, tip_mm, lag_of(0.0), on_path)
    if probes:
        hysteresis.end_probe(lag_of(0.0))
    return hysteresis


def expected(share: float = 0.15) -> Hysteresis:
    return Hysteresis(HeldBack(share, np.zeros(3), TRAVEL))


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.9])
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.15])
def test_a_path_that_turns_tells_how_much_is_held_back_whatever_the_gain(
    share: float, gain: float
) -> None:
    found = followed(expected(), Arm(share, gain), turning, 20.0, on_path=True)
    assert found.share == pytest.approx(share, abs=0.05)


def test_a_way_without_turns_tells_nothing_of_it() -> None:
    """A tip that goes less far than told is then one with another gain."""
    found = followed(expected(), Arm(0.15, gain=0.7), straight, 15.0)
    assert found.share == pytest.approx(0.15, abs=0.16)


@pytest.mark.parametrize("gain", [0.97, 1.0, 1.03])
def test_small_motions_to_and_fro_tell_it_where_the_jacobian_is_about_right(gain: float) -> None:
    """Nothing slips in them: without trust in the Jacobian any gain would explain them as well."""
    found = followed(expected(), Arm(0.6, gain), to_and_fro, 6.0, probes=True)
    assert found.share == pytest.approx(0.6, abs=0.12)


def test_small_motions_to_and_fro_and_the_way_after_them_tell_it_together() -> None:
    arm, hysteresis = Arm(0.35, gain=0.95), expected()
    followed(hysteresis, arm, to_and_fro, 4.0, probes=True)
    found = followed(hysteresis, arm, lambda t_s: to_and_fro(3.9) + 1.5 * t_s, 8.0)
    assert found.share == pytest.approx(0.35, abs=0.1)


def test_before_anything_is_seen_it_is_as_pre_training_told_it() -> None:
    hysteresis = expected(0.2)
    hysteresis.learn(0.0, DT_S, np.zeros(3), lag_of(0.1))
    assert hysteresis.share == 0.2


def test_a_body_that_turns_needs_more_of_its_axes_than_one_that_goes_on() -> None:
    hysteresis = expected(0.6)
    for place in np.linspace(5.0, 40.0, 200):
        hysteresis.follow(np.full(3, place), DT_S)
    goes_on = hysteresis.needed @ np.ones(3)
    for place in np.linspace(40.0, 39.0, 40):
        hysteresis.follow(np.full(3, place), DT_S)
    turned = hysteresis.needed @ np.ones(3)
    np.testing.assert_allclose(goes_on, 0.95, atol=0.06)
    assert (turned > 1.25).all()


def test_what_is_needed_is_what_the_body_goes_for_the_next_step() -> None:
    hysteresis, step = expected(0.6), np.array([0.02, -0.015, 0.01])
    for k in range(300):
        hysteresis.follow(turning(k * DT_S), DT_S)
    place = turning(299 * DT_S)
    for _ in range(20):
        place = place + step
        hysteresis.follow(place, DT_S)
    needed, before = hysteresis.needed, hysteresis.free(place)
    hysteresis.follow(place + step, DT_S)
    moved = hysteresis.free(place + step) - before
    np.testing.assert_allclose(needed @ moved, step, atol=2e-3)


def test_what_sticks_is_not_told_to_have_come() -> None:
    hysteresis = expected(0.4)
    arm, told = Arm(0.4), np.zeros(3)
    for k in range(400):
        targets = turning(k * DT_S)
        hysteresis.follow(targets, DT_S)
        told = told + hysteresis.moved_mm(JACOBIAN)
        tip_mm = arm.seen(targets)
    np.testing.assert_allclose(tip_mm, told, atol=4.0 * NOISE_MM)
    by_axes = JACOBIAN @ (hysteresis.free(targets) - turning(0.0))
    np.testing.assert_allclose(by_axes, told, atol=1e-9)


def test_what_is_seen_on_a_path_counts_more_than_what_is_seen_on_the_way_to_it() -> None:
    found = []
    for on_path in (False, True):
        hysteresis = expected()
        followed(hysteresis, Arm(0.2), turning, 10.0).break_off()
        found.append(followed(hysteresis, Arm(0.9), turning, 4.0, on_path=on_path).share)
    assert found[0] + 0.1 < found[1]


def test_what_pre_training_told_nothing_of_is_not_looked_for() -> None:
    """Receptive fields were learnt with what was held back in them."""
    arm, unknown = Arm(0.35), Hysteresis(HeldBack(None, np.zeros(3), TRAVEL))
    followed(unknown, arm, to_and_fro, 4.0, probes=True)
    found = followed(unknown, arm, turning, 20.0)
    assert found.share == 0.0
    np.testing.assert_array_equal(found.needed, np.eye(3))


def test_nothing_is_compiled_when_a_body_is_followed() -> None:
    tip_following.warm_up()
    compiled: list[Any] = [kernels.follow_by_share, kernels.needed, kernels.walk]
    known = [len(kernel.signatures) for kernel in compiled]
    assert min(known) > 0
    hysteresis = expected(0.4)
    hysteresis.follow(turning(0.0), DT_S)
    np.testing.assert_array_less(0.0, np.diag(hysteresis.needed))
    assert [len(kernel.signatures) for kernel in compiled] == known
