"""The step nearest to a proposed one that leaves parts of the body their room, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

UNSOLVED: Final = -1
_SOFT: Final = 1e-4
"""Of what it costs to keep a row: a share by which it may be missed, so that rows that contradict
each other, or the axes' limits, have an answer."""
_TINY: Final = 1e-9

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined: Callable[..., Any] = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False
)
"""These make no arrays, and do not count who holds one."""


class Wanted(NamedTuple):
    """What the step shall do. m axes, p parts, r rows of the tip's task.

    proposed, lowest, highest, unit: (m,) the step, its limits, and how far each axis goes for the
    price of 1. slope: (p, m) of the parts' clearances, and allowed: (p,) what they may at least
    change by. task: (r, m) what the tip does, in what it shall not be asked to give up: 1 of that
    costs as much as 1 of the axes.
    """

    proposed: FloatArray
    lowest: FloatArray
    highest: FloatArray
    unit: FloatArray
    slope: FloatArray
    allowed: FloatArray
    task: FloatArray


class Room(NamedTuple):
    """Arrays for the work, made once: see `room_for`."""

    factor: FloatArray
    rows: FloatArray
    missing: FloatArray
    gram: FloatArray
    share: FloatArray
    price: FloatArray
    active: NDArray[np.int64]
    way: FloatArray


def room_for(axes: int, parts: int) -> Room:
    """For so many axes, and parts at most."""
    rows, wide = parts + 2 * axes, axes + parts
    return Room(
        np.empty((axes, axes)),
        np.empty((rows, wide)),
        np.empty(rows),
        np.empty((wide + 1, wide + 1)),
        np.empty(wide + 1),
        np.empty(wide + 1),
        np.empty(wide + 1, np.int64),
        np.empty(wide),
    )


@_kernel
def nearest_step(wanted: Wanted, room: Room, step: FloatArray) -> int:
    """Write the (m,) step; how many rows had to be looked at, or UNSOLVED.

    min ½|x − x₀|² + ½|J(x − x₀)|² with slope x ≥ allowed, softly, and lowest ≤ x ≤ highest, for x
    in `unit`. The dual active-set method (Goldfarb and Idnani, 1983): the worst row is made to hold
    while those before it go on doing so, or are let go where they pull. Every row stands as
    y = L⁻¹ c, with LLᵀ the objective's matrix: what a row does to another is their product.
    """
    axes, parts = wanted.unit.size, wanted.allowed.size
    rows = parts + 2 * axes
    _prepare(wanted, room)
    y, missing, active, price = room.rows, room.missing, room.active, room.price
    count, looked = 0, 0
    if not np.isfinite(missing[:rows].sum()):
        return UNSOLVED
    while True:
        worst, most = -1, -_TINY
        for i in range(rows):
            if missing[i] < most:
                worst, most = i, missing[i]
        if worst < 0:
            break
        own = 0.0
        while True:
            looked += 1
            if looked > 4 * rows:
                return UNSOLVED
            _shares(room, worst, count)
            square = 0.0
            for k in range(room.way.size):
                way = y[worst, k]
                for j in range(count):
                    way -= room.share[j] * y[active[j], k]
                room.way[k] = way
                square += way * way
            far, letting = np.inf, -1
            for j in range(count):
                if room.share[j] > _TINY and price[j] < far * room.share[j]:
                    far, letting = price[j] / room.share[j], j
            whole = -missing[worst] / square if square > _TINY * _TINY else np.inf
            length = min(far, whole)
            if not length < np.inf:
                return UNSOLVED
            for j in range(count):
                price[j] -= length * room.share[j]
            own += length
            if whole < np.inf:
                for i in range(rows):
                    for k in range(room.way.size):
                        missing[i] += length * y[i, k] * room.way[k]
            if whole <= far:
                active[count], price[count] = worst, own
                missing[worst] = 0.0
                count += 1
                break
            count -= 1
            for j in range(letting, count):
                active[j], price[j] = active[j + 1], price[j + 1]
    _write(wanted, room, count, step)
    return looked


@_inlined
def _prepare(wanted, room):  # type: ignore[no-untyped-def]
    """The objective's factor, the rows in it, and by how much the proposed step misses each."""
    proposed, lowest, highest, unit, slope, allowed, task = wanted
    axes, parts = unit.size, allowed.size
    factor, y, missing = room.factor, room.rows, room.missing
    for i in range(axes):
        for j in range(i + 1):
            value = 1.0 if i == j else 0.0
            for r in range(task.shape[0]):
                value += task[r, i] * unit[i] * task[r, j] * unit[j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(value) if i == j else value / factor[j, j]
    y[:] = 0.0
    for i in range(parts):
        missing[i], square = -allowed[i], 0.0
        for k in range(axes):
            missing[i] += slope[i, k] * proposed[k]
            y[i, k] = slope[i, k] * unit[k]
        square = _forwards(factor, y[i], 0, axes)
        y[i, axes + i] = np.sqrt(_SOFT * square)
    for k in range(axes):
        up, down = parts + k, parts + axes + k
        y[up, k] = 1.0
        _forwards(factor, y[up], k, axes)
        for j in range(axes):
            y[down, j] = -y[up, j]
        missing[up] = max((proposed[k] - lowest[k]) / unit[k], 0.0)
        missing[down] = max((highest[k] - proposed[k]) / unit[k], 0.0)


@_inlined
def _forwards(factor, row, first, axes):  # type: ignore[no-untyped-def]
    """L⁻¹ of a row, in its place; the square of its length."""
    square = 0.0
    for i in range(first, axes):
        value = row[i]
        for k in range(first, i):
            value -= factor[i, k] * row[k]
        row[i] = value / factor[i, i]
        square += row[i] * row[i]
    return square


@_inlined
def _shares(room, worst, count):  # type: ignore[no-untyped-def]
    """How much of each active row is in the worst one: (Y Yᵀ)⁻¹ Y y by Cholesky's factor."""
    y, gram, share, active = room.rows, room.gram, room.share, room.active
    for i in range(count):
        for j in range(i + 1):
            value = 0.0
            for k in range(y.shape[1]):
                value += y[active[i], k] * y[active[j], k]
            for k in range(j):
                value -= gram[i, k] * gram[j, k]
            gram[i, j] = np.sqrt(max(value, 1e-300)) if i == j else value / gram[j, j]
    for i in range(count):
        value = 0.0
        for k in range(y.shape[1]):
            value += y[active[i], k] * y[worst, k]
        for k in range(i):
            value -= gram[i, k] * share[k]
        share[i] = value / gram[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            share[i] -= gram[k, i] * share[k]
        share[i] /= gram[i, i]


@_inlined
def _write(wanted, room, count, step):  # type: ignore[no-untyped-def]
    """The proposed step, and what the active rows add: L⁻ᵀ Σ price · y."""
    axes, factor, way = wanted.unit.size, room.factor, room.way
    for k in range(axes):
        way[k] = 0.0
        for j in range(count):
            way[k] += room.price[j] * room.rows[room.active[j], k]
    for i in range(axes - 1, -1, -1):
        for k in range(i + 1, axes):
            way[i] -= factor[k, i] * way[k]
        way[i] /= factor[i, i]
        moved = wanted.proposed[i] + way[i] * wanted.unit[i]
        low, high = (
            min(wanted.lowest[i], wanted.proposed[i]),
            max(wanted.highest[i], wanted.proposed[i]),
        )
        step[i] = min(max(moved, low), high)
