"""What surrounds the body: closed surfaces of triangles, and on which side of them it may be.

Normals point out of what is solid, into free space. So a tumour has its normals outwards, and a
chest cavity inwards: around it, everything is solid. Where a mesh was made the other way round,
`free` says so, and it is turned over.
"""

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from safety.risk.mixture import FloatArray, IndexArray
from safety.risk.triangle_tree_kernels import LEAF, TriangleTree, build, winding_numbers

Free = Literal["inside", "outside"]
Unit = Literal["mm", "cm", "m", "in"]

MM_PER: Final[dict[Unit, float]] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_SMALLEST_MM, _LARGEST_MM = 5.0, 5000.0
_NO_VOLUME: Final = 1e-9
"""Of the cube around the mesh: what encloses less is flat."""
_RAYS: Final = np.random.default_rng(0).normal(size=(16, 3))
"""Directions to try until one meets no edge."""


class EnvironmentFaultError(ValueError):
    """A mesh that cannot be used. Says what is wrong with it, and where."""


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
        around = 1 if self.solid_around else 0
        inside: NDArray[np.bool_] = winding_numbers(self.tree, points_mm, _RAYS) + around > 0
        return inside


def environment(
    vertices_mm: NDArray[Any],
    triangles: NDArray[Any],
    free: Free | None = None,
    port: InsertionPort | None = None,
) -> Environment:
    """Check a mesh and build what questions need.

    vertices_mm: (v, 3). triangles: (t, 3). free: on which side of the outermost surface the free
    space is; None: the normals say it. Raises EnvironmentFaultError.
    """
    vertices = np.ascontiguousarray(vertices_mm, np.float64)
    faces = np.ascontiguousarray(triangles, np.int64)
    _check_arrays(vertices, faces)
    _check_closed(vertices, faces)
    volume = _volume(vertices, faces)
    if free is not None and (volume < 0.0) != (free == "inside"):
        faces, volume = np.ascontiguousarray(faces[:, ::-1]), -volume
    return Environment(vertices, faces, triangle_tree(vertices, faces), volume < 0.0, port)


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
        raise EnvironmentFaultError(f"vertex {number} is not finite")
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
    raise EnvironmentFaultError(f"{fault}, one near ({x:.6g}, {y:.6g}, {z:.6g}) mm")


def _volume(vertices: FloatArray, faces: IndexArray) -> float:
    """What the surface encloses, mm³; negative where its normals point inwards."""
    corners = vertices[faces] - vertices[faces[0, 0]]
    volume = float(np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    if not abs(volume) > _NO_VOLUME * float(np.ptp(vertices, axis=0).max()) ** 3:
        raise EnvironmentFaultError("it encloses no volume")
    return volume
