"""The collision library coal measures the same distances and finds the same touches."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation import shapes
from safety.risk.contact import ContactModel
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, Free, Mesh, environment
from tests.daemon.workbench.planning.arms import MODEL, model_file

coal = pytest.importorskip("coal", reason="coal is not installed: `make oracles` does it")

SCENES: dict[str, tuple[Mesh, Free]] = {
    "ball": (shapes.ball(25.0, (60.0, 0.0, 150.0), 400), "outside"),
    "box, thin": (shapes.box((4.0, 80.0, 120.0), (35.0, 5.0, 130.0), 2), "outside"),
    "slot": (
        shapes.joined(
            [shapes.box((30.0, 40.0, 150.0), (30.0, y, 120.0), 2) for y in (-34.0, 34.0)]
        ),
        "outside",
    ),
    "chest, inside": (shapes.chest(2000, 9), "inside"),
}
SPACING_MM = 2.0


@cache
def scene(name: str) -> tuple[Environment, DistanceGrid, Any]:
    """Our environment with its distance grid, and coal's tree of the same triangles."""
    mesh, free = SCENES[name]
    ours = environment(*mesh, free=free)
    theirs = coal.BVHModelOBBRSS()
    theirs.beginModel(len(mesh.triangles), len(mesh.vertices_mm))
    for triangle in mesh.triangles:
        theirs.addTriangle(*(mesh.vertices_mm[corner] for corner in triangle))
    theirs.endModel()
    return ours, distance_grid(ours, SPACING_MM, exact_to_mm=40.0), theirs


def away_mm(theirs: Any, shape: Any, turned: FloatArray, at_mm: FloatArray) -> float:
    """Of a shape from the triangles. Not positive: it touches them."""
    here, there = coal.Transform3s(), coal.Transform3s(turned, at_mm)
    return float(
        coal.distance(theirs, here, shape, there, coal.DistanceRequest(), coal.DistanceResult())
    )


@pytest.mark.parametrize("name", SCENES)
def test_distances_at_the_grid_s_corners_are_theirs(name: str) -> None:
    ours, grid, theirs = scene(name)
    random = np.random.default_rng(3)
    corners = random.integers(0, np.array(grid.values_mm.shape), (400, 3))
    places = grid.origin_mm + grid.spacing_mm * corners
    point = coal.Sphere(1e-9)
    exact = np.array([away_mm(theirs, point, np.eye(3), place) for place in places])
    values = grid.values_mm[tuple(corners.T)]
    near = exact < grid.exact_to_mm
    assert near.sum() > 40
    np.testing.assert_allclose(np.abs(values[near]), exact[near], atol=2e-3)
    beside = near & (exact > 1e-6)  # what is on the surface is on neither side
    np.testing.assert_array_equal(values[beside] < 0.0, ours.solid(places[beside]))


def capsules_away_mm(theirs: Any, centreline: FloatArray, radius: FloatArray) -> float:
    """What the nearest part of a body has between it and the triangles; of a chain of capsules,
    each as thick as its thicker end."""
    nearest = np.inf
    for a, b, thick in zip(
        centreline, centreline[1:], np.maximum(radius[:-1], radius[1:]), strict=False
    ):
        along = b - a
        length = float(np.linalg.norm(along))
        z = along / length
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
        x /= np.linalg.norm(x)
        turned = np.column_stack([x, np.cross(z, x), z])
        capsule = coal.Capsule(float(thick), length)
        nearest = min(nearest, away_mm(theirs, capsule, turned, 0.5 * (a + b)))
    return nearest


POSTURES = np.array(
    [[0.0, 0.0, 0.0, 0.0], [4.0, -2.0, -2.0, 0.0], [-3.0, 3.0, 0.0, 1.5], [2.0, 2.0, -4.0, -2.0]]
)


@pytest.mark.parametrize("name", [one for one in SCENES if not one.startswith("chest")])
def test_every_body_that_they_say_touches_is_counted_and_none_that_is_well_clear(name: str) -> None:
    _, grid, theirs = scene(name)
    basis = model_file(MODEL).model.basis
    contact = ContactModel(basis, grid, None, samples=60, seed=5)
    radius = contact.skin.radius.astype(np.float64)
    touched = counted = 0
    for u in POSTURES:
        mixture = model_file(MODEL).model.shapes.mixture(u)
        assert mixture is not None
        risk = contact.risk(mixture)
        drawn = contact.centrelines(mixture).astype(np.float64)
        clear = np.array([capsules_away_mm(theirs, one, radius) for one in drawn])
        touched += int((clear <= 0.0).sum())
        counted += risk.not_surely_clear
        assert risk.not_surely_clear >= (clear <= 0.0).sum(), "none is missed"
        assert risk.touching <= (clear < 2.0 * grid.error_mm).sum(), "and none is made up"
    assert 0 < touched <= counted < 60 * len(POSTURES), "the scene has both"
