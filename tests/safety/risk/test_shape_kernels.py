"""Where the worst shapes are, and how far a shift leads, by plain arithmetic."""

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.workbench.body_model.evaluation.shapes import box
from safety.risk.contact import ContactModel
from safety.risk.model.mixture import Mixture
from safety.risk.shape_kernels import (
    Shapes,
    exchange,
    fall_to,
    farthest_mm,
    find_changed,
    in_lanes,
    lower,
    place_shapes,
    worst_place,
)
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


def mixture(random: np.random.Generator, components: int, d: int) -> Mixture:
    factors = np.triu(random.normal(size=(components, d, d)), 1) * 0.3 + 2.0 * np.eye(d)
    weights = random.dirichlet(np.ones(components))
    weights[random.integers(components)] = 0.0
    return Mixture.checked(weights / weights.sum(), random.normal(size=(components, d)), factors)


@pytest.mark.parametrize("components", [2, 5, 16])
def test_draws_that_rise_fall_to_the_components_that_a_search_finds(components: int) -> None:
    random = np.random.default_rng(components)
    among, uniform = mixture(random, components, 3), np.sort(random.random(500))
    uniform[:2] = 0.0, np.cumsum(among.weights)[0]  # on an edge, too
    uniform.sort()
    component = np.empty(uniform.size, np.int64)
    fall_to(among.weights, uniform, component)
    np.testing.assert_array_equal(component, among.chosen(uniform))


@pytest.mark.parametrize("sorts", [True, False])
@pytest.mark.parametrize(("d", "count"), [(1, 1), (3, 8), (4, 7), (6, 50), (9, 33)])
def test_a_shape_is_placed_where_its_draw_has_it_whoever_is_beside_it(
    d: int, count: int, sorts: bool
) -> None:
    """Alone or in pairs of one component; neighbours may be of others."""
    random = np.random.default_rng(10 * d + sorts)
    among, normal = mixture(random, 4, d), random.standard_normal((count, d))
    component = random.integers(0, 4, count)
    component = np.sort(component) if sorts else component
    base = random.normal(size=3 * NODES).astype(np.float32)
    modes = random.normal(size=(d, 3 * NODES)).astype(np.float32)
    positions = np.empty((count, 3 * NODES), np.float32)
    parts = among.means_mm, among.factors_per_mm
    place_shapes(*parts, component, normal, in_lanes(base), in_lanes(modes), positions)
    for s, k in enumerate(component):
        coefficients = among.means_mm[k] + np.linalg.solve(among.factors_per_mm[k], normal[s])
        np.testing.assert_allclose(positions[s], base + coefficients @ modes, atol=2e-4)


def copied(shapes: Shapes) -> Shapes:
    return Shapes._make([part.copy() for part in shapes])


def test_draws_that_fall_to_another_component_are_found_in_their_order() -> None:
    before, now = np.array([0, 0, 1, 2, 2]), np.array([0, 1, 1, 2, 3])
    rows = np.full(5, -1)
    assert find_changed(before, now, rows) == 2
    assert rows.tolist() == [1, 4, -1, -1, -1]
    assert find_changed(now, now, rows) == 0


def test_exchanged_shapes_have_what_the_others_had_and_the_others_theirs() -> None:
    shapes, others, rows = drawn(1), drawn(2, 3), np.array([4, 9, 30])
    others.surely[:] = 1.0, 2.0, 3.0
    before, arriving = copied(shapes), copied(others)
    exchange(shapes, rows, others)
    for name in ("positions", "clearance", "surely"):
        whole, part = getattr(before, name).copy(), getattr(arriving, name)
        left = whole[rows]
        whole[rows] = part
        np.testing.assert_array_equal(getattr(shapes, name), whole)
        np.testing.assert_array_equal(getattr(others, name), left)


def test_only_the_rows_are_lowered_and_what_is_no_number_stays_none() -> None:
    shapes = drawn(3, 6)
    shapes.clearance[:] = 1.0, 5.0, np.nan, 0.0, 1.0, 1.0
    shapes.surely[:] = 2.0, 0.5, np.nan, 0.5, 1.0, 1.0
    swept = np.array([3.0, 3.0, 3.0, np.nan, 3.0, 3.0], np.float32)
    surely = np.array([1.0, 1.0, 1.0, np.nan, 3.0, 3.0], np.float32)
    lower(swept, surely, shapes, np.array([0, 1, 2, 3]))
    np.testing.assert_array_equal(swept, [1.0, 3.0, np.nan, np.nan, 3.0, 3.0])
    np.testing.assert_array_equal(surely, [1.0, 0.5, np.nan, np.nan, 3.0, 3.0])
