"""Sampled shapes of the body against a grid of distances, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

S shapes, n nodes along each, d coefficients. All lengths are float32: half the memory, and here
twice the speed. Nodes' coordinates are flat: (S, 3n).
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FINEST_MM = 0.5
"""What is between nodes, or between two shapes on the way, is cut no finer than this."""
CAP_MM = 0.6
"""More clearance need not be proved: shapes do not move by twice as much between two questions."""
_MOST_CUTS = 64
_ZERO, _HALF, _TWO = np.float32(0.0), np.float32(0.5), np.float32(2.0)
_FAR = np.float32(np.inf)

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
_placing = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc"})
"""Here sums may be reordered, so that they run in parallel lanes."""

SingleArray = NDArray[np.float32]


class SolidArrays(NamedTuple):
    """Distances as `distance_grid` has them, and the port, as the compiled code reads them.

    values: (nx·ny·nz,) mm. shape: (3,) uint64. frame: (7,) the grid's origin, places per mm, ±1 for
    free or solid far outside the grid, mm between the grid's end and the mesh, and the mm by which
    a distance may be too large. port: (8,) centre, unit direction inwards, radius (negative: there
    is none), depth.
    """

    values: SingleArray
    shape: NDArray[np.uint64]
    frame: SingleArray
    port: SingleArray


class Skin(NamedTuple):
    """radius: (n,) mm, of the body at each node. safe: (n,) with what its centreline may be off by.
    most: the largest difference of both."""

    radius: SingleArray
    safe: SingleArray
    most: np.float32


class Shapes(NamedTuple):
    """positions: (S, 3n). clearance: (S,) mm, smallest distance of the body's skin from what is
    solid, as interpolated, negative where it is in it. node: (S,) where along the body that is.
    surely: (S,) what the clearance of no part of the body is below; CAP_MM is enough."""

    positions: SingleArray
    clearance: SingleArray
    node: NDArray[np.int64]
    surely: SingleArray


@_placing
def place_shapes(means, factors, component, normal, base, modes, positions):  # type: ignore[no-untyped-def]
    """Write the centrelines of (S, d) standard normal draws, each for its (S,) component.

    base: (3n,), modes: (d, 3n): a centreline is base + Σ coefficient · mode.
    """
    components, d = means.shape
    width = base.size
    middles = np.empty((components, width), np.float32)
    spreads = np.empty((components, d, width), np.float32)
    for k in range(components):
        _own_modes(means[k], factors[k], base, modes, middles[k], spreads[k])
    for s in range(positions.shape[0]):
        k = component[s]
        for c in range(width):
            positions[s, c] = middles[k, c]
        for i in range(d):
            z = np.float32(normal[s, i])
            for c in range(width):
                positions[s, c] += z * spreads[k, i, c]


@_placing
def _own_modes(mean, factor, base, modes, middle, spread):  # type: ignore[no-untyped-def]
    """Centreline of the mean, and Ū⁻ᵀ times the modes: what each standard normal draw adds."""
    d = mean.size
    middle[:] = base
    for i in range(d):
        middle += np.float32(mean[i]) * modes[i]
    for i in range(d):
        spread[i] = modes[i]
        for j in range(i):
            spread[i] -= np.float32(factor[j, i]) * spread[j]
        spread[i] /= np.float32(factor[i, i])


@_kernel
def clearances(surroundings, skin, shapes):  # type: ignore[no-untyped-def]
    """Write clearance, node and what is sure of each shape."""
    grid, port = _unpacked(surroundings), surroundings.port
    positions, clearance, node, surely = (
        shapes.positions,
        shapes.clearance,
        shapes.node,
        shapes.surely,
    )
    scratch = np.empty(skin.radius.size, np.float32), np.empty((_MOST_CUTS, 4), np.float32)
    for s in range(clearance.size):
        clearance[s], node[s] = _clearance(grid, port, skin, positions, s, scratch)
        surely[s] = _surely(grid, port, skin, positions, s, clearance[s], scratch)


@_kernel
def sweep(surroundings, skin, start, end, swept, surely):  # type: ignore[no-untyped-def]
    """Lower `swept` and `surely`, (S,) clearances on the way from each shape to that of `end`.

    All nodes of a shape go straight and at the same time. While none goes farther than the sure
    clearance at both ends allows, nothing is touched between them; else the way is halved.
    """
    grid, port = _unpacked(surroundings), surroundings.port
    first, last = start.positions, end.positions
    width = first.shape[1]
    scratch = np.empty(skin.radius.size, np.float32), np.empty((_MOST_CUTS, 4), np.float32)
    between = np.empty((1, width), np.float32)
    ways = np.empty((_MOST_CUTS, 4), np.float32)
    for s in range(swept.size):
        swept[s] = min(swept[s], start.clearance[s], end.clearance[s])
        length = _way(first, last, s, width)
        ways[0, 0], ways[0, 1] = 0.0, 1.0
        ways[0, 2], ways[0, 3] = start.surely[s], end.surely[s]
        waiting = 1
        while waiting > 0 and swept[s] > _ZERO:
            waiting -= 1
            begin, stop, before, after = _row(ways, waiting)
            step = (stop - begin) * length
            least = _HALF * (before + after - step)
            if least > _ZERO or step < FINEST_MM or waiting + 2 > _MOST_CUTS:
                surely[s] = min(surely[s], least)
                continue
            half = _HALF * (begin + stop)
            for c in range(width):
                between[0, c] = first[s, c] + half * (last[s, c] - first[s, c])
            there, _ = _clearance(grid, port, skin, between, 0, scratch)
            swept[s] = min(swept[s], there)
            sure = _surely(grid, port, skin, between, 0, there, scratch)
            waiting = _halved(ways, waiting, half, sure)
        surely[s] = min(surely[s], swept[s])


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
def _way(start, end, s, width):  # type: ignore[no-untyped-def]
    """How far the node goes that goes farthest."""
    longest = _ZERO
    for i in range(0, width, 3):
        x, y = end[s, i] - start[s, i], end[s, i + 1] - start[s, i + 1]
        z = end[s, i + 2] - start[s, i + 2]
        longest = max(longest, x * x + y * y + z * z)
    return np.float32(sqrt(longest))


@_inlined
def _clearance(grid, port, skin, positions, s, scratch):  # type: ignore[no-untyped-def]
    """Of shape s: the smallest clearance, and the node where it is, or nearest to where it is.

    Nodes that are so near to another one that they cannot lower the clearance are passed over; what
    is noted for them, in the first part of the scratch, is a distance that they have at least.
    """
    at_node, pieces = scratch
    radius, count, best, node = skin.radius, skin.radius.size, _FAR, 0
    enough = grid[10] + np.float32(CAP_MM) + skin.most
    x0, y0, z0, known = _ZERO, _ZERO, _ZERO, -_FAR
    for step in range(count):
        i = count - 1 if step == 0 else step - 1  # the tip first: it is often the nearest
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        room = known - radius[i] - best
        square = (x - x0) * (x - x0) + (y - y0) * (y - y0) + (z - z0) * (z - z0)
        if room > _ZERO and square < room * room:
            at_node[i] = known - np.float32(sqrt(square))
            continue
        x0, y0, z0 = x, y, z
        known = _distance(grid, x, y, z)
        at_node[i] = known
        if not known - radius[i] >= best and not _is_in_port(port, x, y, z):
            best, node = known - radius[i], i
    longest = best - enough
    if longest > _ZERO and _longest_segment(positions, s, count) < longest * longest:
        return best, node  # no place between nodes is far enough from both
    for i in range(count - 1):
        if not best > _ZERO:
            break
        x = positions[s, 3 * i + 3] - positions[s, 3 * i]
        y = positions[s, 3 * i + 4] - positions[s, 3 * i + 1]
        z = positions[s, 3 * i + 5] - positions[s, 3 * i + 2]
        thick = max(radius[i], radius[i + 1])
        room = at_node[i] + at_node[i + 1] - _TWO * (thick + enough)
        if not (room > _ZERO and x * x + y * y + z * z < room * room):
            ends = at_node[i], at_node[i + 1]
            between, _ = _between(grid, port, (positions, s, i), thick, ends, enough, False, pieces)
            if between < best:
                best, node = between, i
    return best, node


@_inlined
def _longest_segment(positions, s, count):  # type: ignore[no-untyped-def]
    """Square of the longest way from one node to the next."""
    longest = _ZERO
    for i in range(0, 3 * count - 3, 3):
        x, y = positions[s, i + 3] - positions[s, i], positions[s, i + 4] - positions[s, i + 1]
        z = positions[s, i + 5] - positions[s, i + 2]
        longest = max(longest, x * x + y * y + z * z)
    return longest


@_kernel
def _surely(grid, port, skin, positions, s, clearance, scratch):  # type: ignore[no-untyped-def]
    """What the clearance of no part of shape s is below; CAP_MM or less, unless it touches. As
    thick as its centreline may be off. scratch: with distances that its nodes have at least.

    Interpolated distances may be wrong by the grid's error. Where that leaves it open whether the
    shape touches, bounds from the grid's corners are taken, which are nearer to the truth.
    """
    at_node, pieces = scratch
    cut, cap = np.float32(_HALF * FINEST_MM), np.float32(CAP_MM)
    if not clearance > _ZERO:
        return clearance
    if clearance > grid[10] + cut + cap + skin.most:
        return cap
    least, radius = cap, skin.safe
    looked_at, there = -1, _ZERO
    for i in range(radius.size - 1):
        x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
        u, v, w = positions[s, 3 * i + 3], positions[s, 3 * i + 4], positions[s, 3 * i + 5]
        thick = max(radius[i], radius[i + 1])
        length = np.float32(sqrt((u - x) * (u - x) + (v - y) * (v - y) + (w - z) * (w - z)))
        if _HALF * (at_node[i] + at_node[i + 1] - length) - grid[10] - thick > cap:
            continue
        before = there if looked_at == i else _at_least(grid, x, y, z)
        looked_at, there = i + 1, _at_least(grid, u, v, w)
        ends = before, there
        _, between = _between(grid, port, (positions, s, i), thick, ends, cap, True, pieces)
        least = min(least, between)
        if not least > _ZERO:
            return least
    return least


@_kernel
def _between(grid, port, segment, thick, ends, enough, surely, pieces):  # type: ignore[no-untyped-def]
    """From a shape's node to the next, cut until no piece is open: the smallest clearance found,
    and what it is not below.

    segment: positions, number of the shape, and of the node. ends: distances there. enough: a
    piece with so much clearance is not cut. surely: distances are lower bounds.
    """
    positions, s, i = segment
    x0, y0, z0 = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
    x, y, z = positions[s, 3 * i + 3], positions[s, 3 * i + 4], positions[s, 3 * i + 5]
    if _is_in_port(port, x0, y0, z0) and _is_in_port(port, x, y, z):
        return _FAR, _FAR
    dx, dy, dz = x - x0, y - y0, z - z0
    length = np.float32(sqrt(dx * dx + dy * dy + dz * dz))
    pieces[0, 0], pieces[0, 1], pieces[0, 2], pieces[0, 3] = 0.0, 1.0, ends[0], ends[1]
    waiting, found, least = 1, _FAR, _FAR
    while waiting > 0 and found > _ZERO:
        waiting -= 1
        begin, end, before, after = _row(pieces, waiting)
        piece = (end - begin) * length
        lowest = _HALF * (before + after - piece) - thick
        if lowest > enough or piece < FINEST_MM or waiting + 2 > _MOST_CUTS:
            half = _HALF * (begin + end)
            if not _is_in_port(port, x0 + half * dx, y0 + half * dy, z0 + half * dz):
                least = min(least, lowest)
            continue
        half = _HALF * (begin + end)
        x, y, z = x0 + half * dx, y0 + half * dy, z0 + half * dz
        there = _at_least(grid, x, y, z) if surely else _distance(grid, x, y, z)
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
def _unpacked(surroundings):  # type: ignore[no-untyped-def]
    """Everything of the grid as numbers of their own, which stay in registers: values, shape, and
    at 4 the frame."""
    shape, frame = surroundings.shape, surroundings.frame
    return (
        *(surroundings.values, shape[0], shape[1], shape[2]),
        *(frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], frame[6]),
    )


@_inlined
def _distance(grid, x, y, z):  # type: ignore[no-untyped-def]
    """Interpolated between the eight corners; outside the grid, what is known there.

    Places are unsigned: an index that may be negative is looked at twice.
    """
    values, nx, ny, nz = grid[0], grid[1], grid[2], grid[3]
    u, v, w = (x - grid[4]) * grid[7], (y - grid[5]) * grid[7], (z - grid[6]) * grid[7]
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
def _at_least(grid, x, y, z):  # type: ignore[no-untyped-def]
    """A distance that a place surely has: distances have a slope of one, from whichever corner."""
    values, nx, ny, nz = grid[0], grid[1], grid[2], grid[3]
    best = _distance(grid, x, y, z) - grid[10]
    u, v, w = (x - grid[4]) * grid[7], (y - grid[5]) * grid[7], (z - grid[6]) * grid[7]
    inside = u >= _ZERO and v >= _ZERO and w >= _ZERO
    one = np.uint64(1)
    if not (inside and u < nx - one and v < ny - one and w < nz - one):
        return best
    i, j, k = np.uint32(u), np.uint32(v), np.uint32(w)
    for corner in range(8):
        a, b, c = np.uint32(corner & 1), np.uint32((corner >> 1) & 1), np.uint32(corner >> 2)
        p, q, r = u - np.float32(i + a), v - np.float32(j + b), w - np.float32(k + c)
        at = (np.uint64(i + a) * ny + np.uint64(j + b)) * nz + np.uint64(k + c)
        away = np.float32(sqrt(p * p + q * q + r * r)) / grid[7]
        best = max(best, values[at] - away)
    return best


@_kernel
def _outside(grid, u, v, w):  # type: ignore[no-untyped-def]
    """No more than the distance of a place outside the grid; deep in the solid if it is no place.

    From the mesh it is at least as far as from the grid, and the margin.
    """
    if not (abs(u) < _FAR and abs(v) < _FAR and abs(w) < _FAR):
        return -_FAR
    x, y = max(-u, u - np.float32(grid[1]), _ZERO), max(-v, v - np.float32(grid[2]), _ZERO)
    z = max(-w, w - np.float32(grid[3]), _ZERO)
    away = np.float32(sqrt(x * x + y * y + z * z)) / grid[7]
    return grid[8] * (away + grid[9])
