"""Sampled shapes of the body against a grid of distances, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

S shapes, n nodes along each, d coefficients. All lengths are float32: half the memory, and here
twice the speed. Nodes' coordinates are flat: (S, 3n).
"""

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np
from numba import njit

FINEST_MM = 0.5
"""What is between nodes, or between two shapes on the way, is cut no finer than this."""
_LOOKED_MM = 1.0
"""... and no finer than this where only the interpolated distance is looked for."""
CAP_MM = 0.6
"""More clearance need not be proved: shapes do not move by twice as much between two questions."""
_MOST_CUTS = 64
_RADIUS, _SAFE, _LEAST, _AT = range(4)
"""Rows of the table of nodes."""
_ORDER, _SEGMENT = range(2)
"""Rows of the list of nodes: by their least clearance, and those from which to the next a place may
be near."""
_TOGETHER = 50
"""Shapes are bounded together before they are looked at one by one."""
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_FAR = np.float32(np.inf)

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined: Callable[..., Any] = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False
)
"""These make no arrays, and do not count who holds one: for each shape that took longer than its
distances."""


@_kernel
def clearances(surroundings, skin, shapes, start, stays):  # type: ignore[no-untyped-def]
    """Write clearance, node and what is sure of each shape.

    start: shapes that these come from, and stays: (S,) which of them do. Nothing of a shape comes
    nearer by more than the node goes that goes farthest: where that leaves what was sure of it
    above zero, that is what is sure, and it is not looked for.
    """
    grid, values, port = _unpacked(surroundings, skin), surroundings.values, surroundings.port
    positions, clearance, node, surely = (
        shapes.positions,
        shapes.clearance,
        shapes.node,
        shapes.surely,
    )
    table, listed = _table_of(skin), np.empty((2, skin.radius.size), np.int64)
    box = np.empty((4, positions.shape[1]), np.float32)
    pieces, open_mm = np.empty((_MOST_CUTS, 4), np.float32), _open_mm(grid)
    for first in range(0, clearance.size, _TOGETHER):
        last = min(first + _TOGETHER, clearance.size)
        _empty(box)
        _enclose(positions, first, last, box)
        opened = _bound(grid, values, box, table, listed)
        for s in range(first, last):
            clearance[s], node[s] = _clearance(
                grid, values, port, positions, s, opened, table, listed, pieces
            )
            if stays[s] and _ZERO < clearance[s] <= open_mm:
                surely[s] = start.surely[s] - _way(start.positions, positions, s)
                if surely[s] > _ZERO:
                    continue
            surely[s] = _surely(
                grid, values, port, positions, s, clearance[s], opened, table, listed, pieces
            )


@_kernel
def sweep(surroundings, skin, start, end, swept, surely):  # type: ignore[no-untyped-def]
    """Lower `swept` and `surely`, (S,) clearances on the way from each shape to that of `end`.

    All nodes of a shape go straight and at the same time. While none goes farther than the sure
    clearance at both ends allows, nothing is touched between them; else the way is halved.
    """
    grid, values, port = _unpacked(surroundings, skin), surroundings.values, surroundings.port
    table, listed = _table_of(skin), np.empty((2, skin.radius.size), np.int64)
    box = np.empty((4, start.positions.shape[1]), np.float32)
    pieces, ways = np.empty((_MOST_CUTS, 4), np.float32), np.empty((_MOST_CUTS, 4), np.float32)
    between = np.empty((1, box.shape[1]), np.float32)
    for first in range(0, swept.size, _TOGETHER):
        last = min(first + _TOGETHER, swept.size)
        longest, opened = _longest_way(start.positions, end.positions, first, last, box), -1
        for s in range(first, last):
            swept[s] = min(swept[s], start.clearance[s], end.clearance[s])
            least = _HALF * (start.surely[s] + end.surely[s] - longest)
            if least > _ZERO or not swept[s] > _ZERO:
                surely[s] = min(surely[s], least, swept[s])
                continue
            if opened < 0:
                _empty(box)
                _enclose(start.positions, first, last, box)
                _enclose(end.positions, first, last, box)
                opened = _bound(grid, values, box, table, listed)
            ways[0, 0], ways[0, 1] = 0.0, 1.0
            ways[0, 2], ways[0, 3] = start.surely[s], end.surely[s]
            swept[s], least = _swept(
                *(grid, values, port, start.positions, end.positions, s, swept[s], opened),
                *(table, listed, pieces, ways, between),
            )
            surely[s] = min(surely[s], least, swept[s])


@_inlined
def _swept(  # type: ignore[no-untyped-def]
    grid, values, port, start, end, s, swept, opened, table, listed, pieces, ways, between
):
    """The smallest clearance of shape s on a way that is cut until no piece is open, and what it is
    not below: the way is the first of `ways`."""
    waiting, length, surely = 1, _way(start, end, s), _FAR
    while waiting > 0 and swept > _ZERO:
        waiting -= 1
        begin, stop, before, after = _row(ways, waiting)
        step = (stop - begin) * length
        least = _HALF * (before + after - step)
        if least > _ZERO or step < FINEST_MM or waiting + 2 > _MOST_CUTS:
            surely = min(surely, least)
            continue
        half = _HALF * (begin + stop)
        for c in range(between.size):
            between[0, c] = start[s, c] + half * (end[s, c] - start[s, c])
        there, _ = _clearance(grid, values, port, between, 0, opened, table, listed, pieces)
        swept = min(swept, there)
        sure = _surely(grid, values, port, between, 0, there, opened, table, listed, pieces)
        waiting = _halved(ways, waiting, half, sure)
    return swept, surely


@_kernel
def _table_of(skin):  # type: ignore[no-untyped-def]
    """(4, n) of nodes: radius, safe radius, what the clearance of none of several shapes is below,
    and of one shape a distance that it has at least."""
    table = np.empty((4, skin.radius.size), np.float32)
    table[_RADIUS], table[_SAFE] = skin.radius, skin.safe
    return table


@_kernel
def _empty(box):  # type: ignore[no-untyped-def]
    """A box of no shape."""
    box[0], box[1], box[2], box[3] = _FAR, -_FAR, _ZERO, _ZERO


@_kernel
def _enclose(positions, first, last, box):  # type: ignore[no-untyped-def]
    """Widen a box by shapes."""
    lowest, highest, total, apart = box[0], box[1], box[2], box[3]
    for s in range(first, last):
        row = positions[s]
        for c in range(row.size):
            value = row[c]
            lowest[c] = value if value < lowest[c] else lowest[c]
            highest[c] = value if value > highest[c] else highest[c]
            total[c] += value
        for c in range(row.size - 3):
            away = abs(row[c + 3] - row[c])
            apart[c] = away if away > apart[c] else apart[c]


@_kernel
def _longest_way(start, end, first, last, box):  # type: ignore[no-untyped-def]
    """What no node of these shapes goes farther than."""
    apart = box[3]
    apart[:] = _ZERO
    for s in range(first, last):
        before, after = start[s], end[s]
        for c in range(apart.size):
            away = abs(after[c] - before[c])
            apart[c] = away if away > apart[c] else apart[c]
    longest = _ZERO
    for i in range(0, apart.size, 3):
        longest = max(longest, _length(apart[i], apart[i + 1], apart[i + 2]))
    return longest


@_kernel
def _bound(grid, values, box, table, listed):  # type: ignore[no-untyped-def]
    """What is known of all shapes in a box, from one distance for each node: fill table and lists,
    and return how many segments are listed.

    Of shapes that are not numbers nothing is known.
    """
    count = table.shape[1]
    enough = grid[9] + np.float32(CAP_MM) + grid[10]
    for i in range(count):
        table[_LEAST, i] = _distance_of_all(grid, values, box, i) - table[_RADIUS, i]
        j = i
        while j > 0 and table[_LEAST, i] < table[_LEAST, listed[_ORDER, j - 1]]:
            listed[_ORDER, j] = listed[_ORDER, j - 1]
            j -= 1
        listed[_ORDER, j] = i
    found = 0
    for i in range(count - 1):
        thick = max(table[_RADIUS, i], table[_RADIUS, i + 1])
        here, there = table[_LEAST, i] + table[_RADIUS, i], table[_LEAST, i + 1]
        room = here + there + table[_RADIUS, i + 1] - _TWO * (thick + enough)
        if not _length(box[3, 3 * i], box[3, 3 * i + 1], box[3, 3 * i + 2]) < room:
            listed[_SEGMENT, found] = i
            found += 1
    return found


@_inlined
def _distance_of_all(grid, values, box, i):  # type: ignore[no-untyped-def]
    """What node i of no shape in a box is nearer than."""
    x, y = _HALF * (box[0, 3 * i] + box[1, 3 * i]), _HALF * (box[0, 3 * i + 1] + box[1, 3 * i + 1])
    z = _HALF * (box[0, 3 * i + 2] + box[1, 3 * i + 2])
    if not abs(box[2, 3 * i] + box[2, 3 * i + 1] + box[2, 3 * i + 2]) < _FAR:
        return -_FAR
    wide = _length(box[1, 3 * i] - x, box[1, 3 * i + 1] - y, box[1, 3 * i + 2] - z)
    return _distance(grid, values, x, y, z) - wide


@_inlined
def _length(x, y, z):  # type: ignore[no-untyped-def]
    return _root(x * x + y * y + z * z)


@_inlined
def _row(table, row):  # type: ignore[no-untyped-def]
    return table[row, 0], table[row, 1], table[row, 2], table[row, 3]


@_inlined
def _halved(table, row, middle, there):  # type: ignore[no-untyped-def]
    """Put both halves of a row (begin, end, value there, value there) in its place and the next.

    Returns where the next one goes.
    """
    begin, end, before, after = _row(table, row)
    table[row, 0], table[row, 1], table[row, 2], table[row, 3] = begin, middle, before, there
    table[row + 1, 0], table[row + 1, 1] = middle, end
    table[row + 1, 2], table[row + 1, 3] = there, after
    return row + 2


@_inlined
def _way(start, end, s):  # type: ignore[no-untyped-def]
    """How far the node goes that goes farthest."""
    longest = _ZERO
    for i in range(0, start.shape[1], 3):
        x, y = end[s, i] - start[s, i], end[s, i + 1] - start[s, i + 1]
        z = end[s, i + 2] - start[s, i + 2]
        longest = max(longest, x * x + y * y + z * z)
    return np.float32(sqrt(longest))


@_inlined
def _clearance(grid, values, port, positions, s, opened, table, listed, pieces):  # type: ignore[no-untyped-def]
    """Of one shape: the smallest clearance, and the node where it is, or nearest to where it is.

    Looked at are the nodes that may be nearest, as far as is known of all shapes together, and what
    is between those that are near. Of the others it is noted what they are not nearer than.
    opened: how many segments are listed.
    """
    count, best, node = table.shape[1], _FAR, 0
    for i in range(count):
        table[_AT, i] = table[_LEAST, i] + table[_RADIUS, i]
    for j in range(count):
        i = listed[_ORDER, j]
        if table[_LEAST, i] >= best:
            break
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        away = _distance(grid, values, x, y, z)
        table[_AT, i] = away
        if not away - table[_RADIUS, i] >= best and not _is_in_port(port, x, y, z):
            best, node = away - table[_RADIUS, i], i
    enough = grid[9] + np.float32(CAP_MM) + grid[10]
    for j in range(opened):
        if not best > _ZERO:
            break
        i = listed[_SEGMENT, j]
        thick = max(table[_RADIUS, i], table[_RADIUS, i + 1])
        apart, needed = _apart(positions, s, i), _TWO * (thick + enough)
        if apart < table[_AT, i] + table[_AT, i + 1] - needed:
            continue
        _look_again(grid, values, positions, s, i, table)
        _look_again(grid, values, positions, s, i + 1, table)
        ends = table[_AT, i], table[_AT, i + 1]
        if not apart < ends[0] + ends[1] - needed:
            between, _ = _between(
                grid, values, port, positions, s, i, thick, ends, enough, False, pieces
            )
            if between < best:
                best, node = between, i
    return best, node


@_inlined
def _apart(positions, s, i):  # type: ignore[no-untyped-def]
    """How far it is from node i to the next."""
    x = positions[s, 3 * i + 3] - positions[s, 3 * i]
    y = positions[s, 3 * i + 4] - positions[s, 3 * i + 1]
    z = positions[s, 3 * i + 5] - positions[s, 3 * i + 2]
    return _length(x, y, z)


@_inlined
def _look_again(grid, values, positions, s, i, table):  # type: ignore[no-untyped-def]
    """Have the distance of a node of which only a bound is known."""
    if table[_AT, i] == table[_LEAST, i] + table[_RADIUS, i]:
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        table[_AT, i] = _distance(grid, values, x, y, z)


@_inlined
def _surely(grid, values, port, positions, s, clearance, opened, table, listed, pieces):  # type: ignore[no-untyped-def]
    """What the clearance of no part of a shape is below; CAP_MM or less, unless it touches. As
    thick as its centreline may be off. table: as `_clearance` leaves it.

    Interpolated distances may be wrong by the grid's error. Where that leaves it open whether the
    shape touches, bounds from the grid's corners are taken, which are nearer to the truth.
    """
    cap = np.float32(CAP_MM)
    if not clearance > _ZERO:
        return clearance
    if clearance > _open_mm(grid):
        return cap
    least, looked_at, there = cap, -1, _ZERO
    for j in range(opened):
        i = listed[_SEGMENT, j]
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        u, v, w = positions[s, 3 * i + 3], positions[s, 3 * i + 4], positions[s, 3 * i + 5]
        thick = max(table[_SAFE, i], table[_SAFE, i + 1])
        length = _apart(positions, s, i)
        if _HALF * (table[_AT, i] + table[_AT, i + 1] - length) - grid[9] - thick > cap:
            continue
        before = there if looked_at == i else _at_least(grid, values, x, y, z)
        looked_at, there = i + 1, _at_least(grid, values, u, v, w)
        ends = before, there
        _, between = _between(grid, values, port, positions, s, i, thick, ends, cap, True, pieces)
        least = min(least, between)
        if not least > _ZERO:
            return least
    return least


@_inlined
def _open_mm(grid):  # type: ignore[no-untyped-def]
    """With more clearance, as it is interpolated, a shape is sure to have the most that is asked
    for."""
    return grid[9] + np.float32(_HALF * _LOOKED_MM) + np.float32(CAP_MM) + grid[10]


@_inlined
def _between(grid, values, port, positions, s, i, thick, ends, enough, surely, pieces):  # type: ignore[no-untyped-def]
    """From a shape's node to the next, cut until no piece is open: the smallest clearance found,
    and what it is not below.

    ends: distances there. enough: a
    piece with so much clearance is not cut. surely: distances are lower bounds.
    """
    x0, y0, z0 = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
    x, y, z = positions[s, 3 * i + 3], positions[s, 3 * i + 4], positions[s, 3 * i + 5]
    if _is_in_port(port, x0, y0, z0) and _is_in_port(port, x, y, z):
        return _FAR, _FAR
    dx, dy, dz = x - x0, y - y0, z - z0
    length, finest = _length(dx, dy, dz), FINEST_MM if surely else _LOOKED_MM
    pieces[0, 0], pieces[0, 1], pieces[0, 2], pieces[0, 3] = 0.0, 1.0, ends[0], ends[1]
    waiting, found, least = 1, _FAR, _FAR
    while waiting > 0 and found > _ZERO:
        waiting -= 1
        begin, end, before, after = _row(pieces, waiting)
        piece = (end - begin) * length
        lowest = _HALF * (before + after - piece) - thick
        if lowest > enough or piece < finest or waiting + 2 > _MOST_CUTS:
            half = _HALF * (begin + end)
            if not _is_in_port(port, x0 + half * dx, y0 + half * dy, z0 + half * dz):
                least = min(least, lowest)
            continue
        half = _HALF * (begin + end)
        x, y, z = x0 + half * dx, y0 + half * dy, z0 + half * dz
        there = _at_least(grid, values, x, y, z) if surely else _distance(grid, values, x, y, z)
        if not surely and not _is_in_port(port, x, y, z):
            found = min(found, there - thick)
        waiting = _halved(pieces, waiting, half, there)
    return found, least


@_inlined
def _is_in_port(port, x, y, z):  # type: ignore[no-untyped-def]
    if port[6] < _ZERO:
        return False
    x, y, z = x - port[0], y - port[1], z - port[2]
    along = x * port[3] + y * port[4] + z * port[5]
    aside = x * x + y * y + z * z - along * along
    return along <= port[7] and aside <= port[6] * port[6]


@_inlined
def _unpacked(surroundings, skin):  # type: ignore[no-untyped-def]
    """Shape and frame of the grid, the skin's largest difference and the grid's spacing, as numbers
    of their own: they stay in registers."""
    shape, frame = surroundings.shape, surroundings.frame
    return (
        *(shape[0], shape[1], shape[2]),
        *(frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], frame[6], skin.most),
        _ONE / frame[3],
    )


@_inlined
def _distance(grid, values, x, y, z):  # type: ignore[no-untyped-def]
    """Interpolated between the eight corners; outside the grid, what is known there.

    Places are unsigned: an index that may be negative is looked at twice.
    """
    nx, ny, nz = grid[0], grid[1], grid[2]
    u, v, w = (x - grid[3]) * grid[6], (y - grid[4]) * grid[6], (z - grid[5]) * grid[6]
    inside = u >= _ZERO and v >= _ZERO and w >= _ZERO
    one = np.uint64(1)
    if not (inside and u < nx - one and v < ny - one and w < nz - one):
        return _outside(grid, u, v, w)
    i, j, k = np.uint32(u), np.uint32(v), np.uint32(w)
    u, v, w = u - np.float32(i), v - np.float32(j), w - np.float32(k)
    here = (np.uint64(i) * ny + np.uint64(j)) * nz + np.uint64(k)
    beside, above = here + nz, here + ny * nz
    over = above + nz
    a = values[here] + w * (values[here + one] - values[here])
    b = values[beside] + w * (values[beside + one] - values[beside])
    c = values[above] + w * (values[above + one] - values[above])
    d = values[over] + w * (values[over + one] - values[over])
    a, c = a + v * (b - a), c + v * (d - c)
    return a + u * (c - a)


@_inlined
def _at_least(grid, values, x, y, z):  # type: ignore[no-untyped-def]
    """A distance that a place surely has: distances have a slope of one, from whichever corner."""
    nx, ny, nz = grid[0], grid[1], grid[2]
    u, v, w = (x - grid[3]) * grid[6], (y - grid[4]) * grid[6], (z - grid[5]) * grid[6]
    inside = u >= _ZERO and v >= _ZERO and w >= _ZERO
    one = np.uint64(1)
    if not (inside and u < nx - one and v < ny - one and w < nz - one):
        return _outside(grid, u, v, w) - grid[9]
    i, j, k = np.uint32(u), np.uint32(v), np.uint32(w)
    u, v, w = u - np.float32(i), v - np.float32(j), w - np.float32(k)
    here = (np.uint64(i) * ny + np.uint64(j)) * nz + np.uint64(k)
    beside, above = here + nz, here + ny * nz
    over = above + nz
    a0, a1, b0, b1 = values[here], values[here + one], values[beside], values[beside + one]
    c0, c1, d0, d1 = values[above], values[above + one], values[over], values[over + one]
    a, b, c, d = a0 + w * (a1 - a0), b0 + w * (b1 - b0), c0 + w * (c1 - c0), d0 + w * (d1 - d0)
    a, c = a + v * (b - a), c + v * (d - c)
    best, mm = a + u * (c - a) - grid[9], grid[11]
    # What corners say: the squares of the ways to them, along each axis to either side.
    p, q, r, s, t = u * u, v * v, w * w, _ONE - u, _ONE - v
    s, t, u = s * s, t * t, (_ONE - w) * (_ONE - w)
    best = max(best, a0 - mm * _root(p + q + r), a1 - mm * _root(p + q + u))
    best = max(best, b0 - mm * _root(p + t + r), b1 - mm * _root(p + t + u))
    best = max(best, c0 - mm * _root(s + q + r), c1 - mm * _root(s + q + u))
    return max(best, d0 - mm * _root(s + t + r), d1 - mm * _root(s + t + u))


@_inlined
def _root(square):  # type: ignore[no-untyped-def]
    return np.float32(sqrt(square))


@_kernel
def _outside(grid, u, v, w):  # type: ignore[no-untyped-def]
    """No more than the distance of a place outside the grid; deep in the solid if it is no place.

    From the mesh it is at least as far as from the grid, and the margin.
    """
    if not (abs(u) < _FAR and abs(v) < _FAR and abs(w) < _FAR):
        return -_FAR
    x, y = max(-u, u - np.float32(grid[0]), _ZERO), max(-v, v - np.float32(grid[1]), _ZERO)
    z = max(-w, w - np.float32(grid[2]), _ZERO)
    away = np.float32(sqrt(x * x + y * y + z * z)) / grid[6]
    return grid[7] * (away + grid[8])
