"""What surrounds the body: closed surfaces of triangles, and on which side of them it may be.

Normals point out of what is solid, into free space. So a tumour has its normals outwards, and a
chest cavity inwards: around it, everything is solid. Where a mesh was made the other way round,
`free` says so, and it is turned over.

So each place has a number: how many surfaces it is within, and one more where everything around is
solid. It is 0 in free space and 1 in what is solid. A mesh in which it is anything else somewhere
is refused, with the place: where it is below 0 a body is turned inside out, where it is above 1
bodies overlap or a surface is there twice, and there the risks would not mean the same thing.
"""

from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from safety.risk.model.mixture import FloatArray, IndexArray
from safety.risk.surroundings.triangle_tree_kernels import (
    LEAF,
    TriangleTree,
    build,
    piercings,
    winding_numbers,
)

Free = Literal["inside", "outside"]
Unit = Literal["mm", "cm", "m", "in"]

MM_PER: Final[dict[Unit, float]] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_SMALLEST_MM, _LARGEST_MM = 5.0, 5000.0
"""Of a mesh: an organ that is written in metres is less than 1 mm large, and what is larger than a
room is in micrometres. Chosen."""
_NO_VOLUME: Final = 1e-9
"""Of the cube around the mesh: what encloses less is flat."""
_BESIDE_MM: Final = 0.01
"""How far from the surface it is tried whether there is solid or free space."""
_THIN_MM: Final = 0.004
"""What is wrong only within so much of a place is nothing: bodies of rounded numbers that touch
overlap by less."""
_FARTHER: Final = (1.0, 5.0, 25.0, 125.0)
"""Times as far from where surfaces go through each other, since between flat ones there is little
room near that place."""
_CONFIRMED: Final = 5_000
"""Of places that are wrong: there may be hundreds of thousands, and one is told."""
_SPREAD: Final = 20_000
"""Places on a mesh of few triangles that are tried, besides one on each triangle."""
_ROOM: Final = 200_000
"""Piercings that are looked at."""
_ASKEW: Final = np.array(
    [(x, y, z) for x in (-0.61, 0.53) for y in (-0.59, 0.67) for z in (-0.57, 0.71)]
)
"""Directions from a piercing, in no line with what people draw."""
_RAYS: Final = np.random.default_rng(0).normal(size=(16, 3))
"""Directions to try until one meets no edge."""


class Mesh(NamedTuple):
    """vertices_mm: (v, 3). triangles: (t, 3), counterclockwise seen from free space."""

    vertices_mm: FloatArray
    triangles: IndexArray


class EnvironmentFaultError(ValueError):
    """Surroundings that cannot be used. Says what is wrong with them, and where."""

    def __init__(self, text: str, name: str = "bad_mesh") -> None:
        """name: of the kind of fault, for programs."""
        super().__init__(text)
        self.name = name

    def of(self, what: object) -> "EnvironmentFaultError":
        """The same, which says what it is about: a file."""
        return EnvironmentFaultError(f"{what}: {self}", self.name)


@dataclass(frozen=True, slots=True)
class InsertionPort:
    """Where the body comes in: touching the rim is no contact.

    A cylinder through the wall. Of the body, what is within it is not looked at.
    """

    centre_mm: tuple[float, float, float]
    inwards: tuple[float, float, float]
    """Direction of the cylinder's axis, into free space; of any length."""
    radius_mm: float
    depth_mm: float
    """From the centre inwards; outwards it has no end."""

    def __post_init__(self) -> None:
        numbers = np.array([*self.centre_mm, *self.inwards, self.radius_mm, self.depth_mm])
        if not np.isfinite(numbers).all() or not np.linalg.norm(self.inwards) > 0.0:
            raise EnvironmentFaultError("insertion port: needs finite numbers and a direction")
        if not (self.radius_mm > 0.0 and self.depth_mm >= 0.0):
            raise EnvironmentFaultError("insertion port: radius and depth must be positive")


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """A checked mesh, ready for questions. Made by `environment`."""

    vertices_mm: FloatArray
    """(v, 3)."""
    triangles: IndexArray
    """(t, 3) corners of each, counterclockwise seen from free space."""
    tree: TriangleTree
    solid_around: bool
    """Whether what is far away is solid: the free space is a cavity."""
    port: InsertionPort | None

    def solid(self, points_mm: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether each of (n, 3) points is in something solid."""
        inside: NDArray[np.bool_] = _numbers(self.tree, points_mm, self.solid_around, 1) > 0
        return inside


def environment(
    vertices_mm: NDArray[Any],
    triangles: NDArray[Any],
    free: Free | None = None,
    port: InsertionPort | None = None,
) -> Environment:
    """Check a mesh and build what questions need: a second for some 100 000 triangles.

    vertices_mm: (v, 3). triangles: (t, 3). free: on which side of the outermost surface the free
    space is; None: the normals say it. Raises EnvironmentFaultError.
    """
    vertices = np.ascontiguousarray(vertices_mm, np.float64)
    faces = np.ascontiguousarray(triangles, np.int64)
    _check_arrays(vertices, faces)
    _check_closed(vertices, faces)
    body = _bodies(vertices, faces)
    volumes = _volumes(vertices, faces, body)
    outermost = int(np.argmax(np.abs(volumes)))
    cavity = bool(volumes[outermost] < 0.0)
    if free is None or cavity == (free == "inside"):
        return _checked(vertices, faces, body, cavity, port)
    turned = np.ascontiguousarray(faces[:, ::-1])
    try:
        return _checked(vertices, turned, body, not cavity, port)
    except EnvironmentFaultError as fault:
        # Perhaps only what is outermost is the wrong way round, as when all normals point out.
        turned = np.where((body == outermost)[:, None], turned, faces)
        try:
            return _checked(vertices, turned, body, not cavity, port)
        except EnvironmentFaultError:
            raise fault from None


def _checked(
    vertices: FloatArray,
    faces: IndexArray,
    body: IndexArray,
    solid_around: bool,
    port: InsertionPort | None,
) -> Environment:
    """Raises EnvironmentFaultError where it is not clear what is solid."""
    made = Environment(vertices, faces, triangle_tree(vertices, faces), solid_around, port)
    for places in (_beside_triangles(made), _beside_piercings(made)):
        # On the surface itself a place is as good as solid.
        numbers = _numbers(made.tree, places, solid_around, 1 - int(solid_around))
        for bad in (numbers < 0, numbers > 1):
            some = np.flatnonzero(bad)
            some = some[:: 1 + some.size // _CONFIRMED]
            some = some[_all_round(made, places[some], numbers[some])]
            if some.size:
                text = _fault(made, body, places[some[0]], numbers[some[0]])
                raise EnvironmentFaultError(text, "not_clear_what_is_solid")
    return made


def _all_round(made: Environment, places: FloatArray, numbers: IndexArray) -> NDArray[np.bool_]:
    """(n,) whether it is wrong all round each of (n, 3) places too."""
    round_it = places[:, None] + _THIN_MM * np.concatenate([_ASKEW, np.eye(3), -np.eye(3)])
    found = _numbers(made.tree, round_it.reshape(-1, 3), made.solid_around, 0)
    there = found.reshape(round_it.shape[:2])
    wrong = np.where(numbers[:, None] > 1, there > 1, there < 0)
    return np.asarray(wrong.all(axis=1))


def triangle_tree(vertices_mm: FloatArray, triangles: IndexArray) -> TriangleTree:
    """A tree of boxes over (t, 3) triangles of (v, 3) vertices."""
    corners = vertices_mm[triangles]
    order = np.arange(len(triangles))
    boxes, links = np.empty((2 * len(order), 6)), np.empty((2 * len(order), 2), np.int64)
    count = build(corners.min(axis=1), corners.max(axis=1), boxes, links, order)
    return TriangleTree(
        boxes[:count].copy(),
        links[:count].copy(),
        corners[order].reshape(-1, 9),
        order,
    )


def _check_arrays(vertices: FloatArray, faces: IndexArray) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise EnvironmentFaultError("a mesh is vertices (v, 3) and triangles (t, 3)")
    if len(faces) < LEAF:
        raise EnvironmentFaultError(f"{len(faces)} triangles enclose nothing")
    if not np.isfinite(vertices).all():
        number = int(np.argwhere(~np.isfinite(vertices))[0, 0])
        raise EnvironmentFaultError(f"vertex {number} is not finite", "not_finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise EnvironmentFaultError("a triangle has a corner that is no vertex")
    size = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    if not _SMALLEST_MM <= size <= _LARGEST_MM:
        unit = "m" if size < _SMALLEST_MM else "another unit"
        raise EnvironmentFaultError(
            f"it is {size:.3g} mm large, which no surroundings are: is it written in {unit}?"
        )


def _check_closed(vertices: FloatArray, faces: IndexArray) -> None:
    """Each edge must be walked as often in one direction as in the other."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    if (start == end).any():
        number = int(np.argmax(start == end)) // 3
        raise EnvironmentFaultError(f"triangle {number} has one corner twice")
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    edges, which, times = np.unique(key, return_inverse=True, return_counts=True)
    balance = np.bincount(which, np.where(start < end, 1.0, -1.0))
    unbalanced = np.flatnonzero(balance)
    if unbalanced.size == 0:
        return
    single = np.flatnonzero(times % 2)
    place = edges[single[0] if single.size else unbalanced[0]]
    pair = vertices[[place // len(vertices), place % len(vertices)]]
    x, y, z = pair.mean(axis=0)
    if single.size:
        fault = f"not watertight: {single.size} edges have no triangle on their other side"
    else:
        fault = f"{unbalanced.size} edges are between triangles that face opposite ways"
    raise EnvironmentFaultError(f"{fault}, one near ({x:.6g}, {y:.6g}, {z:.6g}) mm", "not_closed")


def _bodies(vertices: FloatArray, faces: IndexArray) -> IndexArray:
    """(t,) number of the connected surface that each triangle belongs to."""
    rows, columns = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    joined = coo_array((np.ones(rows.size, np.int8), (rows, columns)), (len(vertices),) * 2)
    which = connected_components(joined, directed=False)[1]
    return np.unique(which[faces[:, 0]], return_inverse=True)[1].astype(np.int64)


def _volumes(vertices: FloatArray, faces: IndexArray, body: IndexArray) -> FloatArray:
    """What each body encloses, mm³; negative where its normals point inwards."""
    corners = vertices[faces] - vertices[faces[0, 0]]
    each = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    volumes = np.bincount(body, each)
    if not np.abs(volumes).max() > _NO_VOLUME * float(np.ptp(vertices, axis=0).max()) ** 3:
        raise EnvironmentFaultError("it encloses no volume")
    return np.asarray(volumes, np.float64)


def _numbers(
    tree: TriangleTree, points_mm: FloatArray, solid_around: bool, on_surface: int
) -> IndexArray:
    """(n,) how many surfaces each of (n, 3) points is within, with what is solid around."""
    windings: IndexArray = winding_numbers(tree, points_mm, _RAYS, on_surface)
    return windings + int(solid_around)


def _beside_triangles(made: Environment) -> FloatArray:
    """(n, 3) places on either side of every triangle, and more of large ones where there are few.

    Where no surface goes through another, the number is the same all along each side of a body.
    """
    corners = made.tree.corners.reshape(-1, 3, 3)  # in its order: what is near comes together
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    random = np.random.default_rng(0)
    more = random.choice(len(areas), max(0, _SPREAD - len(areas)), p=areas / areas.sum())
    which = np.concatenate([np.flatnonzero(areas > 0.0), more])
    shares = np.full((len(which), 3), 1.0 / 3.0)
    shares[len(which) - len(more) :] = random.dirichlet(np.ones(3), len(more))
    places = np.einsum("nk,nki->ni", shares, corners[which])
    aside = _BESIDE_MM * normals[which] / areas[which, None]
    return np.concatenate([places + aside, places - aside])


def _beside_piercings(made: Environment) -> FloatArray:
    """(n, 3) places in all four quarters where one surface goes through another.

    Two surfaces that go through each other have a line in common, and it ends where an edge of one
    goes through a triangle of the other. In the four quarters round it the numbers are n, twice
    n + 1, and n + 2: at least one of these is neither 0 nor 1.
    """
    faces, vertices = made.triangles[made.tree.order], made.vertices_mm
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    forwards = np.flatnonzero(ends[:, 0] < ends[:, 1])  # each edge is walked both ways
    edges, owners = ends[forwards], forwards // 3
    found, places = np.empty((_ROOM, 2), np.int64), np.empty((_ROOM, 3))
    count = piercings(made.tree, faces, vertices, edges, 0.5 * _BESIDE_MM, found, places)
    if not count:
        return np.empty((0, 3))
    normals = _unit_normals(vertices, faces)
    through, of_edge = normals[found[:count, 1]], normals[owners[found[:count, 0]]]
    ways = [np.broadcast_to(way, through.shape) for way in _ASKEW]
    for one, other in ((through, of_edge), (through, -of_edge)):
        middle = one + other
        ways += [middle, -middle]
    lengths = [np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9) for way in ways]
    units = [way / length for way, length in zip(ways, lengths, strict=True)]
    far = [_BESIDE_MM * times for times in _FARTHER]
    return np.concatenate([places[:count] + mm * unit for mm in far for unit in units])


def _unit_normals(vertices: FloatArray, faces: IndexArray) -> FloatArray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0.0, lengths, 1.0))


def _fault(made: Environment, body: IndexArray, place: FloatArray, number: int) -> str:
    """What is wrong at (3,) a place with a number that is neither 0 nor 1, and what to do."""
    x, y, z = place
    middles = made.vertices_mm[made.triangles].mean(axis=1)
    mine = body == body[np.argmin(np.square(middles - place).sum(axis=1))]
    where = (
        f"at ({x:.6g}, {y:.6g}, {z:.6g}) mm, on a surface of {mine.sum()} triangles (there are "
        f"{body.max() + 1} surfaces): winding number {number}, and it must be 0 (free) or 1 (solid)"
    )
    if number < 0:
        return (
            f"turned inside out {where}. Its normals must point out of what is solid: turn them "
            "over, say in Blender with Mesh, Normals, Flip"
        )
    if _there_twice(made.triangles):
        return f"the same triangles are there twice {where}. Take one of the copies out"
    around = (
        ". All outside of the largest surface is taken for solid, as its normals say: if that is "
        "wrong, say that it is free outside"
        if made.solid_around
        else ""
    )
    return (
        f"bodies overlap, or a surface goes through itself, {where}. Make one body of them, say in "
        f"Blender with a boolean union or Remesh{around}"
    )


def _there_twice(faces: IndexArray) -> bool:
    """Whether any triangle is there again, with the same side out."""
    first = np.argmin(faces, axis=1)[:, None]
    rolled = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return len(np.unique(rolled, axis=0)) < len(faces)
