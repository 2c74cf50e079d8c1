"""Distances on a grid: exact where it matters, never wrong by more than is said."""

from functools import cache

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation.shapes import ball, balls, box, joined, slot, turned
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import EnvironmentFaultError, Mesh, environment
from tests.safety.risk.scenes import rotation

SIZE, CENTRE = np.array([40.0, 50.0, 60.0]), np.array([3.0, 2.0, 50.0])
BOX = box(SIZE.tolist(), CENTRE.tolist(), 3)


def to_box(points: FloatArray) -> FloatArray:
    """Signed distance, in closed form."""
    beyond = np.abs(points - CENTRE) - SIZE / 2
    away = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    result: FloatArray = away + np.minimum(beyond.max(axis=-1), 0.0)
    return result


def places(grid: DistanceGrid) -> FloatArray:
    return grid.origin_mm + grid.spacing_mm * np.moveaxis(np.indices(grid.values_mm.shape), 0, -1)


@cache
def grid_of_box() -> DistanceGrid:
    return distance_grid(environment(*BOX), spacing_mm=2.0, exact_to_mm=8.0)


def test_near_the_surface_every_distance_is_exact() -> None:
    grid = grid_of_box()
    truth = to_box(places(grid))
    near = np.abs(truth) <= grid.exact_to_mm
    assert near.mean() > 0.3
    np.testing.assert_allclose(grid.values_mm[near], truth[near], atol=1e-4)


def test_farther_away_a_distance_is_taken_from_a_coarser_grid_and_still_farther_away() -> None:
    random = np.random.default_rng(0)
    long = box((300.0, 40.0, 40.0), (0.0, 0.0, 0.0))
    mesh = environment(*turned(Mesh(long.vertices_mm @ rotation(random).T, long.triangles)))
    exact = distance_grid(mesh, spacing_mm=3.0, exact_to_mm=1000.0)
    quick = distance_grid(mesh, spacing_mm=3.0, exact_to_mm=10.0)
    same = quick.values_mm == exact.values_mm
    assert 0.05 < same.mean() < 0.95
    assert np.abs(exact.values_mm[~same]).min() > 10.0
    assert np.abs(quick.values_mm[~same]).min() > 10.0
    assert np.abs(quick.values_mm - exact.values_mm).max() < 4.0 * quick.error_mm


def test_the_grid_is_larger_than_the_mesh() -> None:
    grid, (nx, ny, nz) = grid_of_box(), grid_of_box().values_mm.shape
    last = grid.origin_mm + grid.spacing_mm * (np.array([nx, ny, nz]) - 1)
    assert grid.margin_mm >= grid.exact_to_mm
    assert (grid.origin_mm <= CENTRE - SIZE / 2 - grid.margin_mm).all()
    assert (last >= CENTRE + SIZE / 2 + grid.margin_mm).all()


@pytest.mark.parametrize("seed", range(3))
def test_what_is_negative_is_what_is_solid(seed: int) -> None:
    """Several bodies in a turned room, on whose edges and faces grid lines may run."""
    random = np.random.default_rng(seed)
    room = turned(box((100.0, 90.0, 80.0), (0.0, 0.0, 0.0), 2))
    bodies = [ball(12.0, (20.0, 5.0, 0.0), 60), box((16.0, 16.0, 16.0), (-24.0, 0.0, 0.0), 2)]
    scene = joined([room, *bodies])
    axes = rotation(random) if seed else np.eye(3)
    mesh = environment(scene.vertices_mm @ axes.T, scene.triangles)
    grid = distance_grid(mesh, spacing_mm=4.0)
    clear = np.abs(grid.values_mm) > 1e-3
    points = places(grid)[clear]
    np.testing.assert_array_equal(grid.values_mm[clear] < 0.0, mesh.solid(points))
    assert grid.solid_around


@pytest.mark.parametrize("mesh", [balls(4, 400, 1), slot(20.0, 1)])
def test_distances_have_a_slope_of_one(mesh: Mesh) -> None:
    grid = distance_grid(environment(*mesh), spacing_mm=4.0, exact_to_mm=40.0)
    near = np.where(np.abs(grid.values_mm) <= 40.0, grid.values_mm.astype(float), np.nan)
    for axis in range(3):
        assert np.nanmax(np.abs(np.diff(near, axis=axis))) <= 4.0 + 1e-3


def test_a_grid_that_would_be_too_large_is_refused_before_it_is_made() -> None:
    with pytest.raises(EnvironmentFaultError, match="take a coarser one"):
        distance_grid(environment(*BOX), spacing_mm=0.05)
    with pytest.raises(EnvironmentFaultError, match="positive spacing"):
        distance_grid(environment(*BOX), spacing_mm=0.0)
