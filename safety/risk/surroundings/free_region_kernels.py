"""The convex free region round a normal distribution, compiled: its planes, and what is outside.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself. Rows of arrays are handed over as array and number: a view costs
more than what is done with it.

All in the component's whitened space, y = Ū(x − μ), where it is standard normal about the origin.
"""

from math import erfc, exp, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

FARTHEST = 6.5
"""Triangles beyond this are not looked at one by one; χ₃ has 4e-9 beyond it."""
MOST_PLANES = 1024
_TOUCHES = 1e-9
"""By how much of its distance a plane is drawn nearer: the triangles round the point that made it
are then beyond it, whatever the rounding."""
_ROUNDING = 1e-12
_TOLERANCE = 1e-3
"""Of a component's bound, what is left open in one cell."""
_DEEPEST = 96
"""Of any tree."""

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


class Work(NamedTuple):
    """Room for one search.

    keys, items: (boxes + triangles,) a heap, the nearest first; −1 − t stands for triangle t.
    planes: (MOST_PLANES, 4) a and b of each, the result. in_mesh: (MOST_PLANES, 7) g, |g| and e:
    a point x of the mesh is beyond where g·x ≥ e.
    """

    keys: FloatArray
    items: IndexArray
    planes: FloatArray
    in_mesh: FloatArray


class Cells(NamedTuple):
    """Triangles that tile the sphere, and four in each of them, and so on.

    corners: (c, 9). share: (c,) of the whole sphere. depth: (c,) how near to the centre the flat
    triangle comes. children: (c,) the first of four, or −1.
    """

    corners: FloatArray
    share: FloatArray
    depth: FloatArray
    children: IndexArray


@_kernel
def mixture_bounds(tree, means, factors, inside, work, cells, roots, result):  # type: ignore[no-untyped-def]
    """Write what is known of each component into (K, 7) `result`: see `body_point`.

    inside: (K,) bool, whether the mean is in the solid: then only the nearest point is looked for.
    cells: none of them, where no tighter bound is wanted.
    """
    mean, factor, planes = np.empty(3), np.empty((3, 3)), work.planes
    for k in range(means.shape[0]):
        mean[:], factor[:] = means[k], factors[k]
        most = 1 if inside[k] else MOST_PLANES
        count, reach = free_region(tree, mean, factor, work, most)
        on_surface = count == 0 and reach == 0.0
        for i in range(3):
            result[k, 4 + i] = planes[0, i] * planes[0, 3] if count > 0 else np.nan
        result[k, 2], result[k, 3] = planes[0, 3] if count > 0 else reach, count
        if inside[k] or on_surface:
            result[k, 0], result[k, 1] = 1.0, 1.0
            continue
        union = _sum_over_planes(planes, count, reach)
        result[k, 0], result[k, 1] = union, min(union, 1.0)
        if cells.children.size > 0:
            tolerance = _TOLERANCE * min(union, 1.0)
            tighter = _outside_region(planes, count, reach, cells, roots, tolerance)
            result[k, 1] = min(result[k, 1], tighter)


@_kernel
def free_region(tree, mean, factor, work, most):  # type: ignore[no-untyped-def]
    """Write the planes of the free region, nearest first, each (a, b): it is where a·y ≤ b.

    The nearest triangle gives the first plane: through its nearest point, square to the way there.
    What is beyond it is done with; the nearest of the rest gives the next. Boxes and triangles come
    from a heap by their distance, so each is looked at once. A box is done with where all of it is
    beyond one plane, a triangle where all its corners are.

    most: after so many planes it ends. Returns how many there are, and a distance within which no
    triangle is that they do not hide; infinite if they hide all. No planes and 0 where the mean is
    on a triangle.
    """
    boxes, links, corners = tree.boxes, tree.links, tree.corners
    keys, items, planes, in_mesh = work.keys, work.items, work.planes, work.in_mesh
    y = np.empty(9)
    keys[0], items[0] = 0.0, 0
    size, count = 1, 0
    while size > 0:
        key, item = keys[0], items[0]
        if key > FARTHEST * FARTHEST or count == most:
            hidden = _rest_hidden(tree, mean, factor, work, count, size)
            return count, np.inf if hidden else sqrt(key)
        size = _pop(keys, items, size)
        if item < 0:
            _whiten(corners, -1 - item, mean, factor, y)
            if _triangle_hidden(y, planes, count):
                continue
            if not _add_plane(y, mean, factor, planes, in_mesh, count):
                return 0, 0.0
            count += 1
        elif not _box_hidden(boxes, item, in_mesh, count):
            first, triangles = links[item, 0], links[item, 1]
            if triangles == 0:
                for child in range(first, first + 2):
                    if not _box_hidden(boxes, child, in_mesh, count):
                        key = _box_distance(boxes, child, mean, factor)
                        _push(keys, items, size, key, child)
                        size += 1
            for t in range(first, first + triangles):
                _whiten(corners, t, mean, factor, y)
                if not _triangle_hidden(y, planes, count):
                    _push(keys, items, size, _nearest(y)[0], -1 - t)
                    size += 1
    return count, np.inf


@_kernel
def _rest_hidden(tree, mean, factor, work, count, size):  # type: ignore[no-untyped-def]
    """Whether the planes hide all that waits in the heap."""
    stack = np.empty(_DEEPEST, np.int64)
    y = np.empty(9)
    for place in range(size):
        stack[0], waiting = work.items[place], 1
        while waiting > 0:
            waiting -= 1
            item = stack[waiting]
            if item < 0:
                _whiten(tree.corners, -1 - item, mean, factor, y)
                if not _triangle_hidden(y, work.planes, count):
                    return False
            elif not _box_hidden(tree.boxes, item, work.in_mesh, count):
                first, triangles = tree.links[item, 0], tree.links[item, 1]
                for k in range(first, first + max(triangles, 2)):
                    stack[waiting] = k if triangles == 0 else -1 - k
                    waiting += 1
    return True


@_inlined
def _push(keys, items, size, key, item):  # type: ignore[no-untyped-def]
    place = size
    while place > 0 and keys[(place - 1) // 2] > key:
        above = (place - 1) // 2
        keys[place], items[place] = keys[above], items[above]
        place = above
    keys[place], items[place] = key, item


@_inlined
def _pop(keys, items, size):  # type: ignore[no-untyped-def]
    """Take the first away. Returns how many are left."""
    size -= 1
    key, item, place = keys[size], items[size], 0
    while 2 * place + 1 < size:
        below = 2 * place + 1
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[place], items[place] = keys[below], items[below]
        place = below
    keys[place], items[place] = key, item
    return size


@_inlined
def _box_distance(boxes, box, mean, factor):  # type: ignore[no-untyped-def]
    """Square of a distance that no point of the box is nearer than."""
    x, y, z = boxes[box, 0] - mean[0], boxes[box, 1] - mean[1], boxes[box, 2] - mean[2]
    hx, hy, hz = boxes[box, 3], boxes[box, 4], boxes[box, 5]
    u = abs(factor[0, 0] * x + factor[0, 1] * y + factor[0, 2] * z)
    u -= abs(factor[0, 0]) * hx + abs(factor[0, 1]) * hy + abs(factor[0, 2]) * hz
    v = abs(factor[1, 1] * y + factor[1, 2] * z)
    v -= abs(factor[1, 1]) * hy + abs(factor[1, 2]) * hz
    w = abs(factor[2, 2] * z) - abs(factor[2, 2]) * hz
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    return u * u + v * v + w * w


@_inlined
def _box_hidden(boxes, box, in_mesh, count):  # type: ignore[no-untyped-def]
    """Whether all of the box is beyond one plane."""
    x, y, z = boxes[box, 0], boxes[box, 1], boxes[box, 2]
    hx, hy, hz = boxes[box, 3], boxes[box, 4], boxes[box, 5]
    for k in range(count):
        lowest = in_mesh[k, 0] * x + in_mesh[k, 1] * y + in_mesh[k, 2] * z
        lowest -= in_mesh[k, 3] * hx + in_mesh[k, 4] * hy + in_mesh[k, 5] * hz
        if lowest >= in_mesh[k, 6]:
            return True
    return False


@_inlined
def _triangle_hidden(y, planes, count):  # type: ignore[no-untyped-def]
    """Whether all corners are beyond one plane."""
    for k in range(count):
        a, b, c, least = planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3]
        first = a * y[0] + b * y[1] + c * y[2]
        second = a * y[3] + b * y[4] + c * y[5]
        third = a * y[6] + b * y[7] + c * y[8]
        if min(first, second, third) >= least:
            return True
    return False


@_kernel
def _add_plane(y, mean, factor, planes, in_mesh, count):  # type: ignore[no-untyped-def]
    """The plane at the triangle's nearest point, also as the boxes' coordinates need it.

    Returns False where the triangle goes through the origin.
    """
    square, u, v, w = _nearest(y)
    distance = sqrt(square)
    near = distance * (1.0 - _TOUCHES) - _ROUNDING
    if not near > 0.0:
        return False
    planes[count, 0], planes[count, 1], planes[count, 2] = u / distance, v / distance, w / distance
    planes[count, 3] = near
    offset = near
    for j in range(3):
        g = 0.0
        for i in range(j + 1):
            g += factor[i, j] * planes[count, i]
        in_mesh[count, j], in_mesh[count, 3 + j] = g, abs(g)
        offset += g * mean[j]
    in_mesh[count, 6] = offset
    return True


@_inlined
def _whiten(corners, triangle, mean, factor, y):  # type: ignore[no-untyped-def]
    for c in range(0, 9, 3):
        x0 = corners[triangle, c] - mean[0]
        x1 = corners[triangle, c + 1] - mean[1]
        x2 = corners[triangle, c + 2] - mean[2]
        y[c] = factor[0, 0] * x0 + factor[0, 1] * x1 + factor[0, 2] * x2
        y[c + 1] = factor[1, 1] * x1 + factor[1, 2] * x2
        y[c + 2] = factor[2, 2] * x2


@_inlined
def _nearest(y):  # type: ignore[no-untyped-def]
    """The triangle's point nearest to the origin: square of its distance, and its coordinates.

    From the projections of the corners on two edges follow the corners', the edges' and the
    inside's own regions.
    """
    a0, a1, a2 = y[0], y[1], y[2]
    p0, p1, p2 = y[3] - a0, y[4] - a1, y[5] - a2
    q0, q1, q2 = y[6] - a0, y[7] - a1, y[8] - a2
    d1, d2 = -(p0 * a0 + p1 * a1 + p2 * a2), -(q0 * a0 + q1 * a1 + q2 * a2)
    pp, pq, qq = (
        p0 * p0 + p1 * p1 + p2 * p2,
        p0 * q0 + p1 * q1 + p2 * q2,
        q0 * q0 + q1 * q1 + q2 * q2,
    )
    d3, d4, d5, d6 = d1 - pp, d2 - pq, d1 - pq, d2 - qq
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0  # the point is a + v·p + w·q
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    x0, x1, x2 = a0 + v * p0 + w * q0, a1 + v * p1 + w * q1, a2 + v * p2 + w * q2
    return x0 * x0 + x1 * x1 + x2 * x2, x0, x1, x2


@_kernel
def _sum_over_planes(planes, count, reach):  # type: ignore[no-untyped-def]
    """Σ (1 − Φ(b)) over the planes, and what lies beyond `reach`."""
    total = _beyond(reach)
    for k in range(count):
        total += 0.5 * erfc(planes[k, 3] / sqrt(2.0))
    return total


@_inlined
def _beyond(distance):  # type: ignore[no-untyped-def]
    """Share of the standard normal distribution in space that is farther away than this."""
    if distance == np.inf:
        return 0.0
    return erfc(distance / sqrt(2.0)) + sqrt(2.0 / np.pi) * distance * exp(-0.5 * distance**2)


@_kernel
def _outside_region(planes, count, reach, cells, roots, tolerance):  # type: ignore[no-untyped-def]
    """Upper bound of what is beyond any plane or `reach`: the sphere is cut into cells.

    In a cell's whole cone the region ends nowhere nearer than the least b / max a·u. A cell is
    replaced by its four children while that and what is surely outside differ by more than
    `tolerance`.
    """
    stack = np.empty(256, np.int64)
    for k in range(roots):
        stack[k] = k
    waiting, total = roots, 0.0
    while waiting > 0:
        waiting -= 1
        cell = stack[waiting]
        near, far = _ends(cells.corners, cells.depth[cell], cell, planes, count)
        most = cells.share[cell] * _beyond(min(near, reach))
        first = cells.children[cell]
        if first < 0 or most - cells.share[cell] * _beyond(min(far, reach)) <= tolerance:
            total += most
            continue
        for child in range(first, first + 4):
            stack[waiting] = child
            waiting += 1
    return total


@_inlined
def _ends(corners, depth, cell, planes, count):  # type: ignore[no-untyped-def]
    """Nowhere in the cell's cone does the region end nearer than the first, or after the second.

    A direction in the cone is a point of the flat triangle through the corners, divided by its
    length; a·u is linear on the triangle, and the length is at least `depth` and at most one.
    """
    near, far = 0.0, 0.0  # both as 1 / distance
    for k in range(count):
        a, b, c, distance = planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3]
        u = a * corners[cell, 0] + b * corners[cell, 1] + c * corners[cell, 2]
        v = a * corners[cell, 3] + b * corners[cell, 4] + c * corners[cell, 5]
        w = a * corners[cell, 6] + b * corners[cell, 7] + c * corners[cell, 8]
        near = max(near, min(max(u, v, w) / depth, 1.0) / distance)
        far = max(far, min(u, v, w) / distance)
    return 1.0 / near, 1.0 / far
