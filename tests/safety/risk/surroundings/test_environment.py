"""Meshes: which are accepted, what is wrong with the others, and what is solid."""

import re
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.workbench.body_model.evaluation.shapes import (
    ball,
    box,
    chest,
    joined,
    quartered,
    turned,
)
from safety.risk.body_point import BodyPointRisk
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import (
    _RAYS,
    Environment,
    EnvironmentFaultError,
    InsertionPort,
    Mesh,
    environment,
    triangle_tree,
)
from tests.safety.risk.scenes import mixture_of, random_scene, solid_share

CUBE = box((40.0, 40.0, 40.0), (0.0, 0.0, 0.0), cuts=2)


@given(st.integers(0, 10_000))
def test_what_is_solid_is_what_half_spaces_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    scene = random_scene(random)
    points = random.uniform(-110.0, 110.0, (120, 3))
    for point, solid in zip(points, scene.environment.solid(points), strict=True):
        assert solid == (solid_share(scene, point[None]) == 1.0)


def test_around_a_cavity_everything_is_solid_and_in_it_only_what_stands_there() -> None:
    inside = ball(10.0, (0.0, 0.0, 0.0), 100)
    cavity = environment(*joined([turned(box((80.0, 80.0, 80.0), (0.0, 0.0, 0.0))), inside]))
    assert cavity.solid_around
    points = np.array([[0.0, 0.0, 0.0], [25.0, 0.0, 0.0], [41.0, 0.0, 0.0], [1e6, 0.0, 0.0]])
    assert cavity.solid(points).tolist() == [True, False, True, True]


ORIGIN = (0.0, 0.0, 0.0)
BALL = ball(10.0, ORIGIN, 100)
CAVITY = turned(box((80.0, 80.0, 80.0), ORIGIN, 3))


def merged(mesh: Mesh) -> Mesh:
    """Corners in one place are one, as those of a file become."""
    places, which = np.unique(mesh.vertices_mm, axis=0, return_inverse=True)
    return Mesh(places, which.ravel()[mesh.triangles])


def bars(*sizes: tuple[float, float, float]) -> Mesh:
    return joined([box(size, ORIGIN) for size in sizes])


def pair(away_mm: float, size: tuple[float, float, float] = (20.0, 20.0, 20.0)) -> Mesh:
    """Two boxes beside each other."""
    return joined([box((20.0, 20.0, 20.0), ORIGIN), box(size, (away_mm, 0.0, 0.0))])


@pytest.mark.parametrize(
    ("mesh", "number"),
    [
        (joined([CAVITY, turned(BALL)]), -1),
        (joined([BALL, turned(ball(9.0, (40.0, 0.0, 0.0), 100))]), -1),
        (joined([ball(30.0, ORIGIN, 100), turned(ball(20.0, ORIGIN, 100)), turned(BALL)]), -1),
        (pair(12.0), 2),
        (pair(0.0), 2),
        (pair(19.9), 2),
        (merged(joined([BALL, BALL])), 2),
        (merged(joined([CAVITY, CAVITY])), -1),
        (joined([ball(20.0, ORIGIN, 200), BALL]), 2),
        (joined([CAVITY, ball(20.0, (35.0, 0.0, 0.0), 200)]), 2),
        (joined([turned(BALL), ball(9.0, (40.0, 0.0, 0.0), 100)]), 2),
        (bars((100.0, 10.0, 10.0), (10.0, 100.0, 10.0)), 2),
        (bars((100.0, 10.0, 10.0), (10.0, 100.0, 10.0), (10.0, 10.0, 100.0)), 3),
    ],
    ids=[
        "a body turned inside out in a cavity",
        "one of two bodies turned inside out",
        "a body turned inside out in a hollow one",
        "bodies that overlap, with sides in one plane",
        "a body twice",
        "bodies that overlap by a tenth of a millimetre",
        "the same triangles twice",
        "a cavity twice",
        "a body in a body",
        "a body half in the wall",
        "what is outermost turned inside out",
        "two bars through each other",
        "three bars through each other",
    ],
)
def test_what_is_neither_free_nor_solid_once_is_refused_with_its_place(
    mesh: Mesh, number: int
) -> None:
    with pytest.raises(EnvironmentFaultError, match=rf"winding number {number}, ") as error:
        environment(*mesh)
    found = re.search(r"at \(([^)]*)\) mm", str(error.value))
    assert found is not None
    place = np.array([[float(x) for x in found[1].split(",")]])
    sides = Environment(*mesh, triangle_tree(*mesh), "cavity" in str(error.value), None)
    low, high = mesh.vertices_mm.min(axis=0), mesh.vertices_mm.max(axis=0)
    assert ((place > low - 1.0) & (place < high + 1.0)).all()
    assert sides.solid(place)[0] == (number > 0)


def test_bodies_whose_faces_meet_only_where_no_face_has_its_middle_are_looked_at() -> None:
    """The corners of two large boxes overlap by a millimetre, and a needle goes through a plate."""
    corners = [box((40.0, 40.0, 40.0), ORIGIN), box((40.0, 40.0, 40.0), (39.0, 39.0, 39.0))]
    needle = [box((900.0, 900.0, 2.0), ORIGIN), box((0.5, 0.5, 50.0), (33.3, 21.1, 3.0))]
    for bodies in (corners, needle):
        for body in bodies:
            environment(*body)
        with pytest.raises(EnvironmentFaultError, match="winding number 2"):
            environment(*joined(bodies))


def test_a_surface_that_goes_through_itself_is_refused() -> None:
    """One corner of a box is pushed in and out at its opposite side."""
    mesh = box((40.0, 40.0, 40.0), ORIGIN, 2)
    vertices = mesh.vertices_mm.copy()
    corner = int(np.argmax(vertices.sum(axis=1)))
    vertices[corner] = (-31.0, -26.0, -28.0)
    with pytest.raises(EnvironmentFaultError, match="winding number"):
        environment(vertices, mesh.triangles)


@pytest.mark.parametrize(
    "mesh",
    [
        pair(20.0),
        pair(20.0, (20.0, 8.0, 30.0)),
        merged(pair(20.0)),
        pair(20.0 - 1e-6),
        pair(19.995),
        pair(20.0 + 1e-6),
        joined([ball(20.0, ORIGIN, 200), turned(BALL)]),
        joined([ball(30.0, ORIGIN, 200), turned(ball(20.0, ORIGIN, 100)), BALL]),
        joined([CAVITY, BALL, box((8.0, 8.0, 8.0), (36.0, 0.0, 0.0))]),
        box((0.005, 80.0, 80.0), ORIGIN, 3),
    ],
    ids=[
        "touching",
        "touching with a part of a side",
        "touching, with the same corners",
        "touching but for rounding",
        "touching but for five thousandths of a millimetre",
        "hardly apart",
        "hollow",
        "a body in a hollow one",
        "a body at the wall of a cavity",
        "a plate of no thickness to speak of",
    ],
)
def test_bodies_that_touch_or_lie_in_hollow_ones_are_accepted(mesh: Mesh) -> None:
    environment(*mesh)


def test_where_it_is_free_turns_over_all_of_a_mesh_or_only_what_is_outermost() -> None:
    """Which of both the bodies in it say: they must not be inside out then."""
    points = np.array([[0.0, 1.0, 2.0], [25.0, 1.0, 2.0], [41.0, 1.0, 2.0]])
    for outer, inner in ((CAVITY, BALL), (turned(CAVITY), BALL), (turned(CAVITY), turned(BALL))):
        made = environment(*joined([outer, inner]), free="inside")
        assert made.solid(points).tolist() == [True, False, True]
    with pytest.raises(EnvironmentFaultError, match="turned inside out"):
        environment(*joined([CAVITY, turned(BALL)]), free="inside")
    apart = joined([turned(BALL), ball(9.0, (25.0, 0.0, 0.0), 100)])
    assert environment(*apart, free="outside").solid(points).tolist() == [True, True, False]


@pytest.mark.parametrize("seed", [1, 4, pytest.param(0, marks=pytest.mark.long)])
def test_bound_value_and_grid_agree_on_what_is_solid(seed: int) -> None:
    """A point of no size to speak of: it is in something solid, or it is not."""
    random = np.random.default_rng(seed)
    hollow = [ball(30.0, ORIGIN, 200), turned(ball(22.0, ORIGIN, 100)), BALL]
    post = box((12.0, 12.0, 80.0), (36.0, 36.0, 0.0))
    room = turned(box((100.0, 100.0, 100.0), ORIGIN, 2))
    every: list[Environment] = [
        environment(*joined([room, *hollow, post])),
        environment(*joined([*hollow, post])),
        random_scene(random).environment,
    ]
    for made in every:
        risk, grid = BodyPointRisk(made), distance_grid(made, 4.0, 20.0)
        corners = grid.origin_mm + grid.spacing_mm * np.argwhere(grid.values_mm < np.inf)
        values = grid.values_mm.ravel()
        parts = [np.flatnonzero(side * values > 1.0) for side in (-1.0, 1.0)]
        assert min(map(len, parts)) > 20
        chosen = np.concatenate([random.permutation(part)[:8] for part in parts])
        for place, distance in zip(corners[chosen], values[chosen], strict=True):
            point = mixture_of([1.0], [place.tolist()], [[0.1] * 3])
            solid = float(distance < 0.0)
            assert made.solid(place[None])[0] == solid
            assert risk.near_exact(point).value == pytest.approx(solid, abs=1e-6)
            assert risk.printed(point) == pytest.approx(solid, abs=1e-6)


def test_a_large_mesh_is_checked_in_seconds() -> None:
    mesh = chest(50_000, 1)
    environment(*ball(10.0, ORIGIN, 100))  # compiled
    began = time.process_time()
    environment(*mesh)
    assert time.process_time() - began < 3.0


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
    tree = triangle_tree(*same)
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
