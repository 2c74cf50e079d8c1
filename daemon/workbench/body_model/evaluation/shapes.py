"""Surroundings to try things in: boxes, balls, a slot, and a cavity like that of a chest.

All are closed; their normals point into free space.
"""

from collections.abc import Sequence
from math import pi, sqrt
from typing import Final

import numpy as np

from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.environment import InsertionPort, Mesh

CHEST_PORT: Final = InsertionPort((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius_mm=10.0, depth_mm=30.0)
"""The arm comes in at the origin, along z."""
_CHEST_MM: Final = (140.0, 95.0, 130.0)
"""Half axes: up, forwards and across, which is where the arm comes from."""
_BULGES: Final = (  # from where, how far into the cavity in mm, how wide in rad
    ((-1.0, 0.0, 0.15), 50.0, 0.5),  # the diaphragm
    ((-0.3, 0.55, 0.8), 40.0, 0.4),  # the heart
    ((0.8, -0.5, 0.5), 25.0, 0.4),  # the lung
)
_RIB_MM, _RIB_SPACING_MM = 3.0, 26.0
_WAVES, _WAVE_MM = 12, 6.0
_APART_MM: Final = 2.0


def box(size_mm: Sequence[float], centre_mm: Sequence[float], cuts: int = 1) -> Mesh:
    """A solid box; each edge in `cuts` equal parts, each of its sides in cuts² times two."""
    i, j = (index.ravel() for index in np.indices((cuts, cuts)))
    # Two halves of each square, as steps from its corner.
    halves = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]])
    flat = (np.stack([i, j], axis=1)[:, None, None] + halves).reshape(-1, 3, 2)
    sides = []
    for axis in range(3):
        for end in (0, 1):
            corners = np.empty((len(flat), 3, 3), np.int64)
            corners[:, :, axis] = end * cuts
            corners[:, :, (axis + 1) % 3] = flat[:, :, 0]
            corners[:, :, (axis + 2) % 3] = flat[:, :, 1]
            sides.append(corners if end else corners[:, ::-1])
    places, faces = np.unique(np.concatenate(sides).reshape(-1, 3), axis=0, return_inverse=True)
    vertices = np.asarray(centre_mm) + (places / cuts - 0.5) * np.asarray(size_mm)
    return Mesh(vertices, faces.reshape(-1, 3).astype(np.int64))


def ball(radius_mm: float, centre_mm: Sequence[float], triangles: int) -> Mesh:
    """A solid ball of about equal triangles, an even number of them."""
    directions, faces = sphere(triangles)
    return Mesh(np.asarray(centre_mm) + radius_mm * directions, faces)


def sphere(triangles: int) -> Mesh:
    """The unit sphere with its corners on a spiral, evenly. triangles: even, from 8 on."""
    if triangles < 8 or triangles % 2:
        raise ValueError(f"a sphere has an even number of triangles, from 8 on, not {triangles}")
    number = np.arange(triangles // 2 + 2) + 0.5
    height = 1.0 - 2.0 * number / number.size
    turn = pi * (1.0 + sqrt(5.0)) * number
    flat = np.sqrt(1.0 - height**2)
    points = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    from scipy.spatial import ConvexHull  # half of scipy, which no running daemon needs

    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = (points[faces[:, k]] for k in range(3))
    inwards = np.einsum("ti,ti->t", np.cross(b - a, c - a), a) < 0.0
    faces[inwards] = faces[inwards, ::-1]
    return Mesh(points, faces[np.lexsort(faces.T)])


def turned(mesh: Mesh) -> Mesh:
    """What was solid is free, and the other way round."""
    return Mesh(mesh.vertices_mm, np.ascontiguousarray(mesh.triangles[:, ::-1]))


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """All of them. They must not touch or overlap."""
    starts = np.cumsum([0, *(len(mesh.vertices_mm) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_mm for mesh in meshes]),
        np.concatenate([mesh.triangles + s for mesh, s in zip(meshes, starts, strict=True)]),
    )


def quartered(mesh: Mesh) -> Mesh:
    """The same surface, each triangle cut into four."""
    faces, count = mesh.triangles, len(mesh.vertices_mm)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, which = np.unique(ends, axis=0, return_inverse=True)
    middle = count + which.reshape(-1, 3)  # of ab, bc, ca
    a, b, c = faces.T
    ab, bc, ca = middle.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return Mesh(
        np.concatenate([mesh.vertices_mm, mesh.vertices_mm[edges].mean(axis=1)]),
        np.concatenate([np.stack(part, axis=1) for part in parts]),
    )


def balls(count: int, triangles: int, seed: int) -> Mesh:
    """Solid balls of 8 to 20 mm radius that do not touch, beside an arm along z from the origin."""
    random = np.random.default_rng(seed)
    found: list[tuple[FloatArray, float]] = []
    while len(found) < count:
        centre = random.uniform((-90.0, -90.0, 30.0), (90.0, 90.0, 200.0))
        radius = random.uniform(8.0, 20.0)
        free = radius + 12.0 < np.hypot(centre[0], centre[1])
        if free and all(np.linalg.norm(centre - c) > radius + r + _APART_MM for c, r in found):
            found.append((centre, radius))
    each = max(8, 2 * (triangles // (2 * count)))
    return joined([ball(radius, centre.tolist(), each) for centre, radius in found])


def slot(gap_mm: float, cuts: int) -> Mesh:
    """Two solid plates, `gap_mm` apart in x, with an arm along z from the origin between them."""
    size, away = (20.0, 160.0, 240.0), 0.5 * gap_mm + 10.0
    return joined([box(size, (side * away, 0.0, 120.0), cuts) for side in (-1.0, 1.0)])


def chest(triangles: int, seed: int) -> Mesh:
    """A cavity: diaphragm, heart and lung bulge into it, ribs are under its wall.

    The arm comes in at the origin, along z: CHEST_PORT. triangles: even. seed: of its unevenness.
    """
    directions, faces = sphere(triangles)
    radius = 1.0 / np.linalg.norm(directions / np.array(_CHEST_MM), axis=1)
    for source, depth_mm, width in _BULGES:
        towards = np.asarray(source) / np.linalg.norm(source)
        angle = np.arccos(np.clip(directions @ towards, -1.0, 1.0))
        radius -= depth_mm * np.exp(-0.5 * (angle / width) ** 2)
    up = radius * directions[:, 0]
    under_ribs = np.clip(1.2 * np.abs(directions[:, 1]) - directions[:, 2], 0.0, 1.0)
    radius -= _RIB_MM * under_ribs * np.cos(2.0 * pi * up / _RIB_SPACING_MM)
    radius += _unevenness(directions, seed)
    vertices = radius[:, None] * directions
    wall = radius[np.argmin(directions[:, 2])]
    vertices[:, 2] += wall
    return turned(Mesh(vertices, faces))


def _unevenness(directions: FloatArray, seed: int) -> FloatArray:
    """(n,) mm, smooth."""
    random = np.random.default_rng(seed)
    waves = random.normal(0.0, 2.5, (_WAVES, 3))
    phases = random.uniform(0.0, 2.0 * pi, _WAVES)
    uneven: FloatArray = np.cos(directions @ waves.T + phases).mean(axis=1)
    return _WAVE_MM * uneven
