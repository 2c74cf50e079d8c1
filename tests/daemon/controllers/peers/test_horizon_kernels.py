"""The quadratic programme of the horizon: the least there is, and within all bounds."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from daemon.controllers.peers.horizon_kernels import Bounds, Horizon, Weights, best_motion
from drivers.pose import Vector

N, AXES = 10, 5
WEIGHTS = Weights(15.0, 1.0, 10.0)
WIDE = Bounds(np.full(AXES, 1e3), np.full(AXES, -1e3), np.full(AXES, 1e3))


def horizon(seed: int, size_mm: float = 5.0) -> Horizon:
    random = np.random.default_rng(seed)
    response = np.tril(np.clip(0.3 + 0.3 * np.subtract.outer(range(N), range(N)), 0.0, 1.0))
    return Horizon(
        np.ascontiguousarray(response),
        60.0 * random.normal(size=(3, AXES)),
        np.cumsum(size_mm * random.normal(size=(N, 3)), axis=0),
        0.01 * random.normal(size=AXES),
        0.01 * random.normal(size=AXES),
    )


def rows(asked: Horizon) -> tuple[Vector, Vector]:
    """The same as plain least squares, over all that is gone: matrix and right side."""
    jacobian, eye = asked.jacobian, np.eye(AXES)
    tip = np.kron(asked.response, jacobian)
    along = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T, jacobian)
    changes = np.kron(np.eye(N) - np.eye(N, k=-1), eye)
    first = np.zeros(N * AXES)
    first[:AXES] = asked.now
    beside = np.kron(np.eye(N), eye - along)
    matrix = [tip, WEIGHTS.smooth * changes, WEIGHTS.effort * np.kron(np.eye(N), along)]
    right = [asked.wanted.ravel(), WEIGHTS.smooth * first, np.zeros(N * AXES)]
    matrix.append(WEIGHTS.rest * beside)
    right.append(np.asarray(WEIGHTS.rest * beside @ np.tile(asked.rest, N), np.float64))
    return np.concatenate(matrix), np.concatenate(right)


def nothing_paid() -> Vector:
    return np.zeros((2, N, AXES))


@pytest.mark.parametrize("seed", range(4))
def test_without_bounds_it_is_least_squares(seed: int) -> None:
    asked = horizon(seed)
    expected = np.linalg.lstsq(*rows(asked), rcond=None)[0].reshape(N, AXES)
    found, prices = best_motion(asked, WEIGHTS, WIDE, nothing_paid())
    np.testing.assert_allclose(found, expected, atol=1e-7)
    assert not prices.any()


@pytest.mark.parametrize("seed", range(4))
def test_where_axes_are_slow_it_is_bounded_least_squares(seed: int) -> None:
    asked, fastest = horizon(seed), 0.03
    expected = lsq_linear(*rows(asked), bounds=(-fastest, fastest), tol=1e-12)
    bounds = WIDE._replace(fastest=np.full(AXES, fastest))
    found, prices = best_motion(asked, WEIGHTS, bounds, nothing_paid())
    found, _ = best_motion(asked, WEIGHTS, bounds, prices)
    matrix, right = rows(asked)
    left = 0.5 * float(((matrix @ found.ravel() - right) ** 2).sum())
    assert left <= expected.cost * 1.01
    assert np.abs(found).max() <= fastest + 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_the_travel_is_kept_within_at_every_end(seed: int) -> None:
    asked = horizon(seed, size_mm=30.0)
    bounds = Bounds(np.full(AXES, 0.05), np.full(AXES, -0.02), np.full(AXES, 0.1))
    found, prices = best_motion(asked, WEIGHTS, bounds, nothing_paid())
    found, _ = best_motion(asked, WEIGHTS, bounds, prices)
    places = np.cumsum(found, axis=0)
    assert places.max() <= 0.1 + 2e-3
    assert places.min() >= -0.02 - 2e-3
    assert np.abs(found).max() <= 0.05 + 2e-3


def test_a_tip_that_nothing_moves_leaves_the_axes_to_their_posture() -> None:
    asked = horizon(1)._replace(jacobian=np.zeros((3, AXES)))
    found, _ = best_motion(asked, WEIGHTS, WIDE, nothing_paid())
    changes = WEIGHTS.smooth * (np.eye(N) - np.eye(N, k=-1))
    right = np.zeros((2 * N, AXES))
    right[0], right[N:] = WEIGHTS.smooth * asked.now, WEIGHTS.rest * asked.rest
    expected = np.linalg.lstsq(np.concatenate([changes, WEIGHTS.rest * np.eye(N)]), right)[0]
    np.testing.assert_allclose(found, expected, atol=1e-9)
