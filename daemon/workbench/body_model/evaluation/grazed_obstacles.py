"""Solid blocks put where a body just touches them, or just does not.

A risk is easily right far from everything and deep inside something. So blocks are put, at random,
near the skin of one of the shapes that the body may have: posts, plates, and edges of large blocks.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from daemon.workbench.body_model.evaluation.shapes import box
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.environment import Environment, Mesh, environment

_SMALLEST_MM, _LARGEST_MM = 8.0, 80.0
_NEAR_BASE: Final = 0.3
"""Of the body's length, where nothing is put: there it hardly moves."""
_LEAST_SPREAD_MM: Final = 0.5
_WIDER: Final = 1.5
"""How far from touching blocks are put, against the spread of the shapes there."""
_FINE: Final = 5
"""Pieces of each piece of the centreline, of which distances are taken."""
_CUTS: Final = 4


@dataclass(frozen=True, eq=False)
class Block:
    """A solid box."""

    size_mm: FloatArray
    """(3,) of its edges."""
    axes: FloatArray
    """(3, 3) columns: directions of its edges."""
    centre_mm: FloatArray

    def distances_mm(self, places_mm: NDArray[Any]) -> FloatArray:
        """(n,) from the surface of (n, 3) places, negative inside: without any mesh."""
        beyond = np.abs((places_mm - self.centre_mm) @ self.axes) - 0.5 * self.size_mm
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))

    def touched(self, centrelines_mm: NDArray[Any], radius_mm: float) -> NDArray[np.bool_]:
        """(r,) which of (r, n, 3) bodies of this radius touch it."""
        share = np.arange(_FINE)[:, None, None, None] / _FINE
        lines = np.asarray(centrelines_mm, np.float64)
        between = (1.0 - share) * lines[:, :-1] + share * lines[:, 1:]
        count = len(lines)
        places = np.concatenate(
            [np.swapaxes(between, 0, 1).reshape(count, -1, 3), lines[:, -1:]], 1
        )
        away = self.distances_mm(places.reshape(-1, 3)).reshape(count, -1)
        return np.asarray(away.min(axis=1) <= radius_mm)

    def environment(self) -> Environment:
        """The same as triangles."""
        mesh = box(self.size_mm.tolist(), [0.0] * 3, _CUTS)
        vertices = mesh.vertices_mm @ self.axes.T + self.centre_mm
        return environment(*Mesh(vertices, mesh.triangles), free="outside")


def grazed_block(centrelines_mm: NDArray[np.float32], radius_mm: float, random: Generator) -> Block:
    """A block near the skin of one of (r, n, 3) shapes that a body may have."""
    shapes, nodes = centrelines_mm.shape[:2]
    node = int(random.integers(int(_NEAR_BASE * nodes), nodes - 1))
    line = centrelines_mm[random.integers(shapes)].astype(np.float64)
    along = line[node + 1] - line[node]
    away = np.cross(along, random.normal(size=3))
    away /= np.linalg.norm(away)
    spread_mm = float(np.std(centrelines_mm[:, node] @ away))
    gap_mm = random.normal() * _WIDER * max(spread_mm, _LEAST_SPREAD_MM)
    size = np.exp(random.uniform(np.log(_SMALLEST_MM), np.log(_LARGEST_MM), 3))
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    if random.random() < 0.5:  # a side towards the body, not a corner
        axes = np.linalg.qr(np.column_stack([away, axes[:, 1:]]))[0]
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    nearest = -0.5 * axes @ (np.sign(axes.T @ away) * size)
    if random.random() < 0.5 and abs(float(axes[:, 0] @ away)) > 1.0 - 1e-9:
        nearest = -0.5 * away * size[0]  # the middle of that side, not its corner
    return Block(size, axes, line[node] + (radius_mm + gap_mm) * away - nearest)
