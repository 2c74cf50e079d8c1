"""Meshes: which are accepted, what is wrong with the others, and what is solid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.risk.environment import _RAYS, EnvironmentFaultError, InsertionPort, environment
from safety.risk.mixture import FloatArray
from safety.risk.shapes import Mesh, ball, box, joined, quartered, turned
from tests.safety.risk.scenes import random_scene, solid_share

CUBE = box((40.0, 40.0, 40.0), (0.0, 0.0, 0.0), cuts=2)


@given(st.integers(0, 10_000))
def test_what_is_solid_is_what_half_spaces_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    scene = random_scene(random)
    points = random.uniform(-110.0, 110.0, (300, 3))
    for point, solid in zip(points, scene.environment.solid(points), strict=True):
        assert solid == (solid_share(scene, point[None]) == 1.0)


def test_around_a_cavity_everything_is_solid_and_in_it_only_what_stands_there() -> None:
    inside = ball(10.0, (0.0, 0.0, 0.0), 100)
    cavity = environment(*joined([turned(box((80.0, 80.0, 80.0), (0.0, 0.0, 0.0))), inside]))
    assert cavity.solid_around
    points = np.array([[0.0, 0.0, 0.0], [25.0, 0.0, 0.0], [41.0, 0.0, 0.0], [1e6, 0.0, 0.0]])
    assert cavity.solid(points).tolist() == [True, False, True, True]


def test_bodies_that_overlap_are_solid_where_they_do() -> None:
    pair = [box((20.0, 20.0, 20.0), (x, 0.0, 0.0)) for x in (0.0, 12.0)]
    points = np.array([[6.0, 1.0, 2.0], [-6.0, 1.0, 2.0], [18.0, 1.0, 2.0], [30.0, 1.0, 2.0]])
    assert environment(*joined(pair)).solid(points).tolist() == [True, True, True, False]


@pytest.mark.parametrize("cuts", [1, 2, 3, 7])
def test_a_ray_through_edges_and_corners_counts_them_once(cuts: int) -> None:
    """The first ray of these points goes through corners and edges of the mesh, or as good as."""
    mesh = environment(*box((40.0, 40.0, 40.0), (0.0, 0.0, 0.0), cuts))
    pairs = mesh.vertices_mm[mesh.triangles[:, :2]]
    places = np.concatenate([pairs[:, 0], pairs.mean(axis=1)])
    points = places[:, None] - _RAYS[0] * np.linspace(1.0, 60.0, 7)[:, None]
    points = points.reshape(-1, 3)
    depth = 20.0 - np.abs(points).max(axis=1)
    clearly = np.abs(depth) > 1e-9
    np.testing.assert_array_equal(mesh.solid(points)[clearly], depth[clearly] > 0.0)


@pytest.mark.parametrize(("free", "solid"), [("inside", False), ("outside", True)])
@pytest.mark.parametrize("mesh", [CUBE, turned(CUBE)])
def test_the_free_side_that_is_declared_counts_and_not_the_normals(
    free: str, solid: bool, mesh: Mesh
) -> None:
    declared = environment(*mesh, free=free)  # type: ignore[arg-type]
    assert declared.solid(np.zeros((1, 3)))[0] == solid
    assert declared.solid_around != solid


def test_without_a_declaration_normals_point_into_free_space() -> None:
    assert environment(*CUBE).solid(np.zeros((1, 3)))[0]
    assert not environment(*turned(CUBE)).solid(np.zeros((1, 3)))[0]


def without(vertices: FloatArray, row: int, value: float) -> FloatArray:
    changed = vertices.copy()
    changed[row] = value
    return changed


def one_turned(mesh: Mesh) -> Mesh:
    triangles = mesh.triangles.copy()
    triangles[5] = triangles[5, ::-1]
    return Mesh(mesh.vertices_mm, triangles)


FLAT = Mesh(
    np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0]]),
    np.array([[0, 1, 2], [2, 1, 3], [0, 2, 1], [2, 3, 1]]),
)


@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        (
            Mesh(CUBE.vertices_mm, CUBE.triangles[:-1]),
            "not watertight: 3 edges have no triangle on their other side, one near",
        ),
        (one_turned(CUBE), "3 edges are between triangles that face opposite ways, one near"),
        (Mesh(without(CUBE.vertices_mm, 3, np.nan), CUBE.triangles), "vertex 3 is not finite"),
        (Mesh(CUBE.vertices_mm / 1000.0, CUBE.triangles), "is it written in m?"),
        (Mesh(CUBE.vertices_mm * 1000.0, CUBE.triangles), "is it written in another unit?"),
        (Mesh(CUBE.vertices_mm, CUBE.triangles + 9), "a corner that is no vertex"),
        (Mesh(CUBE.vertices_mm, CUBE.triangles[:0]), "0 triangles enclose nothing"),
        (Mesh(CUBE.vertices_mm, CUBE.triangles[:, [0, 1, 1]]), "triangle 0 has one corner twice"),
        (Mesh(CUBE.vertices_mm[:, :2], CUBE.triangles), "a mesh is vertices"),
        (FLAT, "it encloses no volume"),
    ],
)
def test_a_mesh_that_cannot_be_used_says_why(mesh: Mesh, told: str) -> None:
    with pytest.raises(EnvironmentFaultError, match=told):
        environment(*mesh)


def test_the_place_of_a_hole_is_named() -> None:
    triangles = np.delete(CUBE.triangles, 0, axis=0)
    hole = CUBE.vertices_mm[CUBE.triangles[0]]
    with pytest.raises(EnvironmentFaultError) as error:
        environment(CUBE.vertices_mm, triangles)
    middles = 0.5 * (hole + np.roll(hole, -1, axis=0))
    assert any("({:.6g}, {:.6g}, {:.6g})".format(*middle) in str(error.value) for middle in middles)


def test_two_bodies_that_share_an_edge_are_accepted() -> None:
    one, other = (box((10.0, 10.0, 10.0), place) for place in ((0.0, 0, 0), (10.0, 10.0, 0)))
    both = joined([one, other])
    places, faces = np.unique(both.vertices_mm, axis=0, return_inverse=True)
    shared = environment(places, faces.ravel()[both.triangles])
    assert shared.solid(np.array([[1.0, 2, 3], [9.0, 8, 3], [9.0, 2, 3]])).tolist() == [1, 1, 0]


def test_a_mesh_of_any_size_has_a_tree_that_holds_all_of_it() -> None:
    mesh = CUBE
    for _ in range(4):
        mesh = quartered(mesh)
        tree = environment(*mesh).tree
        assert sorted(tree.order.tolist()) == list(range(len(mesh.triangles)))
        low, high = tree.boxes[:, :3] - tree.boxes[:, 3:], tree.boxes[:, :3] + tree.boxes[:, 3:]
        for box_number, (first, count) in enumerate(tree.links):
            for triangle in range(first, first + count):
                corners = tree.corners[triangle].reshape(3, 3)
                assert (corners >= low[box_number]).all()
                assert (corners <= high[box_number]).all()


def test_a_mesh_of_one_place_again_and_again_still_gets_a_tree() -> None:
    same = joined([box((20.0, 20.0, 20.0), (0.0, 0.0, 0.0))] * 40)
    tree = environment(*same).tree
    assert sorted(tree.order.tolist()) == list(range(480))


@pytest.mark.parametrize(
    "numbers",
    [
        {"radius_mm": 0.0},
        {"depth_mm": -1.0},
        {"inwards": (0.0, 0.0, 0.0)},
        {"centre_mm": (0.0, np.nan, 0.0)},
    ],
)
def test_a_port_must_be_one(numbers: dict[str, object]) -> None:
    sound = {
        "centre_mm": (0.0, 0.0, 0.0),
        "inwards": (0.0, 0.0, 1.0),
        "radius_mm": 5.0,
        "depth_mm": 0.0,
    }
    InsertionPort(**sound)  # type: ignore[arg-type]
    with pytest.raises(EnvironmentFaultError, match="insertion port"):
        InsertionPort(**(sound | numbers))  # type: ignore[arg-type]
