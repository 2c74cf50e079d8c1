"""Where the worst shapes are, and how far a shift leads, by plain arithmetic."""

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.workbench.body_model.evaluation.shapes import box
from safety.risk.contact import ContactModel
from safety.risk.shape_kernels import Shapes, farthest_mm, worst_place
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import environment
from tests.safety.risk.arms import Pose, shape_mixture

NODES = 7


def model() -> ContactModel:
    """From x = 52 − 30 mm on it is solid."""
    basis, _ = shape_mixture(Pose(0.004, 0.3))
    solid = environment(*box((60.0, 300.0, 300.0), (52.0, 0.0, 100.0)))
    return ContactModel(basis, distance_grid(solid, 3.0), None, samples=10)


SURROUNDINGS = model().surroundings


def drawn(seed: int, count: int = 60) -> Shapes:
    random = np.random.default_rng(seed)
    return Shapes(
        random.normal(100.0, 3.0, (count, 3 * NODES)).astype(np.float32) - np.float32(100.0),
        random.normal(1.0, 1.0, count).astype(np.float32),
        random.integers(2, 5, count),
        np.zeros(count, np.float32),
        np.zeros(count, np.float32),
    )


def worst(shapes: Shapes, threshold: float) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
    place, nearest = np.full(3, 7.0), np.full(3, 7.0)
    return worst_place(SURROUNDINGS, shapes, threshold, place, nearest), place, nearest


@pytest.mark.parametrize("seed", range(20))
def test_the_worst_place_is_that_of_the_node_where_most_of_the_worst_are_nearest(seed: int) -> None:
    shapes = drawn(seed)
    threshold = float(np.sort(shapes.clearance)[15])
    node, place, _ = worst(shapes, threshold)
    low = shapes.clearance <= threshold
    assert node == np.bincount(shapes.node[low]).argmax()
    mine = shapes.positions[low & (shapes.node == node)]
    np.testing.assert_allclose(place, mine[:, 3 * node : 3 * node + 3].mean(axis=0), atol=1e-5)


def test_the_surface_is_as_far_from_there_as_the_distance_says_and_down_its_slope() -> None:
    shapes = drawn(1)
    shapes.positions[:] = np.tile(np.array([4.0, 7.0, 90.0], np.float32), NODES)
    _, place, nearest = worst(shapes, 10.0)
    np.testing.assert_allclose(place, [4.0, 7.0, 90.0], atol=1e-4)
    np.testing.assert_allclose(nearest, [22.0, 7.0, 90.0], atol=1.6)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_of_a_place_that_is_none_no_surface_is_told(bad: float) -> None:
    shapes = drawn(2)
    shapes.positions[:] = bad
    _, _, nearest = worst(shapes, 10.0)
    assert np.isnan(nearest).all()


def test_far_outside_of_the_grid_a_place_of_numbers_is_told() -> None:
    shapes = drawn(3)
    shapes.positions[:] = -1e6
    _, _, nearest = worst(shapes, 10.0)
    assert np.isfinite(nearest).all()


def test_a_shift_leads_as_far_as_the_node_that_goes_farthest() -> None:
    random = np.random.default_rng(0)
    modes, shift = random.normal(size=(4, NODES, 3)).astype(np.float32), random.normal(size=4)
    ways = np.tensordot(shift, modes, axes=1)
    assert farthest_mm(modes, shift) == pytest.approx(np.linalg.norm(ways, axis=1).max(), rel=1e-6)
    assert farthest_mm(modes, np.zeros(4)) == 0.0
