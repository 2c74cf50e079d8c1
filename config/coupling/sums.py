"""Sums that a robot file names, in axes: what its coupled limits are, for whoever computes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from config.coupling.coordinates import CoordinateBase
from config.coupling.limits import CoupledLimitBase

FloatArray = NDArray[np.float64]
TruthArray = NDArray[np.bool_]


@dataclass(frozen=True)
class AxesSum:
    """Σ factors · u + constant, in mm or rad."""

    factors: FloatArray
    """(m,) one per axis."""
    constant: float = 0.0

    def at(self, u: FloatArray) -> FloatArray:
        """(...) values at (..., m) positions of the axes."""
        return np.asarray(u @ self.factors + self.constant)


@dataclass(frozen=True)
class AxesCondition:
    """A sum is near a value, or near it and all that are whole periods away."""

    sum: AxesSum
    near: float
    within: float
    period: float | None

    def met(self, u: FloatArray) -> TruthArray:
        """(...) bool, at (..., m) positions of the axes."""
        off = self.sum.at(u) - self.near
        if self.period is not None:
            off = off - self.period * np.floor(off / self.period + 0.5)
        return np.asarray(np.abs(off) < self.within)


@dataclass(frozen=True)
class AxesLimit:
    """Bounds of a sum that count while all conditions are met."""

    name: str
    reason: str
    sum: AxesSum
    lowest: float
    highest: float
    only_while: tuple[AxesCondition, ...]

    def kept(self, u: FloatArray) -> TruthArray:
        """(...) bool, at (..., m) positions of the axes."""
        value = self.sum.at(u)
        kept = (value >= self.lowest) & (value <= self.highest)
        if self.only_while:
            met = [condition.met(u) for condition in self.only_while]
            kept = kept | ~np.logical_and.reduce(met)
        return np.asarray(kept)


def coordinate_map(
    coordinates: Sequence[CoordinateBase], axes: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """(m, m) M and (m,) q₀ of u = M (q − q₀), for coordinates that have been checked."""
    columns = [[q.moves.get(name, 0.0) for name in axes] for q in coordinates]
    return np.array(columns, np.float64).T, np.array([q.at_zero for q in coordinates], np.float64)


def axes_limits(
    limits: Sequence[CoupledLimitBase],
    axes: Sequence[str],
    coordinates: Sequence[CoordinateBase],
) -> list[AxesLimit]:
    """Limits that have been checked, in axes, whose names are in the order of u."""
    known = {name: AxesSum(row) for name, row in zip(axes, np.eye(len(axes)), strict=True)}
    if coordinates:
        matrix, at_zero = coordinate_map(coordinates, axes)
        for one, row, value in zip(coordinates, np.linalg.inv(matrix), at_zero, strict=True):
            known[one.name] = AxesSum(row, float(value))
    return [
        AxesLimit(
            limit.name,
            limit.reason,
            _sum(limit.sum, known),
            -inf if limit.lowest is None else limit.lowest,
            inf if limit.highest is None else limit.highest,
            tuple(
                AxesCondition(_sum(one.sum, known), one.near, one.within, one.period)
                for one in limit.only_while
            ),
        )
        for limit in limits
    ]


def _sum(named: Mapping[str, float], known: Mapping[str, AxesSum]) -> AxesSum:
    factors = np.sum([factor * known[name].factors for name, factor in named.items()], axis=0)
    factors[np.abs(factors) < 1e-12] = 0.0  # what is left where coordinates cancel each other
    return AxesSum(factors, sum(factor * known[name].constant for name, factor in named.items()))
