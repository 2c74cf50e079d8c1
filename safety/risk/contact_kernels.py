"""Sampled shapes of the body against a grid of distances, compiled.

What is proved between places whose distance is known follows from one property of distances. The
square of the distance to a set, less the square of the place, |x|², is the least of functions that
are linear in the place, one for each point of the set: so it is concave. On a straight piece of
length L between places with distances a and b the square of the distance is at least

    (1 − t) a² + t b² − t (1 − t) L²,

and in a cube of the grid with the side h, where interpolation has the distance c, it is at least
c² − ¾ h². At 15 mm, of 11 mm between nodes 1 mm is lost, and of a cube's 1.5 mm a twentieth.

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
_FINEST_BESIDE_PORT_MM = 0.05
"""... but for ways that may lead out of the port: there less is known of what is on them."""
_LOOKED_MM = 1.0
"""... and no finer than this where only the interpolated distance is looked for."""
CAP_MM = 0.6
"""More clearance need not be proved: the way between two questions takes hardly anything of it."""
_KEPT_MM = np.float32(0.1)
"""By so much less than nodes have is enough for what is between them: more costs more pieces."""
_ROUNDED_MM = np.float32(0.01)
"""Places of some 100 mm are rounded by less than this."""
_ROUNDED_MM2 = np.float32(1e-2)
"""Squares of distances up to some 100 mm are rounded by less than this."""
_MOST_CUTS = 64
_PIECES = 8
"""Of a segment that comes out of the port, of all shapes together."""
_RADIUS, _SAFE, _LEAST, _AT = range(4)
"""Rows of the table of nodes."""
_ORDER, _SEGMENT, _NEAR = range(3)
"""Rows of the list of nodes: by their least clearance, those from which to the next a place of any
shape may be near, and those where it may be of one shape."""
_TOGETHER = 50
"""Shapes are bounded together before they are looked at one by one."""
_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_FAR = np.float32(np.inf)
_LOST = np.float32(0.75)
"""Of the square of a cube's side: in its middle u (1 − u) along each of three axes."""

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined: Callable[..., Any] = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False
)
"""These make no arrays, and do not count who holds one: for each shape that took longer than its
distances."""


@_kernel
def clearances(surroundings, skin, shapes, exact):  # type: ignore[no-untyped-def]
    """Write clearance, node, and what is sure of each shape.

    exact: of so many that have the least clearance, and of all that touch, it is looked for between
    nodes. Of the others the clearance is that of places looked at, and no less than that of those.
    """
    grid, values, port = _unpacked(surroundings, skin), surroundings.values, surroundings.port
    positions, clearance, node = shapes.positions, shapes.clearance, shapes.node
    surely, least = shapes.surely, shapes.least
    table, listed = _table_of(skin), np.empty((3, skin.radius.size), np.int64)
    box, balls = np.empty((4, positions.shape[1]), np.float32), _balls_of(skin)
    pieces, cap = np.empty((_MOST_CUTS, 4), np.float32), np.float32(CAP_MM)
    thin = skin.radius.min()
    for first in range(0, clearance.size, _TOGETHER):
        last = min(first + _TOGETHER, clearance.size)
        _empty(box)
        _enclose(positions, first, last, box)
        _enclose_box(balls, box)
        outside, opened = _bound(grid, values, port, balls, table, listed)
        for s in range(first, last):
            clearance[s], node[s] = _at_nodes(
                grid, values, port, positions, s, outside, table, listed
            )
            near, least[s] = _listed_near(grid, values, positions, s, opened, table, listed)
            surely[s] = max(cap, _proved_of_far(grid, thin, least[s]))
            if near > 0 or not clearance[s] > _ZERO:
                clearance[s], node[s], least[s], surely[s] = _proved(
                    *(grid, values, port, positions, s, clearance[s], node[s], near, least[s]),
                    *(table, listed, pieces),
                )
    _find_lowest(grid, values, port, shapes, exact, table, pieces)


@_kernel
def are_far(surroundings, skin, balls):  # type: ignore[no-untyped-def]
    """Whether nothing is near to any shape whose nodes are in (K, 5, n) balls, as `_bound` has
    them, or to what goes straight from one such shape to another: all surely have CAP_MM. Where a
    radius is negative there is no shape."""
    grid, values, port = _unpacked(surroundings, skin), surroundings.values, surroundings.port
    table, listed = _table_of(skin), np.empty((3, skin.radius.size), np.int64)
    for k in range(balls.shape[0]):
        if balls[k, 3, 0] < _ZERO:
            continue
        opened = _bound(grid, values, port, balls[k], table, listed)[1]
        for j in range(opened):
            if not _is_far_in_pieces(grid, values, port, balls[k], listed[_SEGMENT, j], table):
                return False
    return True


@_inlined
def _is_far_in_pieces(grid, values, port, balls, i, table):  # type: ignore[no-untyped-def]
    """Whether nothing is near to any piece of segment i of all shapes in (5, n) balls that is not
    in the port: as of one that comes out of it."""
    needed = max(table[_RADIUS, i], table[_RADIUS, i + 1]) + _enough(grid)
    length, wide = balls[4, i] / np.float32(_PIECES), max(balls[3, i], balls[3, i + 1])
    hidden, away = False, -_FAR
    for j in range(_PIECES + 1):
        share = np.float32(j) / np.float32(_PIECES)
        x = balls[0, i] + share * (balls[0, i + 1] - balls[0, i])
        y = balls[1, i] + share * (balls[1, i + 1] - balls[1, i])
        z = balls[2, i] + share * (balls[2, i + 1] - balls[2, i])
        was_hidden, was_away = hidden, away
        hidden, away = _is_ball_in_port(port, x, y, z, wide), -_FAR
        if wide < _FAR:
            away = _distance(grid, values, x, y, z) - wide
        if j > 0 and not (hidden and was_hidden):
            square = least_square(min(was_away, grid[13]), min(away, grid[13]), length)
            if not square > needed * needed:
                return False
    return True


@_kernel
def _find_lowest(grid, values, port, shapes, exact, table, pieces):  # type: ignore[no-untyped-def]
    """Look for the clearance of those shapes that may be among so many with the least, or touch.

    First at those that are nearest as far as is known: what they have sorts out most of the others.
    """
    positions, clearance, node = shapes.positions, shapes.clearance, shapes.node
    surely, least = shapes.surely, shapes.least
    rank, undecided = min(exact, clearance.size) - 1, 0
    for s in range(clearance.size):
        undecided += 0 if least[s] >= min(clearance[s], _enough(grid)) else 1
    if undecided == 0:
        return
    for again in range(2):
        lowest = np.partition(clearance, rank)[rank]
        needed = min(max(lowest, _ZERO), _enough(grid))
        for s in range(clearance.size):
            if not clearance[s] > _ZERO or least[s] >= clearance[s]:
                continue
            sorted_out = least[s] >= needed and least[s] > _ZERO
            if sorted_out or (again == 0 and clearance[s] > lowest):
                continue
            clearance[s], node[s] = _searched(
                grid, values, port, positions, s, clearance[s], node[s], needed, table, pieces
            )
            least[s] = min(clearance[s], needed)
            if not clearance[s] > _ZERO:
                surely[s] = min(surely[s], clearance[s])


@_kernel
def sweep(surroundings, skin, start, end, swept, surely):  # type: ignore[no-untyped-def]
    """Lower `swept` and `surely`, (S,) clearances on the way from each shape to that of `end`.

    All nodes of a shape go straight and at the same time, and so does all that is between them.
    While none goes farther than what is sure at both ends allows, nothing is touched on the way;
    else it is halved.
    """
    grid, values, port = _unpacked(surroundings, skin), surroundings.values, surroundings.port
    table, listed = _table_of(skin), np.empty((3, skin.radius.size), np.int64)
    box, balls = np.empty((4, start.positions.shape[1]), np.float32), _balls_of(skin)
    pieces, ways = np.empty((_MOST_CUTS, 4), np.float32), np.empty((_MOST_CUTS, 4), np.float32)
    between, thin = np.empty((1, box.shape[1]), np.float32), skin.safe.min()
    for first in range(0, swept.size, _TOGETHER):
        last = min(first + _TOGETHER, swept.size)
        longest = _longest_way(start.positions, end.positions, first, last, box)
        bounded, counts = False, (0, 0)
        for s in range(first, last):
            swept[s] = min(swept[s], start.clearance[s], end.clearance[s])
            least = _on_the_way(port, start.surely[s], end.surely[s], longest, thin)
            if least > _ZERO or not swept[s] > _ZERO:
                surely[s] = min(surely[s], least, swept[s])
                continue
            if not bounded:
                _empty(box)
                _enclose(start.positions, first, last, box)
                _enclose(end.positions, first, last, box)
                _enclose_box(balls, box)
                bounded, counts = True, _bound(grid, values, port, balls, table, listed)
            ways[0, 0], ways[0, 1] = 0.0, 1.0
            ways[0, 2], ways[0, 3] = start.surely[s], end.surely[s]
            swept[s], least = _swept(
                *(grid, values, port, start.positions, end.positions, s, swept[s], thin, counts),
                *(table, listed, pieces, ways, between),
            )
            surely[s] = min(surely[s], least, swept[s])


@_inlined
def _swept(  # type: ignore[no-untyped-def]
    grid, values, port, start, end, s, swept, thin, counts, table, listed, pieces, ways, between
):
    """The smallest clearance of shape s on a way that is cut until no piece is open, and what it is
    not below: the way is the first of `ways`."""
    waiting, length, surely = 1, _way(start, end, s), _FAR
    outside, opened = counts
    finest = np.float32(FINEST_MM)
    if port[6] >= _ZERO and ways[0, 2] > _ZERO and ways[0, 3] > _ZERO:
        finest = np.float32(_FINEST_BESIDE_PORT_MM)
    while waiting > 0 and swept > _ZERO:
        waiting -= 1
        begin, stop, before, after = _row(ways, waiting)
        step = (stop - begin) * length
        least = _on_the_way(port, before, after, step, thin)
        if least > _ZERO or step < finest or waiting + 2 > _MOST_CUTS:
            surely = min(surely, least)
            continue
        half = _HALF * (begin + stop)
        for c in range(between.size):
            between[0, c] = start[s, c] + half * (end[s, c] - start[s, c])
        there, node = _at_nodes(grid, values, port, between, 0, outside, table, listed)
        near, lowest = _listed_near(grid, values, between, 0, opened, table, listed)
        there, node, lowest, sure = _proved(
            *(grid, values, port, between, 0, there, node, near, lowest, table, listed, pieces)
        )
        if there > _ZERO and lowest <= _ZERO:
            there, _ = _searched(grid, values, port, between, 0, there, node, _ZERO, table, pieces)
            sure = min(sure, there)
        swept = min(swept, there)
        waiting = _halved(ways, waiting, half, sure)
    return swept, surely


@_inlined
def _on_the_way(port, before, after, way, thin):  # type: ignore[no-untyped-def]
    """What the clearance of no part of a body is below that goes no farther than so, from what it
    surely has at both ends. thin: no part is thinner, as safe as it is counted.

    Of what comes out of the port, or goes into it, one end says nothing.
    """
    if port[6] >= _ZERO:
        return min(before, after) - way
    if not (before > _ZERO and after > _ZERO):
        return min(before, after)
    return _root(max(least_square(thin + before, thin + after, way), _ZERO)) - thin


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
    for s in range(first, last, 2):  # two at a time: what is read and written serves both
        row, other = positions[s], positions[min(s + 1, last - 1)]
        for c in range(row.size):
            low, high = row[c], other[c]
            low, high = low if low < high else high, high if low < high else low
            lowest[c] = low if low < lowest[c] else lowest[c]
            highest[c] = high if high > highest[c] else highest[c]
            total[c] += row[c] + other[c]
        for c in range(row.size - 3):
            away, beside = abs(row[c + 3] - row[c]), abs(other[c + 3] - other[c])
            away = away if away > beside else beside
            apart[c] = away if away > apart[c] else apart[c]


@_kernel
def _longest_way(start, end, first, last, box):  # type: ignore[no-untyped-def]
    """What no node of these shapes goes farther than."""
    apart = box[3]
    apart[:] = _ZERO
    for s in range(first, last, 2):
        o = min(s + 1, last - 1)
        before, after, other_before, other_after = start[s], end[s], start[o], end[o]
        for c in range(apart.size):
            away, beside = abs(after[c] - before[c]), abs(other_after[c] - other_before[c])
            away = away if away > beside else beside
            apart[c] = away if away > apart[c] else apart[c]
    longest = _ZERO
    for i in range(0, apart.size, 3):
        longest = max(longest, _length(apart[i], apart[i + 1], apart[i + 2]))
    return longest


@_kernel
def _balls_of(skin):  # type: ignore[no-untyped-def]
    """Room for (5, n) balls: where each node of several shapes is, and no less than how far it is
    from it to the next."""
    return np.empty((5, skin.radius.size), np.float32)


@_kernel
def _enclose_box(balls, box):  # type: ignore[no-untyped-def]
    """Balls round a box. What is no number is everywhere."""
    for i in range(balls.shape[1]):
        c = 3 * i
        x, y = _HALF * (box[0, c] + box[1, c]), _HALF * (box[0, c + 1] + box[1, c + 1])
        z = _HALF * (box[0, c + 2] + box[1, c + 2])
        wide = _length(box[1, c] - x, box[1, c + 1] - y, box[1, c + 2] - z)
        if not abs(box[2, c] + box[2, c + 1] + box[2, c + 2]) < _FAR:
            wide = _FAR
        balls[0, i], balls[1, i], balls[2, i], balls[3, i] = x, y, z, wide
        if i < balls.shape[1] - 1:
            balls[4, i] = _length(box[3, c], box[3, c + 1], box[3, c + 2])


@_kernel
def _bound(grid, values, port, balls, table, listed):  # type: ignore[no-untyped-def]
    """What is known of all shapes in (5, n) balls, from one distance for each node: fill table and
    lists, and return how many nodes, and how many segments, are listed.

    Nodes and segments that are in the port, of all shapes, are not listed. Of shapes that are not
    numbers nothing is known.
    """
    count, outside = table.shape[1], 0
    for i in range(count):
        table[_LEAST, i] = _distance_of_all(grid, values, balls, i) - table[_RADIUS, i]
        if _are_in_port(port, balls, i):
            continue
        j = outside
        outside += 1
        while j > 0 and table[_LEAST, i] < table[_LEAST, listed[_ORDER, j - 1]]:
            listed[_ORDER, j] = listed[_ORDER, j - 1]
            j -= 1
        listed[_ORDER, j] = i
    found = 0
    for i in range(count - 1):
        here, there = table[_LEAST, i] + table[_RADIUS, i], table[_LEAST, i + 1]
        square = least_square(
            min(here, grid[13]), min(there + table[_RADIUS, i + 1], grid[13]), balls[4, i]
        )
        needed = max(table[_RADIUS, i], table[_RADIUS, i + 1]) + _enough(grid)
        hidden = _are_in_port(port, balls, i) and _are_in_port(port, balls, i + 1)
        if not square > needed * needed and not hidden:
            listed[_SEGMENT, found] = i
            found += 1
    return outside, found


@_inlined
def _are_in_port(port, balls, i):  # type: ignore[no-untyped-def]
    """Whether node i of all shapes in balls is in the port."""
    return _is_ball_in_port(port, balls[0, i], balls[1, i], balls[2, i], balls[3, i])


@_inlined
def _is_ball_in_port(port, x, y, z, wide):  # type: ignore[no-untyped-def]
    if port[6] < _ZERO:
        return False
    x, y, z, wide = x - port[0], y - port[1], z - port[2], wide + _ROUNDED_MM
    along = x * port[3] + y * port[4] + z * port[5]
    aside = _root(max(x * x + y * y + z * z - along * along, _ZERO))
    return along + wide <= port[7] and aside + wide <= port[6]


@_inlined
def _distance_of_all(grid, values, balls, i):  # type: ignore[no-untyped-def]
    """What node i of no shape in balls is nearer than."""
    if not balls[3, i] < _FAR:
        return -_FAR
    return _distance(grid, values, balls[0, i], balls[1, i], balls[2, i]) - balls[3, i]


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
def _at_nodes(grid, values, port, positions, s, outside, table, listed):  # type: ignore[no-untyped-def]
    """Of one shape: the smallest clearance of its nodes, and the node where it is.

    Looked at are the nodes that may be nearest, as far as is known of all shapes together; outside:
    how many are listed, those that are not all in the port. Of the others it is noted what they are
    not nearer than.
    """
    count, best, node = table.shape[1], _FAR, 0
    for i in range(count):
        table[_AT, i] = table[_LEAST, i] + table[_RADIUS, i]
    for j in range(outside):
        i = listed[_ORDER, j]
        if table[_LEAST, i] >= best:
            break
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        away = _distance(grid, values, x, y, z)
        table[_AT, i] = away
        if not away - table[_RADIUS, i] >= best and not _is_in_port(port, x, y, z):
            best, node = away - table[_RADIUS, i], i
    return best, node


@_inlined
def _listed_near(grid, values, positions, s, opened, table, listed):  # type: ignore[no-untyped-def]
    """List the segments of a shape where it is not proved from nodes alone that it has CAP_MM.

    Returns how many, and what the clearance of the others is not below. opened: how many segments
    of any shape are listed. table: as `_at_nodes` leaves it.
    """
    near, least = 0, _enough(grid)
    for j in range(opened):
        i = listed[_SEGMENT, j]
        needed = max(table[_SAFE, i], table[_SAFE, i + 1]) + np.float32(CAP_MM)
        enough = needed * needed + grid[12]
        square = _square_between(grid, positions, s, i, table)
        if not square > enough:
            _look_again(grid, values, positions, s, i, table)
            _look_again(grid, values, positions, s, i + 1, table)
            square = _square_between(grid, positions, s, i, table)
        if square > enough:
            least = min(least, _root(square) - max(table[_RADIUS, i], table[_RADIUS, i + 1]))
        else:
            listed[_NEAR, near] = i
            near += 1
    return near, least


@_inlined
def _proved_of_far(grid, thin, least):  # type: ignore[no-untyped-def]
    """What the clearance of no part of a shape is below of which, as interpolated, it is not below
    `least`. thin: no part has a smaller radius; a thicker one loses less between the grid's nodes.
    """
    away = thin + least
    return _root(max(away * away - grid[12], _ZERO)) - thin - grid[10]


@_inlined
def _square_between(grid, positions, s, i, table):  # type: ignore[no-untyped-def]
    """What the square of the distance, as interpolated, is not below from node i to the next."""
    here, there = min(table[_AT, i], grid[13]), min(table[_AT, i + 1], grid[13])
    return least_square(here, there, _apart(positions, s, i))


@_inlined
def least_square(here, there, length):  # type: ignore[no-untyped-def]
    """What the square of the distance is not below on a straight piece, from the distances at both
    of its ends; below zero where it may be nothing."""
    if not (here > _ZERO and there > _ZERO):
        return -_ONE
    square = length * length
    if not square < _FAR:
        return -_ONE
    along = (here - there) * (here + there) + square  # twice the square, times the share of the way
    if along <= _ZERO:
        return here * here
    if along >= _TWO * square:
        return there * there
    along /= _TWO * length
    return here * here - along * along


@_inlined
def _look_again(grid, values, positions, s, i, table):  # type: ignore[no-untyped-def]
    """Have the distance of a node of which only a bound is known."""
    if table[_AT, i] == table[_LEAST, i] + table[_RADIUS, i]:
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        table[_AT, i] = _distance(grid, values, x, y, z)


@_inlined
def _proved(grid, values, port, positions, s, found, node, near, least, table, listed, pieces):  # type: ignore[no-untyped-def]
    """Of one shape: the smallest clearance found and its node; what the clearance, as interpolated,
    is not below; and what the clearance of no part of it is below: CAP_MM or less, unless it
    touches. As thick as its centreline may be off.

    found, node, table: as `_at_nodes` has them. near, least: as `_listed_near` has them. Segments
    are cut until each piece has nearly what the nodes have.
    """
    if not found > _ZERO:
        return found, node, -_FAR, found
    cap, none = np.float32(CAP_MM), -_FAR
    surely, room = cap, _room_of_nodes(grid, port, positions, s, near, table, listed)
    if not room > _ZERO:
        return found, node, none, room
    goal = min(cap, max(_HALF * room, room - _KEPT_MM))
    for j in range(near):
        i = listed[_NEAR, j]
        x0, y0, z0 = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        x, y, z = positions[s, 3 * i + 3], positions[s, 3 * i + 4], positions[s, 3 * i + 5]
        if _is_in_port(port, x0, y0, z0) and _is_in_port(port, x, y, z):
            continue
        dx, dy, dz = x - x0, y - y0, z - z0
        length, thick = _length(dx, dy, dz), max(table[_SAFE, i], table[_SAFE, i + 1])
        thin, enough = max(table[_RADIUS, i], table[_RADIUS, i + 1]), thick + goal
        enough = enough * enough + grid[12]
        pieces[0, 0], pieces[0, 1], waiting = 0.0, 1.0, 1
        pieces[0, 2], pieces[0, 3] = table[_AT, i], table[_AT, i + 1]
        while waiting > 0:
            waiting -= 1
            begin, end, before, after = _row(pieces, waiting)
            piece, half = (end - begin) * length, _HALF * (begin + end)
            square = least_square(min(before, grid[13]), min(after, grid[13]), piece)
            x, y, z = x0 + half * dx, y0 + half * dy, z0 + half * dz
            if square >= enough or piece < FINEST_MM or waiting + 2 > _MOST_CUTS:
                hidden = _is_in_port(port, x, y, z)
                if hidden and not piece < FINEST_MM:  # what is proved in one may lead out of it
                    hidden = _is_way_in_port(port, x0, y0, z0, dx, dy, dz, begin, end)
                if not hidden:
                    surely = min(surely, _root(max(square - grid[12], _ZERO)) - thick)
                    least = min(least, _root(max(square, _ZERO)) - thin)
                if not surely > _ZERO:
                    return found, node, none, surely
                continue
            there = _distance(grid, values, x, y, z)
            if there - thin < found and not _is_in_port(port, x, y, z):
                found, node = there - thin, i
                if not found > _ZERO:
                    return found, node, none, found
            waiting = _halved(pieces, waiting, half, there)
    return found, node, least, surely


@_inlined
def _room_of_nodes(grid, port, positions, s, near, table, listed):  # type: ignore[no-untyped-def]
    """What is surely left at the nearest node of listed segments."""
    room = _FAR
    for j in range(near):
        i = listed[_NEAR, j]
        for k in range(i, i + 2):
            x, y, z = positions[s, 3 * k], positions[s, 3 * k + 1], positions[s, 3 * k + 2]
            if not _is_in_port(port, x, y, z):
                away = max(table[_AT, k], _ZERO)
                away = _root(max(away * away - grid[12], _ZERO))
                room = min(room, away - table[_SAFE, k])
    return room


@_inlined
def _searched(grid, values, port, positions, s, best, node, needed, table, pieces):  # type: ignore[no-untyped-def]
    """Of one shape: the smallest clearance, and the node where it is, or before the place where it
    is. best: what is known to be found.

    No piece of it is cut whose clearance is above `needed`, or no less than what is found; and
    nothing is cut any more where it touches.
    """
    for i in range(table.shape[1]):
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        table[_AT, i] = _distance(grid, values, x, y, z)
    for i in range(table.shape[1] - 1):
        if not best > _ZERO:
            break
        x0, y0, z0 = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        x, y, z = positions[s, 3 * i + 3], positions[s, 3 * i + 4], positions[s, 3 * i + 5]
        if _is_in_port(port, x0, y0, z0) and _is_in_port(port, x, y, z):
            continue
        dx, dy, dz = x - x0, y - y0, z - z0
        length, thick = _length(dx, dy, dz), max(table[_RADIUS, i], table[_RADIUS, i + 1])
        pieces[0, 0], pieces[0, 1] = 0.0, 1.0
        pieces[0, 2], pieces[0, 3], waiting = table[_AT, i], table[_AT, i + 1], 1
        while waiting > 0 and best > _ZERO:
            waiting -= 1
            begin, end, before, after = _row(pieces, waiting)
            piece, open_to = (end - begin) * length, thick + min(needed, best)
            square = least_square(min(before, grid[13]), min(after, grid[13]), piece)
            if square > open_to * open_to or piece < _LOOKED_MM or waiting + 2 > _MOST_CUTS:
                continue
            half = _HALF * (begin + end)
            x, y, z = x0 + half * dx, y0 + half * dy, z0 + half * dz
            there = _distance(grid, values, x, y, z)
            if there - thick < best and not _is_in_port(port, x, y, z):
                best, node = there - thick, i
            waiting = _halved(pieces, waiting, half, there)
    return best, node


@_inlined
def _apart(positions, s, i):  # type: ignore[no-untyped-def]
    """How far it is from node i to the next."""
    x = positions[s, 3 * i + 3] - positions[s, 3 * i]
    y = positions[s, 3 * i + 4] - positions[s, 3 * i + 1]
    z = positions[s, 3 * i + 5] - positions[s, 3 * i + 2]
    return _length(x, y, z)


@_inlined
def _enough(grid):  # type: ignore[no-untyped-def]
    """With more clearance, as it is interpolated, a shape surely has CAP_MM; and no more is looked
    for."""
    return grid[9] + np.float32(CAP_MM) + grid[10]


@_inlined
def _is_in_port(port, x, y, z):  # type: ignore[no-untyped-def]
    if port[6] < _ZERO:
        return False
    x, y, z = x - port[0], y - port[1], z - port[2]
    along = x * port[3] + y * port[4] + z * port[5]
    aside = x * x + y * y + z * z - along * along
    return along <= port[7] and aside <= port[6] * port[6]


@_inlined
def _is_way_in_port(port, x, y, z, dx, dy, dz, begin, end):  # type: ignore[no-untyped-def]
    """Whether all of the straight way is from one share of it to another: the port is convex."""
    first = _is_in_port(port, x + begin * dx, y + begin * dy, z + begin * dz)
    return first and _is_in_port(port, x + end * dx, y + end * dy, z + end * dz)


@_inlined
def _unpacked(surroundings, skin):  # type: ignore[no-untyped-def]
    """Shape and frame of the grid, the skin's largest difference, the grid's spacing, the square
    that interpolation and rounding may lose, and how far distances are exact, as numbers of their
    own: they stay in registers."""
    shape, frame = surroundings.shape, surroundings.frame
    mm = _ONE / frame[3]
    return (
        *(shape[0], shape[1], shape[2]),
        *(frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], frame[6], skin.most),
        *(mm, _LOST * mm * mm + _ROUNDED_MM2, frame[7]),
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
