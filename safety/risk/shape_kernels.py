"""Sampled shapes of the body as the compiled code has them: how they are made from draws, and where
the worst of them are.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

S shapes, n nodes along each, d coefficients. All lengths are float32: half the memory, and here
twice the speed. Nodes' coordinates are flat: (S, 3n).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

_LANES = 32
"""Rows are worked on in so many numbers at a time: what is left over would go one by one."""
_ROUNDED_MM = np.float32(0.01)
"""Places of some 100 mm are rounded by less than this."""
_kernel = njit(cache=True, error_model="numpy", nogil=True)
_placing = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
"""A product and its sum are rounded once."""


SingleArray = NDArray[np.float32]


class SolidArrays(NamedTuple):
    """Distances as `distance_grid` has them, and the port, as the compiled code reads them.

    values: (nx·ny·nz,) mm. shape: (3,) uint64. frame: (8,) the grid's origin, places per mm, ±1 for
    free or solid far outside the grid, mm between the grid's end and the mesh, the mm by which a
    distance may be too large, and those up to which it is made of exact ones. port: (8,) centre,
    unit direction inwards, radius (negative: there is none), depth.
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
    solid, as interpolated, negative where it is in it: exact for those that have the least, and of
    the others that of the nearest place that was looked at. node: (S,) where along the body that
    is. surely: (S,) what the clearance of no part of the body is below; CAP_MM is enough. least:
    (S,) what the exact clearance is not below, as interpolated."""

    positions: SingleArray
    clearance: SingleArray
    node: NDArray[np.int64]
    surely: SingleArray
    least: SingleArray


def in_lanes(rows: SingleArray) -> SingleArray:
    """(…, 3n) rows, with zeros up to a whole number of lanes."""
    more = -rows.shape[-1] % _LANES
    return np.pad(rows, [(0, 0)] * (rows.ndim - 1) + [(0, more)])


@_placing
def place_shapes(means, factors, component, normal, base, modes, positions):  # type: ignore[no-untyped-def]
    """Write the centrelines of (S, d) standard normal draws, each for its (S,) component: quickest
    where those of one component are neighbours.

    base: (3n,), modes: (d, 3n): a centreline is base + Σ coefficient · mode. Both are `in_lanes`.
    """
    d, wide, (count, width) = means.shape[1], base.size, positions.shape
    middle, spread = np.empty(wide, np.float32), np.empty((d, wide), np.float32)
    row, other = np.empty(wide, np.float32), np.empty(wide, np.float32)
    known, s = -1, 0
    while s < count:
        k = component[s]
        if k != known:
            _own_modes(means[k], factors[k], base, modes, middle, spread, row)
            known = k
        # Two at a time, where the next is of the same component: what is read serves both.
        both = s + 1 < count and component[s + 1] == k
        o = s + 1 if both else s
        for c in range(wide):
            row[c] = other[c] = middle[c]
        for i in range(0, d // 4 * 4, 4):
            p, q, t, u = _four(normal, s, i)
            pp, qq, tt, uu = _four(normal, o, i)
            for c in range(wide):
                first, second = spread[i, c], spread[i + 1, c]
                third, fourth = spread[i + 2, c], spread[i + 3, c]
                row[c] = (row[c] + p * first + q * second) + t * third + u * fourth
                other[c] = (other[c] + pp * first + qq * second) + tt * third + uu * fourth
        for i in range(d // 4 * 4, d):
            z, zz = np.float32(normal[s, i]), np.float32(normal[o, i])
            for c in range(wide):
                row[c] += z * spread[i, c]
                other[c] += zz * spread[i, c]
        for c in range(width):
            positions[s, c] = row[c]
        for c in range(width):
            positions[o, c] = other[c]
        s = o + 1


@_placing
def _four(normal, s, i):  # type: ignore[no-untyped-def]
    return (
        *(np.float32(normal[s, i]), np.float32(normal[s, i + 1])),
        *(np.float32(normal[s, i + 2]), np.float32(normal[s, i + 3])),
    )


@_placing
def _own_modes(mean, factor, base, modes, middle, spread, row):  # type: ignore[no-untyped-def]
    """Centreline of the mean, and Ū⁻ᵀ times the modes: what each standard normal draw adds.

    Products are rounded by themselves: row has room for them.
    """
    d, width = mean.size, base.size
    for c in range(width):
        middle[c] = base[c]
    for i in range(d):
        _scaled(modes[i], np.float32(mean[i]), row)
        for c in range(width):
            middle[c] += row[c]
            spread[i, c] = modes[i, c]
        for j in range(i):
            _scaled(spread[j], np.float32(factor[j, i]), row)
            for c in range(width):
                spread[i, c] -= row[c]
        share = np.float32(factor[i, i])
        for c in range(width):
            spread[i, c] /= share


@_placing
def _scaled(values, share, row):  # type: ignore[no-untyped-def]
    for c in range(values.size):
        row[c] = share * values[c]


@_kernel
def fall_to(weights, uniform, component):  # type: ignore[no-untyped-def]
    """Write the (S,) component that each of (S,) draws from [0, 1) falls to, which rise."""
    k, edge = 0, weights[0]
    for s in range(uniform.size):
        while k < weights.size - 1 and edge <= uniform[s]:
            k += 1
            edge += weights[k]
        component[s] = k


@_kernel
def find_longest(weights, uniform, length, longest):  # type: ignore[no-untyped-def]
    """Raise (K,) `longest` to the largest of (S,) lengths of the draws that fall to each component,
    as `fall_to` has it."""
    first, edge = 0, 0.0
    for k in range(weights.size):
        edge += weights[k]
        ends = k == weights.size - 1
        last = uniform.size if ends else np.searchsorted(uniform, edge)
        for s in range(first, last):
            longest[k] = max(longest[k], length[s])
        first = max(first, last)


@_kernel
def enclose_draws(means, factors, longest, base, modes, balls):  # type: ignore[no-untyped-def]
    """Widen (K, 5, n) balls by where each node of each component's shapes is whose (d,) draws are
    no longer than `longest`, unless that is negative: middle and radius of a ball, and no less than
    how far it is to the next node. What goes straight from one of them to another stays in it.

    A node is Ū⁻ᵀ modes · z from its middle, which is not longer than the largest singular value
    times z. base and modes are `in_lanes`.
    """
    d, wide, nodes = means.shape[1], base.size, balls.shape[2]
    middle, spread = np.empty(wide, np.float32), np.empty((d, wide), np.float32)
    rows = np.empty((4, wide), np.float32)
    square, beside, over, apart = rows[0], rows[1], rows[2], rows[3]
    for k in range(means.shape[0]):
        if longest[k] < 0.0:
            continue
        _own_modes(means[k], factors[k], base, modes, middle, spread, square)
        rows[:] = 0.0
        for i in range(d):
            own = spread[i]
            for c in range(wide):
                square[c] += own[c] * own[c]
            for c in range(wide - 1):
                beside[c] += own[c] * own[c + 1]
            for c in range(wide - 2):
                over[c] += own[c] * own[c + 2]
            for c in range(wide - 3):
                change = own[c + 3] - own[c]
                apart[c] += change * change
        for n in range(nodes):
            c = 3 * n
            most = _largest_singular(
                *(square[c], beside[c], over[c], square[c + 1], beside[c + 1], square[c + 2])
            )
            radius, away = longest[k] * most + _ROUNDED_MM, np.float32(0.0)
            if n < nodes - 1:
                x, y = middle[c + 3] - middle[c], middle[c + 4] - middle[c + 1]
                z = middle[c + 5] - middle[c + 2]
                away = longest[k] * np.sqrt(apart[c] + apart[c + 1] + apart[c + 2]) + _ROUNDED_MM
                away += np.sqrt(x * x + y * y + z * z)
            _widen(balls[k], n, middle[c], middle[c + 1], middle[c + 2], radius, away)


@_kernel
def _largest_singular(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """What the largest singular value of M is not above, of which M Mᵀ has these: the fourth root
    of the norm of its square, at most 3^(1/8) times as much."""
    a, b, c = xx * xx + xy * xy + xz * xz, xy * xy + yy * yy + yz * yz, xz * xz + yz * yz + zz * zz
    p, q, r = xx * xy + xy * yy + xz * yz, xx * xz + xy * yz + xz * zz, xy * xz + yy * yz + yz * zz
    norm = np.sqrt(a * a + b * b + c * c + np.float32(2.0) * (p * p + q * q + r * r))
    return np.sqrt(np.sqrt(norm))


@_kernel
def _widen(balls, n, x, y, z, radius, away):  # type: ignore[no-untyped-def]
    """Widen ball n of (5, n) by another one. One that is no number is everywhere."""
    if not radius + abs(x) + abs(y) + abs(z) + away < np.inf:
        radius = np.float32(np.inf)
    if balls[3, n] >= 0.0:
        dx, dy, dz = x - balls[0, n], y - balls[1, n], z - balls[2, n]
        half = np.float32(0.5)
        x, y, z = x - half * dx, y - half * dy, z - half * dz
        between = half * np.sqrt(dx * dx + dy * dy + dz * dz) + _ROUNDED_MM
        radius = max(balls[3, n], radius) + between
        if not radius < np.inf:
            radius = np.float32(np.inf)
    balls[0, n], balls[1, n], balls[2, n], balls[3, n] = x, y, z, radius
    balls[4, n] = max(balls[4, n], away)


@_kernel
def find_changed(before, now, rows):  # type: ignore[no-untyped-def]
    """Write the numbers of draws that have fallen to another component, (S,) `before` and `now`,
    first into (S,) rows; return how many they are."""
    count = 0
    for s in range(now.size):
        if now[s] != before[s]:
            rows[count] = s
            count += 1
    return count


@_kernel
def exchange(shapes, rows, others):  # type: ignore[no-untyped-def]
    """What a way is swept with: put that of (R,) others in place of (R,) rows, and of rows in
    others."""
    for r in range(rows.size):
        s = rows[r]
        for c in range(shapes.positions.shape[1]):
            position = shapes.positions[s, c]
            shapes.positions[s, c], others.positions[r, c] = others.positions[r, c], position
        clearance, surely = shapes.clearance[s], shapes.surely[s]
        shapes.clearance[s], others.clearance[r] = others.clearance[r], clearance
        shapes.surely[s], others.surely[r] = others.surely[r], surely


@_kernel
def lower(swept, surely, shapes, rows):  # type: ignore[no-untyped-def]
    """Lower (S,) `swept` and `surely` of (R,) rows to what the shapes have; of no number, no
    number."""
    for r in range(rows.size):
        s = rows[r]
        clearance, sure = shapes.clearance[s], shapes.surely[s]
        if not clearance >= swept[s]:
            swept[s] = swept[s] if np.isnan(swept[s]) else clearance
        if not sure >= surely[s]:
            surely[s] = surely[s] if np.isnan(surely[s]) else sure


@_kernel
def count_shapes(clearance, surely, few, hundredth):  # type: ignore[no-untyped-def]
    """Of (S,) shapes: how many touch, and how many are not proved to be clear; the clearance that
    one in a hundred has no more than, that which none of so `few` with the least has more than,
    that of the middle one, and the mean of those few. In one go: each look at them by itself has
    to be begun."""
    touching, not_clear = 0, 0
    for s in range(clearance.size):
        touching += 1 if clearance[s] <= 0.0 else 0
        not_clear += 0 if surely[s] > 0.0 else 1
    ordered = np.sort(clearance)
    lowest, total = ordered[max(1, hundredth) - 1], 0.0
    for s in range(few):
        total += ordered[s]
    middle = ordered[clearance.size // 2]
    return touching, not_clear, float(lowest), float(ordered[few - 1]), float(middle), total / few


@_kernel
def worst_place(surroundings, shapes, threshold, place, nearest):  # type: ignore[no-untyped-def]
    """The node where most of the shapes have their clearance that have no more than `threshold`.

    Writes the (3,) place of that node on their average, and the (3,) place of the surface nearest
    to there, as far as the distance says, down its slope; of no number, no number.
    """
    clearance, node, positions = shapes.clearance, shapes.node, shapes.positions
    times = np.zeros(positions.shape[1] // 3, np.int64)
    for s in range(clearance.size):
        if clearance[s] <= threshold:
            times[node[s]] += 1
    worst = int(times.argmax())
    place[:] = 0.0
    for s in range(clearance.size):
        if clearance[s] <= threshold and node[s] == worst:
            for j in range(3):
                place[j] += positions[s, 3 * worst + j] / times[worst]
    _down_the_slope(surroundings, place, nearest)
    return worst


@_kernel
def _down_the_slope(surroundings, place, nearest):  # type: ignore[no-untyped-def]
    """Write the (3,) place of the surface that is nearest to a (3,) place."""
    values, frame = surroundings.values, surroundings.frame
    ny, nz = np.int64(surroundings.shape[1]), np.int64(surroundings.shape[2])
    nearest[:] = np.nan
    at = np.empty(3, np.int64)
    for j in range(3):
        along = (place[j] - frame[j]) * frame[3]
        if not abs(along) < np.inf:
            return
        most = np.int64(surroundings.shape[j]) - 2
        at[j] = np.int64(np.rint(min(max(along, 1.0), np.float64(most))))
    here, steps = (at[0] * ny + at[1]) * nz + at[2], (ny * nz, nz, np.int64(1))
    square = 0.0
    for j in range(3):
        slope = np.float64(values[here + steps[j]]) - np.float64(values[here - steps[j]])
        nearest[j] = slope
        square += slope * slope
    for j in range(3):
        if square > 0.0:
            nearest[j] = place[j] - values[here] * nearest[j] / np.sqrt(square)
        else:
            nearest[j] = place[j]


@_kernel
def farthest_mm(modes, shift):  # type: ignore[no-untyped-def]
    """How far the node goes that goes farthest, of (d, n, 3) modes and a (d,) change of their
    coefficients; at least 0."""
    most = 0.0
    for i in range(modes.shape[1]):
        square = 0.0
        for j in range(3):
            way = 0.0
            for c in range(shift.size):
                way += shift[c] * modes[c, i, j]
            square += way * way
        most = max(most, square)
    return np.sqrt(most)
