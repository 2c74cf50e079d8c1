"""body_point_risk: how likely a random point of the body is in something solid.

This is not how likely the body touches something. The mixture has the points of all shapes of the
body in one cloud: of a body that surely has a tenth of it in the wall, this risk is a tenth. How
likely any part of it touches is `contact`'s.

Three values of it. The printed bound is equation 9 of Thompson et al. after Patil et al. (2012):
round each component's mean a convex region without obstacles, and the union bound over its planes.
The certified bound is the same region's, integrated. The near-exact value needs no region. The
bounds are never below the truth; for that the regions are made with whole triangles, since a wall
of few large ones has no vertex where it is near, and a mean in the solid counts in full.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from math import pi, prod, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.solid_share_kernels import SUMS, solid_shares
from safety.risk.surroundings.environment import Environment
from safety.risk.surroundings.free_region_kernels import MOST_PLANES, Cells, Work, mixture_bounds

# The sphere cut into triangles, each into four, and so on: see `free_region_kernels`.


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


_LITTLE: Final = 1e-6
"""In standard deviations."""
_ASKEW: Final = np.array([0.43, 0.29, 0.85])
_NO_CELLS: Final = Cells(np.empty((0, 9)), np.empty(0), np.empty(0), np.empty(0, np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class BodyPointBounds:
    """Upper bounds of body_point_risk, and what they come from. Arrays are by component."""

    printed: float
    """Equation 9, at most one."""
    certified: float | None
    """At most the printed one; None: not wanted."""
    unions: FloatArray
    """(K,) Σ (1 − Φ(b)), one where the mean is in the solid. May be above one."""
    mean_in_solid: NDArray[np.bool_]
    """(K,)."""
    distances: FloatArray
    """(K,) from the mean to the nearest surface, in standard deviations that way; beyond 6.5 it is
    no more than known to be at least so far."""
    nearest_mm: FloatArray
    """(K, 3) the point of the surface that is nearest by that measure; NaN beyond 6.5."""
    planes: NDArray[np.int64]
    """(K,) how many bound the region."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyPointValue:
    """Near-exact body_point_risk, and how it changes with the mixture."""

    value: float
    by_component: FloatArray
    """(K,) each one's own, which is also the derivative by its weight."""
    by_means: FloatArray
    """(K, 3) derivative by the means, per mm."""
    by_factors: FloatArray
    """(K, 3, 3) derivative by the factors, mm; zero below the diagonal."""


@dataclass(frozen=True, slots=True)
class PathBodyPointRisk:
    """What is made of several body_point_risks along a path. None speaks of between them."""

    product: float
    """Equation 10, 1 − Π (1 − p), as if the waypoints were independent: it grows with them."""
    total: float
    """Σ p, at most one: bounds the chance that any of the points is in something solid."""
    largest: float


class BodyPointRisk:
    """body_point_risk in one environment. Not for several threads: they would share its room.

    The insertion port is not left out: what the first part of the body has of the wall round it is
    counted, so all values are larger than without.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        tree = environment.tree
        capacity = len(tree.boxes) + len(tree.order)
        self._work = Work(
            np.empty(capacity),
            np.empty(capacity, np.int64),
            np.empty((MOST_PLANES, 4)),
            np.empty((MOST_PLANES, 7)),
        )

    def bounds(self, mixture: Mixture, certified: bool = True) -> BodyPointBounds:
        """Both bounds; the printed one alone where `certified` is False, which is quicker."""
        inside, table = self._bounds(mixture, sphere_cells() if certified else _NO_CELLS)
        ways = np.linalg.solve(mixture.factors_per_mm, table[:, 4:, None])[:, :, 0]
        return BodyPointBounds(
            min(1.0, float(mixture.weights @ table[:, 0])),
            min(1.0, float(mixture.weights @ table[:, 1])) if certified else None,
            table[:, 0],
            inside,
            table[:, 2],
            mixture.means_mm + ways,
            table[:, 3].astype(np.int64),
        )

    def printed(self, mixture: Mixture) -> float:
        """The printed bound, and nothing else."""
        table = self._bounds(mixture, _NO_CELLS)[1]
        return min(1.0, float(mixture.weights @ table[:, 0]))

    def near_exact(self, mixture: Mixture) -> BodyPointValue:
        """The value itself to about 1e-4 of it, and its derivatives."""
        inside, table = self._bounds(mixture, _NO_CELLS)
        if not table[:, 2].all():
            mixture = _off_the_surface(mixture, table[:, 2] == 0.0)
            inside, table = self._bounds(mixture, _NO_CELLS)
        sums = np.empty((mixture.components, SUMS))
        weights, factors = mixture.weights, mixture.factors_per_mm
        with np.errstate(divide="ignore"):  # a weight of zero is a mixture's right
            heights = np.log(weights)
        levels = 2.0 * (heights - (heights - 0.5 * table[:, 2] ** 2).max())
        solid_shares(self._environment.tree, mixture.means_mm, factors, levels, inside, sums)
        by_means = weights[:, None] * np.einsum("kij,ki->kj", factors, sums[:, 1:4])
        curved = sums[:, 4:].reshape(-1, 3, 3) @ np.linalg.inv(factors).transpose(0, 2, 1)
        by_factors = weights[:, None, None] * np.triu(curved)
        shares = np.clip(sums[:, 0], 0.0, 1.0)
        return BodyPointValue(float(weights @ shares), shares, by_means, by_factors)

    def _bounds(self, mixture: Mixture, cells: Cells) -> tuple[NDArray[np.bool_], FloatArray]:
        """(K,) whether the mean is in the solid, and (K, 7) union, certified bound, distance,
        planes, and the nearest point as the component sees it."""
        if mixture.dimensions != 3:
            raise ValueError(f"points of the body have 3 coordinates, not {mixture.dimensions}")
        means, factors = mixture.means_mm, mixture.factors_per_mm
        inside = self._environment.solid(means)
        table = np.empty((mixture.components, 7))
        tree = self._environment.tree
        mixture_bounds(tree, means, factors, inside, self._work, cells, ROOTS, table)
        return inside, table


def _off_the_surface(mixture: Mixture, which: NDArray[np.bool_]) -> Mixture:
    """The means that are on it moved by a little, so that they are on one side."""
    ways = np.linalg.solve(mixture.factors_per_mm, np.full((mixture.components, 3, 1), _LITTLE))
    means = mixture.means_mm + which[:, None] * ways[:, :, 0] * _ASKEW
    return Mixture(mixture.weights, means, mixture.factors_per_mm)


def along_path(body_point_risks: Sequence[float]) -> PathBodyPointRisk:
    """What the waypoints' own body_point_risks give for the path."""
    return PathBodyPointRisk(
        1.0 - prod(1.0 - risk for risk in body_point_risks),
        min(1.0, sum(body_point_risks)),
        max(body_point_risks, default=0.0),
    )
