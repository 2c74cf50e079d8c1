"""Where the tip is as a cubic of all axes: the Jacobian of a body over the whole of its travel.

Receptive fields know nothing of their neighbours. After some minutes of random motion a field has a
hundred samples of a few lines, and its Jacobian is the mean of what differs twofold within it: a
pneumatic body is three times as soft with its chambers long as with them short. A cubic of all axes
has 83 coefficients for six axes and a coordinate, and all motions tell all of them. It is a shape
and not any Jacobian that changes from place to place: what a motion there and back would gain is
nothing, which saves two thirds of the coefficients of a quadratic Jacobian.

Friction makes a motion after a turn shorter than one that goes on (`stop_operators`). So the cubic
is one of the axes without what they hold back, by the share that foretells motions best.

Of bodies that are no such shape, or of too few motions, it misses lines that it was not learnt
from: then the fields are the better guess.
"""

from itertools import combinations_with_replacement
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from daemon.learning.forward.stop_operators import HeldBack, free_places
from daemon.learning.samples.motion import MotionTable
from drivers.pose import Vector

_RIDGE: Final = 3e-3
"""Of coefficients in mm, where a motion weighs by its noise: hardly any, but the equations are
sound."""
_NOISE_MM: Final = 0.3
_RELATIVE_NOISE: Final = 0.1
"""Of a motion: the tracker's, and hysteresis."""
_PARTS: Final = 5
"""Of the lines, each kept back once where it is asked how well lines are foretold."""
_LINES_AT_LEAST: Final = 2 * _PARTS
_MOTIONS_PER_COEFFICIENT: Final = 5
"""At least: fewer tell less than they cost."""
_STOOD: Final = 1e-4
"""Of how far the axis went that went farthest, in mm or rad: one that went no farther than this
stood still, and what it seems to have done is its encoder's. In shares of that, a step of it would
be thousands of its ways, and noise a large Jacobian."""
_HELD_BACK: Final = (0.0, 0.15, 0.3, 0.45, 0.6)
"""Shares that are tried; between the best ones a parabola tells."""
_FreeAxes = tuple[Vector, Vector]
"""(n, m) axes without what the body holds back, before and after each motion."""


class CubicShape(NamedTuple):
    """p = p₀ + a x + b x x + c x x x in each coordinate, x being axes from the middle of where they
    have been, in halves of it, and without what hysteresis holds back."""

    middle: Vector
    """(m,)"""
    half: Vector
    """(m,)"""
    linear: Vector
    """(3, m)"""
    square: Vector
    """(3, m, m), symmetric."""
    cube: Vector
    """(3, m, m, m), symmetric."""
    held_back: HeldBack
    """What axes that turn keep back."""
    unforetold: float
    """What is left, as in `unforetold`, by cubics that were learnt from other lines."""

    @classmethod
    def of(cls, motions: MotionTable) -> Self | None:
        """None: they are too few."""
        terms, lines = _terms(motions.axes), np.unique(motions.line)
        if len(motions) < _MOTIONS_PER_COEFFICIENT * len(terms) or len(lines) < _LINES_AT_LEAST:
            return None
        middle, half = _travel(motions)
        left = [unforetold_by_cubics(motions, _free(motions, share)) for share in _HELD_BACK]
        share = _lowest(left)
        features, tips = _weighted(motions, terms, _free(motions, share))
        tensors = _tensors(_solved(*_gram(features, tips)), terms, motions.axes)
        held_back = HeldBack(share, middle - half, 2.0 * half)
        return cls(middle, half, *tensors, held_back, min(left))

    def jacobian(self, u: Vector) -> Vector:
        """(3, m) mm per mm or rad at (m,) axes; beyond where they have been, as at its edge."""
        x = np.clip((u - self.middle) / self.half, -1.0, 1.0)
        slopes = self.linear + (2.0 * self.square + 3.0 * self.cube @ x) @ x
        return np.asarray(slopes / self.half)


def unforetold_by_cubics(motions: MotionTable, free: _FreeAxes | None = None) -> float:
    """What is left, as in `unforetold`, by cubics that were learnt from other lines.

    free: the axes without what the body holds back; None: it holds nothing back.
    """
    free = _free(motions, 0.0) if free is None else free
    features, tips = _weighted(motions, _terms(motions.axes), free)
    part_of = np.unique(motions.line, return_inverse=True)[1] % _PARTS
    parts = [np.flatnonzero(part_of == part) for part in range(_PARTS)]
    grams = [_gram(features[part], tips[part]) for part in parts]
    left = np.zeros_like(tips)
    for kept_back, part in enumerate(parts):
        others = _summed(grams[:kept_back] + grams[kept_back + 1 :])
        left[part] = tips[part] - features[part] @ _solved(*others)
    return _root_mean_square(left) / _root_mean_square(tips)


def _lowest(left: list[float]) -> float:
    """The share of `_HELD_BACK` with which least is left."""
    best = int(np.argmin(left))
    if best in (0, len(left) - 1):
        return _HELD_BACK[best]
    before, here, after = left[best - 1 : best + 2]
    spacing, bend = _HELD_BACK[1] - _HELD_BACK[0], before - 2.0 * here + after
    return _HELD_BACK[best] + spacing * 0.5 * (before - after) / bend


def unforetold(motions: MotionTable, said_mm: Vector) -> float:
    """What is left of motions by (n, 3) mm that was said of them: a share of their root mean
    square, each weighed by its noise."""
    weights, tips = _weights(motions), motions.delta_tip_mm
    return _root_mean_square(weights * (tips - said_mm)) / _root_mean_square(weights * tips)


def _root_mean_square(values: Vector) -> float:
    return float(np.sqrt((values**2).mean()))


def _weights(motions: MotionTable) -> Vector:
    """(n, 1) per mm."""
    noise_mm2 = _NOISE_MM**2 + _RELATIVE_NOISE**2 * (motions.delta_tip_mm**2).sum(axis=1)
    return np.asarray(1.0 / np.sqrt(noise_mm2)[:, None])


def _travel(motions: MotionTable) -> tuple[Vector, Vector]:
    """(m,) middle and half of where the axes have been; of one that stood still, as far as any."""
    lowest, highest = motions.u.min(axis=0), motions.u.max(axis=0)
    half = 0.5 * (highest - lowest)
    farthest = float(half.max())
    stood = half <= _STOOD * farthest
    return 0.5 * (lowest + highest), np.where(stood, farthest if farthest > 0.0 else 1.0, half)


def _free(motions: MotionTable, share: float) -> _FreeAxes:
    """A body that holds back that share: motions follow each other as they stand in the table."""
    before, after = motions.u, motions.u + motions.delta_u
    if share == 0.0:
        return before, after
    middle, half = _travel(motions)
    lowest, travel = middle - half, 2.0 * half
    places = np.stack([before, after], axis=1).reshape(-1, motions.axes)
    free = lowest + travel * free_places((places - lowest) / travel, share)
    return free[::2], free[1::2]


_Terms = list[tuple[int, ...]]


def _terms(axes: int) -> _Terms:
    """The axes that are multiplied, for each coefficient."""
    return [
        chosen
        for degree in (1, 2, 3)
        for chosen in combinations_with_replacement(range(axes), degree)
    ]


def _weighted(motions: MotionTable, terms: _Terms, free: _FreeAxes) -> tuple[Vector, Vector]:
    """(n, k) change of each term in a motion, and (n, 3) of the tip, weighed by its noise."""
    middle, half = _travel(motions)
    before, after = (_products((axes - middle) / half, terms) for axes in free)
    weights = _weights(motions)
    return weights * (after - before), weights * motions.delta_tip_mm


def _products(x: Vector, terms: _Terms) -> Vector:
    """(n, k)"""
    products: dict[tuple[int, ...], Vector] = {
        (axis,): of_axis for axis, of_axis in enumerate(np.ascontiguousarray(x.T))
    }
    for chosen in terms:
        if len(chosen) > 1:
            products[chosen] = products[chosen[:-1]] * products[chosen[-1:]]
    return np.stack([products[chosen] for chosen in terms], axis=1)


def _gram(features: Vector, tips: Vector) -> tuple[Vector, Vector]:
    """(k, k) and (k, 3) products of least squares."""
    return features.T @ features, features.T @ tips


def _summed(grams: list[tuple[Vector, Vector]]) -> tuple[Vector, Vector]:
    squares, products = zip(*grams, strict=True)
    return np.sum(squares, axis=0), np.sum(products, axis=0)


def _solved(squares: Vector, products: Vector) -> Vector:
    """(k, 3)"""
    return np.asarray(np.linalg.solve(squares + _RIDGE * np.eye(len(squares)), products))


def _tensors(coefficients: Vector, terms: _Terms, axes: int) -> tuple[Vector, Vector, Vector]:
    tensors: list[NDArray[np.float64]] = [np.zeros((3, *degree * (axes,))) for degree in (1, 2, 3)]
    for chosen, coefficient in zip(terms, coefficients, strict=True):
        places = set(_orders(chosen))
        for place in places:
            index: tuple[slice | int, ...] = (slice(None), *place)
            tensors[len(chosen) - 1][index] = coefficient / len(places)
    linear, square, cube = tensors
    return linear, square, cube


def _orders(chosen: tuple[int, ...]) -> list[tuple[int, ...]]:
    if len(chosen) <= 1:
        return [chosen]
    return [
        (one, *rest)
        for place, one in enumerate(chosen)
        for rest in _orders(chosen[:place] + chosen[place + 1 :])
    ]
