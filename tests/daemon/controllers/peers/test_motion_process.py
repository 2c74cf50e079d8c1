"""The sparse online process: within its budget the exact one, beyond it near to it."""

import numpy as np
import pytest

from daemon.controllers.peers.motion_process import Covariance, MotionProcess, most_likely
from drivers.pose import Vector
from tests.daemon.controllers.peers import bodies

COVARIANCE = Covariance(40.0, 20.0, 1.0)
NOISE_MM = 0.3
UNITS = np.eye(bodies.AXES)
ASKED = np.full(bodies.AXES, 0.4)


def seen(count: int, bent: float = 1.0) -> tuple[Vector, Vector, Vector]:
    """Places and motions in shares, and mm."""
    table = bodies.motions(count, NOISE_MM, bent)
    moves = table.delta_u / bodies.SCALE
    return table.u / bodies.SCALE + 0.5 * moves, moves, table.delta_tip_mm


def learnt(count: int, budget: int, memory: float = np.inf) -> MotionProcess:
    process = MotionProcess(COVARIANCE, budget, memory, bodies.AXES)
    for x, d, moved in zip(*seen(count), strict=True):
        process.add(x, d, moved, NOISE_MM)
    return process


def exact(count: int, x: Vector) -> Vector:
    """(3, m) by regression on all motions at once."""
    places, moves, moved = seen(count)
    gram = COVARIANCE.among(places, moves) + NOISE_MM**2 * np.eye(count)
    return np.asarray((COVARIANCE.by_axis(x, places, moves).T @ np.linalg.solve(gram, moved)).T)


def truth(x: Vector) -> Vector:
    return np.asarray(bodies.true_jacobian(x * bodies.SCALE) * bodies.SCALE)


def test_the_covariance_is_one_of_a_function_s_slopes() -> None:
    """Along a closed way all motions add up to nothing, with whatever else."""
    corners = 0.01 * np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0], [0, 1, 0, 0]], float)
    moves = np.roll(corners, -1, axis=0) - corners
    places = 0.3 + corners + 0.5 * moves
    others, ways = seen(20)[:2]
    with_each = np.array(
        [COVARIANCE.of(x, d, others, ways) for x, d in zip(places, moves, strict=True)]
    )
    assert np.abs(with_each.sum(axis=0)).max() < 1e-4 * np.abs(with_each).max()


def test_the_jacobian_is_what_a_motion_along_each_axis_would_do() -> None:
    places, moves, _ = seen(20)
    rows = [COVARIANCE.of(ASKED, unit, places, moves) for unit in UNITS]
    np.testing.assert_allclose(COVARIANCE.by_axis(ASKED, places, moves), np.array(rows).T)


def test_within_its_budget_it_is_the_exact_regression() -> None:
    np.testing.assert_allclose(learnt(60, 60).jacobian(ASKED), exact(60, ASKED), atol=0.5)


def test_beyond_its_budget_it_is_near_to_it_and_keeps_to_the_budget() -> None:
    process = learnt(400, 80)
    assert process.count == 80
    off = np.linalg.norm(process.jacobian(ASKED) - truth(ASKED))
    assert off < 0.15 * np.linalg.norm(truth(ASKED))


def test_what_it_does_not_know_it_says() -> None:
    process = learnt(200, 80)
    assert process.unknown(ASKED) < 0.1
    assert process.unknown(np.full(bodies.AXES, 30.0)) > 0.15


def test_what_is_not_seen_again_is_forgotten() -> None:
    process, elsewhere = learnt(100, 100, memory=20.0), np.full(bodies.AXES, 15.0)
    before = np.linalg.norm(process.jacobian(ASKED))
    for _ in range(200):
        process.add(elsewhere, 1e-3 * UNITS[0], np.zeros(3), NOISE_MM)
    assert np.linalg.norm(process.jacobian(ASKED)) < 0.05 * before


def test_the_same_motion_over_and_over_stays_sound() -> None:
    process, other = learnt(30, 60, memory=30.0), np.array([3.0, 0.0, 1.0])
    for _ in range(3000):
        process.add(ASKED, 0.05 * UNITS[0], other, NOISE_MM)
    np.testing.assert_allclose(process.jacobian(ASKED)[:, 0] * 0.05, other, atol=0.05)
    assert np.isfinite(process.jacobian(0.5 * ASKED)).all()


@pytest.mark.parametrize(
    "motion",
    [
        (ASKED, np.zeros(bodies.AXES), np.ones(3)),
        (ASKED, np.full(bodies.AXES, np.nan), np.ones(3)),
        (ASKED, UNITS[0], np.full(3, np.inf)),
    ],
)
def test_what_is_no_motion_teaches_nothing(motion: tuple[Vector, Vector, Vector]) -> None:
    process, untouched = learnt(30, 60), learnt(30, 60)
    process.add(*motion, NOISE_MM)
    np.testing.assert_array_equal(process.jacobian(ASKED), untouched.jacobian(ASKED))


def test_what_is_saved_goes_on_the_same_way() -> None:
    one, other = learnt(120, 60), MotionProcess(COVARIANCE, 60, np.inf, bodies.AXES)
    other.restore(one.to_arrays())
    for x, d, moved in list(zip(*seen(160), strict=True))[120:]:
        one.add(x, d, moved, NOISE_MM)
        other.add(x, d, moved, NOISE_MM)
    np.testing.assert_allclose(one.jacobian(ASKED), other.jacobian(ASKED), atol=1e-6)
    with pytest.raises(ValueError, match="inducing"):
        other.restore({**one.to_arrays(), "mean": np.zeros((2, 3))})


def test_the_settings_are_those_of_the_body() -> None:
    bent, noise_mm = most_likely(*seen(300))
    straight, _ = most_likely(*seen(300, bent=0.0))
    assert 0.15 < noise_mm < 0.6
    assert straight.changing_mm < 0.5 * bent.changing_mm
