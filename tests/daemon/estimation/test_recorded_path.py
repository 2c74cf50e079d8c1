"""The smoother of recorded paths: it agrees with the filter in the loop, and does not come late."""

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from numpy.typing import NDArray

from config.control import PoseFilterSettings
from daemon.estimation.constant_velocity import PositionFilter
from daemon.estimation.recorded_path import first_state, motion_model, recorded_path
from drivers.pose import Vector

SETTINGS = PoseFilterSettings()
PERIOD_NS = 25_000_000


def wavy(count: int, seed: int = 1) -> tuple[NDArray[np.int64], Vector, Vector, Vector]:
    """Times, true places and velocities of a tip that goes to and fro at 3 s, and what is seen."""
    t_ns = 5_000_000_000 + PERIOD_NS * np.arange(count)
    phase = 2.0 * np.pi * t_ns[:, None] * 1e-9 / np.array([3.0, 4.0, 5.0])
    place, speed = 30.0 * np.sin(phase), 60.0 * np.pi / np.array([3.0, 4.0, 5.0]) * np.cos(phase)
    noise = SETTINGS.position_noise_mm * np.random.default_rng(seed).normal(size=place.shape)
    return t_ns, place, speed, place + noise


def rms(away: Vector) -> float:
    return float(np.sqrt((away**2).sum(axis=-1).mean()))


def causal(t_ns: NDArray[np.int64], measured_mm: Vector) -> tuple[Vector, Vector]:
    """Places and velocities as the loop's filter has them at each frame."""
    speed = SETTINGS.acceleration_mm_s2 * SETTINGS.predict_for_s
    position = PositionFilter(SETTINGS.position_noise_mm, SETTINGS.acceleration_mm_s2, speed)
    position.begin(measured_mm[0].tolist())
    places, speeds = [position.position(0.0)], [position.velocity()]
    for dt_ns, seen in zip(np.diff(t_ns), measured_mm[1:], strict=True):
        ahead_s = float(dt_ns) * 1e-9
        position.update(position.innovation(seen.tolist(), ahead_s), ahead_s)
        places.append(position.position(0.0))
        speeds.append(position.velocity())
    return np.array(places), np.array(speeds)


def test_it_is_nearer_to_the_truth_than_the_filter_and_its_velocity_is_not_late() -> None:
    t_ns, place, speed, measured = wavy(800)
    filtered, filtered_speed = causal(t_ns, measured)
    path = recorded_path(t_ns, measured, SETTINGS)
    inner = slice(20, -20)
    assert rms((path.tip_mm - place)[inner]) < 0.75 * rms((filtered - place)[inner])
    assert rms((path.velocity_mm_s - speed)[inner]) < 0.6 * rms((filtered_speed - speed)[inner])
    # How late a velocity is: the part of its error that goes along with the acceleration.
    change = -place * (2.0 * np.pi / np.array([3.0, 4.0, 5.0])) ** 2
    late_s = [
        -float(((each - speed) * change)[inner].sum() / (change[inner] ** 2).sum())
        for each in (filtered_speed, path.velocity_mm_s)
    ]
    assert late_s[0] > 0.03
    assert abs(late_s[1]) < 1e-3
    assert path.std_mm[400] == pytest.approx(rms((path.tip_mm - place)[inner]) / 3**0.5, rel=0.3)


def test_its_last_place_is_the_filters_where_nothing_comes_after() -> None:
    """Forward it is the very filter that is compiled into the loop, at even and uneven times."""
    t_ns, _, _, measured = wavy(60)
    t_ns = t_ns + np.random.default_rng(2).integers(-4_000_000, 4_000_000, len(t_ns))
    for count in (1, 2, 17, 60):
        path = recorded_path(t_ns[:count], measured[:count], SETTINGS)
        filtered, speeds = causal(t_ns[:count], measured[:count])
        np.testing.assert_allclose(path.tip_mm[-1], filtered[-1], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(path.velocity_mm_s[-1], speeds[-1], rtol=1e-8, atol=1e-8)


def test_what_lies_before_a_gap_says_nothing_of_what_comes_after() -> None:
    t_ns, _, _, measured = wavy(100)
    later = t_ns.copy()
    later[50:] += 1_000_000_000
    whole = recorded_path(later, measured, SETTINGS)
    first, second = (recorded_path(later[part], measured[part], SETTINGS)
                     for part in (slice(50), slice(50, None)))  # fmt: skip
    for column, one, other in zip(whole, first, second, strict=True):
        np.testing.assert_allclose(column, np.concatenate([one, other]), rtol=1e-9, atol=1e-9)


def test_a_tip_at_rest_stays_where_it_is() -> None:
    t_ns = PERIOD_NS * np.arange(40)
    path = recorded_path(t_ns, np.full((40, 3), 7.0), SETTINGS)
    np.testing.assert_allclose(path.tip_mm, 7.0)
    np.testing.assert_allclose(path.velocity_mm_s, 0.0, atol=1e-9)
    assert path.std_mm.max() <= SETTINGS.position_noise_mm


def test_nothing_recorded_is_no_path_and_disorder_is_refused() -> None:
    empty = recorded_path(np.zeros(0, np.int64), np.zeros((0, 3)), SETTINGS)
    assert [len(column) for column in empty] == [0, 0, 0]
    with pytest.raises(ValueError, match="not in order"):
        recorded_path(np.array([2, 1]), np.zeros((2, 3)), SETTINGS)


def test_the_noise_is_that_of_white_acceleration_per_coordinate() -> None:
    move, noise = motion_model(0.025, SETTINGS)
    one = Q_discrete_white_noise(2, 0.025, SETTINGS.acceleration_mm_s2**2)
    np.testing.assert_array_equal(noise, np.kron(np.eye(3), one))
    np.testing.assert_array_equal(move, np.kron(np.eye(3), [[1.0, 0.025], [0.0, 1.0]]))
    begun = first_state(np.array([1.0, 2.0, 3.0]), SETTINGS)
    np.testing.assert_array_equal(begun.x, [1.0, 0.0, 2.0, 0.0, 3.0, 0.0])
