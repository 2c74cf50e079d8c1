"""A step turned aside, so that parts of the body keep their room, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself. What belongs together is handed over in few arrays, because each
costs a tenth of a microsecond.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STAYS, ASIDE, UNSOLVED = 0, 1, -1
TASK_ROWS: Final = 6
_RESERVE_MM: Final = 0.5
"""h₀: the gate counts the way there too, and braking."""
_CLOSER_PER_S: Final = 4.0
"""γ."""
_LEAST_SLOPE_MM_S: Final = 1.0
"""With all axes at full speed. Where less clearance is gained by that, there is no way along."""
_GAINS_FROM: Final = 0.5
"""Of what the tip would give up without its task in view; with more than that, nothing is gained.
Chosen: arms that can give way ask for a tenth to a fifth, those that cannot for nine tenths."""
_SOFT: Final = 1e-4
"""Of what it costs to keep a row: a share by which it may be missed, so that rows that contradict
each other, or the axes' limits, have an answer."""
_TINY: Final = 1e-9
_LOWEST, _HIGHEST, _SPEED, _SLACK, _TIGHT = range(5)
"""Rows of what axes may do ..."""
_CONSTANT, _LEAST, _MOST, _FASTEST, _FACTORS = range(5)
"""... columns of coupled limits ..."""
_OF, _OFFSET, _VALUE, _WITHIN, _PERIOD, _WEIGHTS = range(6)
"""... and of their conditions; the last of each is the first of m."""
_PLACE, _TASKS = 0, 3
"""Rows of what the axes do to the tip."""
_MISSING, _ALLOWED, _SHARE, _PRICE, _WAY, _LOW, _HIGH, _STEP = range(8)
"""Rows of the room for the work."""

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined: Callable[..., Any] = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False
)
"""These make no arrays, and do not count who holds one."""


class Bounds(NamedTuple):
    """What m axes may do. axes: (5, m) lowest and highest place, highest speed, and the tensions
    below which no tendon is let out, and above which none is pulled; infinite: at none.

    limits: (l, 4 + m) of what they may not do together: constant, lowest, highest and fastest
    change of a sum, and its factors. conditions: (c, 5 + m) of a limit that counts only while they
    are met: which limit, constant of the sum, value that it is near, how near, after how much it
    comes round (0: never), and its factors.
    """

    axes: FloatArray
    limits: FloatArray
    conditions: FloatArray


class Near(NamedTuple):
    """A clearance. u: (m,) where it is of.

    rows: (1 + p, m + 2) of the whole body, and of its parts: slope, mm, and the square of what
    is gained with all axes at full speed, mm²/s². tip: (15, m) of the tip's place, mm; and of its
    task as it counts beside the axes, six rows where it may point anywhere and six where not.
    """

    u: FloatArray
    rows: FloatArray
    tip: FloatArray


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

    matrices: FloatArray
    rows: FloatArray
    slope: FloatArray
    vectors: FloatArray
    active: NDArray[np.int64]


def room_for(axes: int, parts: int) -> Room:
    """For so many axes, and parts and sides of coupled limits at most."""
    rows, wide = parts + 2 * axes, axes + parts
    return Room(
        np.empty((2, wide + 1, wide + 1)),
        np.empty((rows, wide)),
        np.empty((parts, axes)),
        np.empty((_STEP + 1, rows + 1)),
        np.empty(wide + 1, np.int64),
    )


@_kernel
def turn_aside(bounds, near, room, asked, dt_s, points, found):  # type: ignore[no-untyped-def]
    """Write the (m + 1,) step to take, and how many mm it leads the tip from where it was to go.

    asked: (3, m) proposed step, where the axes are told to be, and measured tensions, NaN: unknown.
    points: whether the tip's direction is part of its task. Returns ASIDE, or STAYS where the
    proposed step may stay as it is, or nothing can be said.
    """
    axes, parts, short = asked.shape[1], 0, False
    proposed, low, high = asked[0], room.vectors[_LOW], room.vectors[_HIGH]
    speed, step, allowed = bounds.axes[_SPEED], room.vectors[_STEP], room.vectors[_ALLOWED]
    whole = False
    for i in range(near.rows.shape[0]):
        if near.rows[i, axes + 1] < _LEAST_SLOPE_MM_S * _LEAST_SLOPE_MM_S:
            continue
        change, least = _changes(near, i, asked, dt_s)
        if i == 0:
            whole = change < least
            share = (least - change) / near.rows[i, axes + 1]
            for k in range(axes):
                found[k] = proposed[k] + share * near.rows[i, k] * speed[k] * speed[k]
        else:
            room.slope[parts], allowed[parts] = near.rows[i, :axes], least
            short, parts = short or change < least, parts + 1
    first = _TASKS + (TASK_ROWS if points else 0)
    task = near.tip[first : first + TASK_ROWS]
    if short:
        parts = _coupled(bounds, asked, dt_s, room, parts)
        _within(bounds, asked, dt_s, low, high)
        slope = room.slope[:parts]
        wanted = Wanted(proposed, low[:axes], high[:axes], speed, slope, allowed[:parts], task)
        short = nearest_step(wanted, room, step[:axes]) != UNSOLVED
    if not (whole or short):
        return STAYS
    if short and (
        not whole
        or _strains(bounds, asked, found)
        or _given_up(task, step, proposed)
        <= _GAINS_FROM * _GAINS_FROM * _given_up(task, found, proposed)
    ):
        found[:axes] = step[:axes]
    found[axes] = np.sqrt(_given_up(near.tip[_PLACE:_TASKS], found, proposed))
    return ASIDE


@_inlined
def _changes(near, i, asked, dt_s):  # type: ignore[no-untyped-def]
    """By how much the proposed step changes a clearance, and by how much it may at least."""
    axes, change = asked.shape[1], 0.0
    here = near.rows[i, axes]
    for k in range(axes):
        here += near.rows[i, k] * (asked[1, k] - near.u[k])
        change += near.rows[i, k] * asked[0, k]
    return change, -min(1.0, _CLOSER_PER_S * dt_s) * (here - _RESERVE_MM)


@_inlined
def _within(bounds, asked, dt_s, low, high):  # type: ignore[no-untyped-def]
    """Lowest and highest step: travel and speed, or what was proposed where that is beyond them;
    and no tendon that hardly pulls is let out, nor one pulled that pulls nearly as much as it may,
    whatever was proposed."""
    limits = bounds.axes
    for k in range(asked.shape[1]):
        at, pull, most = asked[1, k], asked[2, k], limits[_SPEED, k] * dt_s
        low[k] = min(max(min(limits[_LOWEST, k] - at, 0.0), -most), asked[0, k])
        high[k] = max(min(max(limits[_HIGHEST, k] - at, 0.0), most), asked[0, k])
        if pull < limits[_SLACK, k]:
            low[k] = 0.0
        if pull > limits[_TIGHT, k]:
            high[k] = 0.0


@_inlined
def _strains(bounds, asked, step):  # type: ignore[no-untyped-def]
    """Whether a step lets a tendon out that hardly pulls, or pulls one that pulls nearly as much as
    it may."""
    for k in range(asked.shape[1]):
        slack, tight = asked[2, k] < bounds.axes[_SLACK, k], asked[2, k] > bounds.axes[_TIGHT, k]
        if (slack and step[k] < 0.0) or (tight and step[k] > 0.0):
            return True
    return False


@_kernel
def keep_coupled(bounds, room, asked, task, dt_s, found):  # type: ignore[no-untyped-def]
    """Write the (m,) step that keeps the coupled limits, where the proposed one does not.

    asked: as for `turn_aside`. task: (r, m) what the axes do to the tip as it counts beside them.
    Returns ASIDE, or STAYS where the proposed step may stay as it is, or nothing can be said.
    """
    axes, short = asked.shape[1], False
    rows = _coupled(bounds, asked, dt_s, room, 0)
    slope, allowed = room.slope[:rows], room.vectors[_ALLOWED]
    for i in range(rows):
        change = 0.0
        for k in range(axes):
            change += slope[i, k] * asked[0, k]
        short = short or change < allowed[i] - _TINY
    if not short:
        return STAYS
    low, high = room.vectors[_LOW], room.vectors[_HIGH]
    _within(bounds, asked, dt_s, low, high)
    speed = bounds.axes[_SPEED]
    wanted = Wanted(asked[0], low[:axes], high[:axes], speed, slope, allowed[:rows], task)
    return ASIDE if nearest_step(wanted, room, found) != UNSOLVED else STAYS


@_inlined
def _coupled(bounds, asked, dt_s, room, parts):  # type: ignore[no-untyped-def]
    """Put the coupled limits that a step could come near to behind so many parts, and return how
    many rows there are then. What is beyond a limit already needs not come back."""
    limits, conditions, closer = bounds.limits, bounds.conditions, min(1.0, _CLOSER_PER_S * dt_s)
    axes, allowed = asked.shape[1], room.vectors[_ALLOWED]
    for i in range(limits.shape[0]):
        kept_by, left = _kept_by(bounds, i, asked, dt_s)
        if left == np.inf:
            continue
        if kept_by >= 0:
            off = _off(conditions, kept_by, asked[1])
            for k in range(axes):
                room.slope[parts, k] = np.sign(off) * conditions[kept_by, _WEIGHTS + k]
            allowed[parts] = -closer * (abs(off) - conditions[kept_by, _WITHIN])
            parts += 1
            continue
        value = _sum(limits, i, _FACTORS, asked[1]) + limits[i, _CONSTANT]
        for side in (1.0, -1.0):
            beyond = value - limits[i, _LEAST] if side > 0.0 else limits[i, _MOST] - value
            if closer * beyond < limits[i, _FASTEST] * dt_s:
                for k in range(axes):
                    room.slope[parts, k] = side * limits[i, _FACTORS + k]
                allowed[parts] = -closer * max(beyond, 0.0)
                parts += 1
    return parts


@_inlined
def _kept_by(bounds, i, asked, dt_s):  # type: ignore[no-untyped-def]
    """What a limit is kept by: a condition that is not met, or its own sum, -1; and the share of
    the proposed step that is left then, infinite where no step comes near.

    Of those that hold where the step begins the one is kept that leaves most.
    """
    limits, conditions, closer = bounds.limits, bounds.conditions, min(1.0, _CLOSER_PER_S * dt_s)
    value = _sum(limits, i, _FACTORS, asked[1]) + limits[i, _CONSTANT]
    below, above = closer * (value - limits[i, _LEAST]), closer * (limits[i, _MOST] - value)
    kept_by, most = -1, -np.inf
    if below >= 0.0 and above >= 0.0:
        change, far = _sum(limits, i, _FACTORS, asked[0]), limits[i, _FASTEST] * dt_s
        most = min(_left(change, below), _left(-change, above))
        most = np.inf if min(below, above) >= far else most
    for c in range(conditions.shape[0]):
        off = _off(conditions, c, asked[1])
        beside = closer * (abs(off) - conditions[c, _WITHIN])
        if conditions[c, _OF] != i or beside < 0.0:
            continue
        left = _left(np.sign(off) * _sum(conditions, c, _WEIGHTS, asked[0]), beside)
        if beside >= _fastest(conditions, c, bounds.axes[_SPEED]) * dt_s:
            left = np.inf
        if left > most:
            kept_by, most = c, left
    return kept_by, most


@_inlined
def _sum(rows, i, first, axes):  # type: ignore[no-untyped-def]
    """A row's sum of axes."""
    value = 0.0
    for k in range(axes.size):
        value += rows[i, first + k] * axes[k]
    return value


@_inlined
def _fastest(conditions, c, speed):  # type: ignore[no-untyped-def]
    """How much a condition's sum changes in a second at most."""
    change = 0.0
    for k in range(speed.size):
        change += abs(conditions[c, _WEIGHTS + k]) * speed[k]
    return change


@_inlined
def _off(conditions, c, targets):  # type: ignore[no-untyped-def]
    """How far a condition's sum is from the value that it is near."""
    off = _sum(conditions, c, _WEIGHTS, targets) + conditions[c, _OFFSET] - conditions[c, _VALUE]
    period = conditions[c, _PERIOD]
    return off - period * np.floor(off / period + 0.5) if period > 0.0 else off


@_inlined
def _left(change, may):  # type: ignore[no-untyped-def]
    """The share of a change that is left where its sum may come closer by so much."""
    return 1.0 if change >= -may else may / -change


@_inlined
def _given_up(rows, step, proposed):  # type: ignore[no-untyped-def]
    """The square of what a step does otherwise than the proposed one, in (r, m) rows."""
    square = 0.0
    for r in range(rows.shape[0]):
        off = 0.0
        for k in range(proposed.size):
            off += rows[r, k] * (step[k] - proposed[k])
        square += off * off
    return square


@_kernel
def nearest_step(wanted: Wanted, room: Room, step: FloatArray) -> int:
    """Write the (m,) step; how many rows had to be looked at, or UNSOLVED.

    min ½|x − x₀|² + ½|J(x − x₀)|² with slope x ≥ allowed, softly, and lowest ≤ x ≤ highest, for x
    in `unit`. The dual active-set method (Goldfarb and Idnani, 1983): the worst row is made to hold
    while those before it go on doing so, or are let go where they pull. Every row stands as
    y = L⁻¹ c, with LLᵀ the objective's matrix: what a row does to another is their product.
    """
    axes, parts = wanted.unit.size, wanted.allowed.size
    rows, wide = parts + 2 * axes, axes + parts
    _prepare(wanted, room)
    y, active, missing = room.rows, room.active, room.vectors[_MISSING]
    shares, price, ways = room.vectors[_SHARE], room.vectors[_PRICE], room.vectors[_WAY]
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
            _shares(room, worst, count, wide)
            square = 0.0
            for k in range(wide):
                way = y[worst, k]
                for j in range(count):
                    way -= shares[j] * y[active[j], k]
                ways[k] = way
                square += way * way
            far, letting = np.inf, -1
            for j in range(count):
                if shares[j] > _TINY and price[j] < far * shares[j]:
                    far, letting = price[j] / shares[j], j
            whole = -missing[worst] / square if square > _TINY * _TINY else np.inf
            length = min(far, whole)
            if not length < np.inf:
                return UNSOLVED
            for j in range(count):
                price[j] -= length * shares[j]
            own += length
            if whole < np.inf:
                for i in range(rows):
                    for k in range(wide):
                        missing[i] += length * y[i, k] * ways[k]
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
    factor, y, missing = room.matrices[0], room.rows, room.vectors[_MISSING]
    for i in range(axes):
        for j in range(i + 1):
            value = 1.0 if i == j else 0.0
            for r in range(task.shape[0]):
                value += task[r, i] * unit[i] * task[r, j] * unit[j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            factor[i, j] = np.sqrt(value) if i == j else value / factor[j, j]
    y[: parts + 2 * axes, : axes + parts] = 0.0
    for i in range(parts):
        missing[i] = -allowed[i]
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
        missing[up] = (proposed[k] - lowest[k]) / unit[k]
        missing[down] = (highest[k] - proposed[k]) / unit[k]


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
def _shares(room, worst, count, wide):  # type: ignore[no-untyped-def]
    """How much of each active row is in the worst one: (Y Yᵀ)⁻¹ Y y by Cholesky's factor."""
    y, gram, share, active = room.rows, room.matrices[1], room.vectors[_SHARE], room.active
    for i in range(count):
        for j in range(i + 1):
            value = 0.0
            for k in range(wide):
                value += y[active[i], k] * y[active[j], k]
            for k in range(j):
                value -= gram[i, k] * gram[j, k]
            gram[i, j] = np.sqrt(max(value, 1e-300)) if i == j else value / gram[j, j]
    for i in range(count):
        value = 0.0
        for k in range(wide):
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
    axes, factor, way = wanted.unit.size, room.matrices[0], room.vectors[_WAY]
    price = room.vectors[_PRICE]
    for k in range(axes):
        way[k] = 0.0
        for j in range(count):
            way[k] += price[j] * room.rows[room.active[j], k]
    for i in range(axes - 1, -1, -1):
        for k in range(i + 1, axes):
            way[i] -= factor[k, i] * way[k]
        way[i] /= factor[i, i]
        moved = wanted.proposed[i] + way[i] * wanted.unit[i]
        step[i] = min(max(moved, wanted.lowest[i]), wanted.highest[i])
