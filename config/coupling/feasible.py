"""Whether axes can keep to coupled limits at all: linear programs over their travels.

What is allowed is one convex set for each choice of which condition of each conditional limit is
not met, and beside which of its bands; the limit itself may be kept instead.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import product
from math import inf, isfinite
from typing import Final

import numpy as np
from scipy.optimize import linprog

from config.coupling.sums import AxesCondition, AxesLimit, FloatArray

_SMALLEST_ROOM: Final = 1e-3
"""Of the travels: a set that is thinner than that has no room to move in."""
_CHOICES_AT_MOST: Final = 1000

Row = tuple[tuple[float, ...], float]
"""Factors of the axes, and the highest value of their sum."""


def has_room(limits: Sequence[AxesLimit], travels: FloatArray) -> bool:
    """Whether axes within (m, 2) travels keep to all limits somewhere, with room around."""
    options = [_options(limit, travels) for limit in limits]
    for number, choice in enumerate(product(*options)):
        if number >= _CHOICES_AT_MOST:
            return True  # so many bands: nobody means to fill the travel with them
        rows = tuple(row for option in choice for row in option)
        if _room(rows, _as_tuple(travels)) > _SMALLEST_ROOM:
            return True
    return False


def reach(limits: Sequence[AxesLimit], travels: FloatArray) -> FloatArray:
    """(m, 2) how far each axis goes at all within the limits that always count."""
    rows = tuple(
        row for limit in limits if not limit.only_while for row in _bounds(limit.sum.factors, limit)
    )
    return np.array(_reach(rows, _as_tuple(travels)))


def _options(limit: AxesLimit, travels: FloatArray) -> list[list[Row]]:
    """Each of what may be kept to instead of the others, as rows."""
    options = [list(_bounds(limit.sum.factors, limit))]
    for condition in limit.only_while:
        options += [
            list(_slab(condition.sum.factors, low, high, condition.sum.constant))
            for low, high in _beside(condition, travels)
        ]
    return options


def _bounds(factors: FloatArray, limit: AxesLimit) -> Iterator[Row]:
    return _slab(factors, limit.lowest, limit.highest, limit.sum.constant)


def _slab(factors: FloatArray, low: float, high: float, constant: float) -> Iterator[Row]:
    if isfinite(high):
        yield tuple(factors.tolist()), high - constant
    if isfinite(low):
        yield tuple((-factors).tolist()), constant - low


def _beside(condition: AxesCondition, travels: FloatArray) -> list[tuple[float, float]]:
    """The ranges beside the bands that come within the travels."""
    if condition.period is None:
        return [
            (-inf, condition.near - condition.within),
            (condition.near + condition.within, inf),
        ]
    ends = condition.sum.factors[:, None] * travels
    low = ends.min(axis=1).sum() + condition.sum.constant - condition.near
    high = ends.max(axis=1).sum() + condition.sum.constant - condition.near
    first, last = int(low // condition.period) - 1, int(high // condition.period) + 1
    last = min(last, first + _CHOICES_AT_MOST)
    return [
        (
            condition.near + k * condition.period + condition.within,
            condition.near + (k + 1) * condition.period - condition.within,
        )
        for k in range(first, last + 1)
    ]


def _as_tuple(travels: FloatArray) -> tuple[tuple[float, float], ...]:
    return tuple((float(low), float(high)) for low, high in travels)


@lru_cache(maxsize=4096)
def _room(rows: tuple[Row, ...], travels: tuple[tuple[float, float], ...]) -> float:
    """Half the side of the largest box of the travels' proportions in all rows; −1 for none."""
    low, high = np.array(travels).T
    width = high - low
    factors = np.array([row for row, _ in rows]).reshape(len(rows), len(travels))
    tops = np.array([top for _, top in rows])
    # In shares x of the travels, and r for half a side: factors·(low + width x) + |factors|·width r
    # stays below the top, and x ± r within 0 and 1.
    one = np.eye(len(travels))
    column = np.ones((len(travels), 1))
    upper = np.vstack(
        [
            np.hstack([factors * width, np.abs(factors * width).sum(axis=1, keepdims=True)]),
            np.hstack([one, column]),
            np.hstack([-one, column]),
        ]
    )
    most = np.concatenate([tops - factors @ low, np.ones(len(low)), np.zeros(len(low))])
    cost = np.zeros(len(low) + 1)
    cost[-1] = -1.0
    found = linprog(cost, A_ub=upper, b_ub=most, bounds=(None, None), method="highs")
    return float(-found.fun) if found.status == 0 else -1.0


@lru_cache(maxsize=256)
def _reach(
    rows: tuple[Row, ...], travels: tuple[tuple[float, float], ...]
) -> tuple[tuple[float, float], ...]:
    if not rows:
        return travels
    factors, tops = np.array([row for row, _ in rows]), np.array([top for _, top in rows])
    ends = []
    for cost in np.eye(len(travels)):
        found = [
            linprog(sign * cost, A_ub=factors, b_ub=tops, bounds=travels, method="highs")
            for sign in (1.0, -1.0)
        ]
        if any(one.status != 0 for one in found):
            return travels
        ends.append((float(found[0].fun), float(-found[1].fun)))
    return tuple(ends)
