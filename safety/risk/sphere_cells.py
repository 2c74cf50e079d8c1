"""The sphere cut into triangles, each into four, and so on: see `free_region_kernels`."""

from functools import cache
from itertools import product
from math import pi, sqrt
from typing import Final

import numpy as np

from safety.risk.free_region_kernels import Cells
from safety.risk.mixture import FloatArray

ROOTS: Final = 20
_LEVELS: Final = 5
"""The smallest cells are the 5120 of the fifth."""


@cache
def sphere_cells() -> Cells:
    """All cells of all levels; the first ROOTS are the icosahedron's faces."""
    level, levels = _icosahedron(), []
    for _ in range(_LEVELS):
        levels.append(level)
        level = _quartered(level)
    sizes = [len(cells) for cells in levels]
    children = np.full(sum(sizes), -1)
    inner = sum(sizes[:-1])
    children[:inner] = ROOTS + 4 * np.arange(inner)
    corners = np.concatenate(levels)
    return Cells(corners.reshape(-1, 9), _share(corners), _depth(corners), children)


def _icosahedron() -> FloatArray:
    """(20, 3, 3) corners of the faces, on the unit sphere."""
    golden = (1.0 + sqrt(5.0)) / 2.0
    flat = np.array([[0.0, a, b * golden] for a, b in product((-1.0, 1.0), repeat=2)])
    points = np.concatenate([np.roll(flat, k, axis=1) for k in range(3)])
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    near = np.isclose(apart, 2.0)
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[k, i]
    ]
    corners: FloatArray = points[np.array(faces)] / sqrt(1.0 + golden**2)
    return corners


def _quartered(cells: FloatArray) -> FloatArray:
    """Each cell's four parts, in the cells' order."""
    a, b, c = cells[:, 0], cells[:, 1], cells[:, 2]
    ab, bc, ca = (p + q for p, q in ((a, b), (b, c), (c, a)))
    ab, bc, ca = (p / np.linalg.norm(p, axis=1, keepdims=True) for p in (ab, bc, ca))
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)


def _share(cells: FloatArray) -> FloatArray:
    """(c,) solid angle of each cell, of 4π."""
    a, b, c = cells[:, 0], cells[:, 1], cells[:, 2]
    volume = np.abs(np.einsum("ci,ci->c", a, np.cross(b, c)))
    ab, bc, ca = (np.einsum("ci,ci->c", p, q) for p, q in ((a, b), (b, c), (c, a)))
    share: FloatArray = 2.0 * np.arctan2(volume, 1.0 + ab + bc + ca) / (4.0 * pi)
    return share


def _depth(cells: FloatArray) -> FloatArray:
    """(c,) distance of each flat triangle's plane from the centre: its nearest point is within."""
    normal = np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0])
    height = np.abs(np.einsum("ci,ci->c", normal, cells[:, 0]))
    depth: FloatArray = height / np.linalg.norm(normal, axis=1)
    return depth
