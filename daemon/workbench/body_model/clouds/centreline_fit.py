"""Finds the centreline of a body in what cameras have seen of its surface.

The curve is as long as the body and as smooth: its two curvatures, about axes that do not twist
about the curve, are polynomials of the arc length. Of all such curves that one is taken round which
the body's surface lies nearest to the points, those far from it counting next to nothing
(Geman and McClure 1985). What is not seen, the curve's smoothness fills in.

Points are in the base frame: the body begins on its z axis, where its `VisibleSurface` says, and
goes along z there, as well as a `Clamp` says.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product
from math import pi
from typing import Final

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from config.emulation.plants import Plant
from daemon.workbench.body_model.clouds.centreline_fit_kernels import likely, misses, placed, slopes
from safety.risk.model.mixture import FloatArray
from sim_backends.devices.body_surface import BodySurface

_PIECES: Final = 40
_BENDS: Final = (2.0, 2.0, 2.0, 2.0, 1.5, 1.2, 1.0, 0.8, 0.8)
"""Standard deviations before anything is seen, of the terms times the length, in rad."""
_TERMS: Final = len(_BENDS)
"""Of the polynomials, Legendre's, for each of the two curvatures: so many follow a tendon that goes
round the body one and a half times, and the step from one of two segments to the other."""
_LOG_STRETCH: Final = 2 * _TERMS + 2
_COUNT: Final = 2 * _TERMS + 6
_SCALES_MM: Final = (40.0, 10.0, 4.0, 1.5)
"""Where a point begins to count for less, from the first rounds to the last."""
_ROUNDS: Final = (6, 6, 6, 12)
_NEARBY, _CLOSE = 1, 2
"""The first of the scales, where a beginning is not far off, and where it is nearly right."""
_NEAR_MM: Final = 3.0
"""From the surface: so much noise is usual."""
_ENOUGH_MM: Final = 1e-3
_TRIED_POINTS: Final = 64
_TRIED_PIECES: Final = 16
_TRIED_BENDS: Final = (0.45, 1.1)
"""Of each half, in rad, and in eight directions."""
_TRIED_STRETCHES: Final = (1.0, 1.2)
_FOLLOWED: Final = 12
"""The likeliest arcs, where a beginning along the points comes to nothing."""
_GOOD: Final = (0.97, 0.06)
"""Share of near points, and of the body unseen, with which nothing else is tried."""
_FARTHEST_MM: Final = 25.0
LEAST_POINTS: Final = 30
_BELIEVED_NEAR: Final = 0.9
"""Of a cloud must lie near the surface of the body that is fitted to it."""
_BELIEVED_UNSEEN: Final = 0.2
"""Of the body's length may be without points, in one piece."""
_NEIGHBOURS: Final = (8, 16, 32)
"""Of each point, to which one can go from it: more where the points do not hang together."""
_PARTS: Final = 10
"""Of the body from base to tip, each as long as the others; the way there is by such neighbours."""
_LEAST_PARTS: Final = 5
_OF_PART: Final = 3
"""Points at least."""
_PART_MM: Final = 3.0
"""How well the middle of such points tells where the centreline is."""
_TIP: Final = 0.98
"""Of the points are nearer to the base than the tip; the others may have been matched wrongly."""

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class VisibleSurface:
    """Of a body: a tube with a round end, and disks on it, evenly spaced, the last at its tip."""

    length_mm: float
    """Usually. A body that stretches may be a quarter longer or shorter."""
    tube_radius_mm: float
    disks: int = 0
    disk_radius_mm: float = 0.0
    disk_thickness_mm: float = 3.0
    begin_mm: float = 0.0
    """Where the body begins, along z of the base frame."""
    stretch: float = 0.25
    """Standard deviation of the logarithm of how long it is, against length_mm."""

    def __post_init__(self) -> None:
        sizes = [self.length_mm, self.tube_radius_mm]
        if self.disks:
            sizes += [self.disk_radius_mm, self.disk_thickness_mm]
        sizes.append(self.stretch)
        if self.disks < 0 or not all(0.0 < size < np.inf for size in sizes):
            raise ValueError("lengths, radii and thicknesses of a body must be positive")

    @classmethod
    def of(cls, plant: Plant, actuators: Sequence[float] | FloatArray) -> "VisibleSurface":
        """What cameras see of an emulated body with its axes at (m,) actuators."""
        seen, extent = BodySurface.of(plant), plant.extent([float(at) for at in actuators])
        return cls(
            extent.length_mm,
            seen.tube_radius_mm,
            seen.disks,
            seen.disk_radius_mm,
            seen.disk_thickness_mm,
            extent.begin_mm,
            extent.stretch,
        )

    @property
    def begin(self) -> FloatArray:
        """(3,) mm, where the body begins."""
        return np.array([0.0, 0.0, self.begin_mm])

    @property
    def numbers(self) -> FloatArray:
        """As the kernels want them."""
        return np.array(
            [self.tube_radius_mm, self.disks, self.disk_radius_mm, self.disk_thickness_mm]
        )


@dataclass(frozen=True)
class Clamp:
    """How well is known how a body begins. Standard deviations."""

    begin_mm: float
    """Of where, per coordinate, from the origin."""
    tilt_rad: float
    """Of how it is turned there against z, about x and about y."""


AS_SEEN: Final = Clamp(1.5, 0.03)
"""Before anybody has looked how the cameras stand to the base."""
ALIGNED: Final = Clamp(0.05, 0.01)
"""Afterwards. A clamp holds a body half a degree askew, more or less."""


@dataclass(frozen=True, eq=False)
class FittedCentreline:
    """nodes_mm: (n, 3) from base to tip, evenly spaced."""

    nodes_mm: FloatArray
    parameters: FloatArray
    """(q,) of the curve, to begin another fit with."""
    miss_mm: float
    """Median distance of the points from the surface."""
    near: float
    """Share of the points within 3 mm of it."""
    unseen: float
    """Longest part of the body with no such point beside it, as a share of its length."""

    @property
    def begin_mm(self) -> FloatArray:
        """(3,) where the curve begins, from where the body should."""
        return self.parameters[-3:]

    @property
    def doubt(self) -> str:
        """Why no body lies in the cloud; empty: one does."""
        if self.near >= _BELIEVED_NEAR and self.unseen <= _BELIEVED_UNSEEN:
            return ""
        return (
            f"at best {self.near:.0%} of the points are near one, and {self.unseen:.0%} of it is "
            "unseen"
        )


def fit_centreline(
    points_mm: NDArray[np.floating],
    surface: VisibleSurface,
    nodes: int,
    clamp: Clamp = ALIGNED,
    begun: FittedCentreline | None = None,
) -> FittedCentreline:
    """Of (p, 3) points. Raises ValueError where they are fewer than 30 or not finite.

    begun: of nearly the same body: where that leads to a good fit, nothing else is tried.
    """
    points = np.ascontiguousarray(points_mm, np.float64) - surface.begin
    if len(points) < LEAST_POINTS or not np.isfinite(points).all():
        raise ValueError(f"a centreline needs {LEAST_POINTS} points, all of them finite")
    prior = _prior(clamp, surface.stretch)
    fit = _Fit(points, surface, prior)
    found: list[FittedCentreline] = []
    for beginnings, first in _beginnings(points, surface, prior, begun):
        found.append(fit.fitted(fit.best(beginnings, first), nodes))
        if found[-1].near >= _GOOD[0] and found[-1].unseen <= _GOOD[1]:
            return found[-1]
    return max(found, key=lambda one: one.near)


def _beginnings(
    points: FloatArray, surface: VisibleSurface, prior: FloatArray, begun: FittedCentreline | None
) -> Iterator[tuple[list[FloatArray], int]]:
    """To be tried one after the other, each with the first of the scales for it."""
    if begun is not None:
        yield [begun.parameters], _CLOSE
    along = _along_points(points, surface, prior)
    if along is not None:
        yield [along], _NEARBY
    yield _likely_beginnings(points, surface), 0


def refined(
    points_mm: NDArray[np.floating],
    surface: VisibleSurface,
    begun: FittedCentreline,
    clamp: Clamp = ALIGNED,
) -> FittedCentreline:
    """Of other (p, 3) points of the very body that `begun` is of: nothing else is tried."""
    points = np.ascontiguousarray(points_mm, np.float64) - surface.begin
    fit = _Fit(points, surface, _prior(clamp, surface.stretch))
    return fit.fitted(fit.best([begun.parameters], _CLOSE), len(begun.nodes_mm))


@cache
def _prior(clamp: Clamp, stretch: float) -> FloatArray:
    """(q,) standard deviations of all parameters before anything is seen."""
    tilt, begin = [clamp.tilt_rad] * 2, [clamp.begin_mm] * 3
    return np.array([*_BENDS, *_BENDS, *tilt, stretch, *begin])


class _Fit:
    """Levenberg and Marquardt's descent, with weights of points by where they are."""

    def __init__(self, points: FloatArray, surface: VisibleSurface, prior: FloatArray) -> None:
        self._prior = prior
        self._points, self._surface, self._numbers = points, surface, surface.numbers
        self._terms, self._bends = _terms(_PIECES), np.empty((_PIECES, 2))
        self._nodes = np.empty((_PIECES + 1, 3))
        self._pieces = np.empty(len(points), np.int64)

    def best(self, begun: list[FloatArray], first: int) -> FloatArray:
        """The best that any of these descends to: all of them roughly, that one to its end.

        first: of the scales.
        """
        (rough_mm, rounds), *finer = list(zip(_SCALES_MM, _ROUNDS, strict=True))[first:]
        rough = [self._at_scale(one, rough_mm, rounds) for one in begun]
        found = min(rough, key=lambda one: self._cost(self._misses(one), one, finer[0][0]))
        for scale_mm, rounds in finer:
            found = self._at_scale(found, scale_mm, rounds)
        return found

    def fitted(self, parameters: FloatArray, nodes: int) -> FittedCentreline:
        off = np.abs(self._misses(parameters))
        beside = np.unique(self._pieces[off < _NEAR_MM])
        gaps = np.diff(np.concatenate([[-1], beside, [_PIECES]])) - 1
        fine = np.empty((4 * (nodes - 1) + 1, 3))
        _place(parameters, self._surface.length_mm, fine)
        return FittedCentreline(
            fine[::4] + self._surface.begin,
            parameters,
            float(np.median(off)),
            float((off < _NEAR_MM).mean()),
            float(gaps.max()) / _PIECES,
        )

    def _at_scale(self, parameters: FloatArray, scale_mm: float, rounds: int) -> FloatArray:
        now = self._misses(parameters)
        cost, damping = self._cost(now, parameters, scale_mm), 1e-2
        for _ in range(rounds):
            slopes = self._slopes(parameters, now)
            weights = (1.0 + np.square(now / scale_mm)) ** -2 / scale_mm**2
            weighted = slopes.T * weights
            hessian = weighted @ slopes + np.diag(self._prior**-2)
            slope = weighted @ now + parameters / self._prior**2
            for _ in range(6):
                damped = hessian + damping * np.diag(np.diag(hessian))
                step = np.linalg.solve(damped, -slope)
                tried = parameters + step
                then = self._misses(tried)
                better = self._cost(then, tried, scale_mm)
                if better < cost:
                    break
                damping *= 6.0
            else:
                return parameters
            moved = float(np.abs(slopes @ step).max())
            parameters, now, cost, damping = tried, then, better, 0.2 * damping
            if moved < _ENOUGH_MM:
                break
        return parameters

    def _misses(self, parameters: FloatArray) -> FloatArray:
        found = np.empty(len(self._points))
        length_mm = self._surface.length_mm
        placed(parameters, self._terms, length_mm, self._bends, self._nodes)
        misses(self._points, self._nodes, self._numbers, found, self._pieces)
        return found

    def _slopes(self, parameters: FloatArray, now: FloatArray) -> FloatArray:
        """(p, q) of the misses by the parameters, which are those of the last misses."""
        found = np.empty((parameters.size, len(self._points)))
        numbers = self._surface.length_mm, self._numbers
        slopes(self._points, parameters, self._terms, *numbers, self._pieces, now, found)
        return found.T

    def _cost(self, off: FloatArray, parameters: FloatArray, scale_mm: float) -> float:
        square = np.square(off / scale_mm)
        prior = np.square(parameters / self._prior).sum()
        return 0.5 * float((square / (1.0 + square)).sum() + prior)


def _place(parameters: FloatArray, length_mm: float, nodes: FloatArray) -> None:
    """Write the nodes of a curve with these parameters."""
    pieces = len(nodes) - 1
    placed(parameters, _terms(pieces), length_mm, np.empty((pieces, 2)), nodes)


@cache
def _terms(pieces: int) -> FloatArray:
    """(pieces, terms) of the polynomials in the middle of each piece."""
    middles = (np.arange(pieces) + 0.5) / pieces
    return np.asarray(legvander(2.0 * middles - 1.0, _TERMS - 1))


def _likely_beginnings(points: FloatArray, surface: VisibleSurface) -> list[FloatArray]:
    """Arcs, each half of the body one, that lie well in the points."""
    every, curves = _tried(surface.length_mm)
    some = np.ascontiguousarray(points[:: -(-len(points) // _TRIED_POINTS)])
    off = np.empty(len(every))
    thickest_mm = max(surface.tube_radius_mm, surface.disk_radius_mm)
    likely(some, curves, surface.tube_radius_mm, thickest_mm, _FARTHEST_MM, off)
    return list(every[np.argsort(off, kind="stable")[:_FOLLOWED]])


def _along_points(
    points: FloatArray, surface: VisibleSurface, prior: FloatArray
) -> FloatArray | None:
    """A curve through the middles of parts of the body; None where they do not hang together.

    How far along the body a point is, the shortest way to it from the base says, from neighbour to
    neighbour: that also holds where the tip bends back or aside.
    """
    ways = _ways(points)
    reached = np.isfinite(ways)
    if reached.mean() < _GOOD[0] or not (tip := np.quantile(ways[reached], _TIP)) > 0.0:
        return None
    part = np.ceil(_PARTS * np.where(reached, ways, 0.0) / tip).clip(0, _PARTS)
    numbers = [k for k in range(1, _PARTS + 1) if np.count_nonzero(part == k) >= _OF_PART]
    if len(numbers) < _LEAST_PARTS:
        return None
    middles = np.array([np.median(points[part == k], axis=0) for k in numbers])
    at = 2 * np.array(numbers) - 1
    nodes = np.empty((2 * _PARTS + 1, 3))

    def off(parameters: FloatArray) -> FloatArray:
        _place(parameters, surface.length_mm, nodes)
        return np.concatenate([(nodes[at] - middles).ravel() / _PART_MM, parameters / prior])

    return np.asarray(least_squares(off, np.zeros(_COUNT), max_nfev=15).x)


def _ways(points: FloatArray) -> FloatArray:
    """(p,) lengths of the shortest ways from the base to the points; infinite: there is none."""
    places = np.concatenate([np.zeros((1, 3)), points])
    tree = cKDTree(places)
    ways = np.full(len(places), np.inf)
    for neighbours in _NEIGHBOURS:
        count = min(neighbours, len(points))
        apart, which = tree.query(places, k=count + 1)
        rows = np.repeat(np.arange(len(places)), count)
        steps = csr_matrix((apart[:, 1:].ravel(), (rows, which[:, 1:].ravel())), (len(places),) * 2)
        ways = dijkstra(steps, directed=False, indices=0)
        if np.isfinite(ways).mean() >= _GOOD[0]:
            break
    return np.asarray(ways[1:])


@lru_cache(maxsize=4)
def _tried(length_mm: float) -> tuple[FloatArray, FloatArray]:
    """Parameters of beginnings, and their curves."""
    every = np.array(_all_beginnings())
    curves = np.empty((len(every), _TRIED_PIECES + 1, 3))
    for parameters, nodes in zip(every, curves, strict=True):
        _place(parameters, length_mm, nodes)
    return every, curves


def _all_beginnings() -> list[FloatArray]:
    ways = [(0.0, 0.0)] + [
        (bend * np.cos(turn), bend * np.sin(turn))
        for bend in _TRIED_BENDS
        for turn in 0.25 * pi * np.arange(8)
    ]
    found = []
    for lower, upper, stretch in product(ways, ways, _TRIED_STRETCHES):
        parameters = np.zeros(_COUNT)
        both, apart = np.add(lower, upper), np.subtract(upper, lower)
        # Of a step in the middle, as Legendre's polynomials have it.
        for axis in range(2):
            parameters[axis * _TERMS : axis * _TERMS + 4] = (
                both[axis],
                1.5 * apart[axis],
                0.0,
                -0.875 * apart[axis],
            )
        parameters[_LOG_STRETCH] = np.log(stretch)
        found.append(parameters)
    return found
