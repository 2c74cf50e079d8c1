"""A tree of boxes over triangles, compiled: building it, what a ray crosses, what edges pierce.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LEAF = 4
"""Triangles in a box that is not split any more."""
DEEPEST = 96
"""Of any tree: a stack of so many boxes is never too short."""
_BINS = 12

_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
_kernel = njit(cache=True, error_model="numpy", nogil=True)
_ROUNDING = 1e-13
"""Of products of lengths: more than their rounding."""


class TriangleTree(NamedTuple):
    """Boxes within boxes, and the triangles in the boxes' order.

    boxes: (b, 6) centre and half size. links: (b, 2) int64; (first child, 0), its sister comes
    after it, or (first triangle, how many). corners: (t, 9). vertices: (t, 3) int64 numbers of the
    corners. order: (t,) int64 number of each triangle in the mesh.
    """

    boxes: FloatArray
    links: NDArray[np.int64]
    corners: FloatArray
    order: NDArray[np.int64]


@_kernel
def build(low, high, boxes, links, order):  # type: ignore[no-untyped-def]
    """Split triangles with bounds low, high (t, 3) into boxes. Returns how many boxes there are.

    Where to split is found by the surface area heuristic on a few planes per axis; where none of
    them separates anything, the triangles are halved as they come.
    """
    middle = 0.5 * (low + high)
    stack = np.empty((DEEPEST, 4), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, order.size, 1
    waiting, count = 1, 1
    while waiting > 0:
        waiting -= 1
        node, begin, end, depth = stack[waiting]
        _enclose(low, high, order, begin, end, boxes[node])
        if end - begin <= LEAF:
            links[node, 0], links[node, 1] = begin, end - begin
            continue
        split = begin
        if depth < DEEPEST // 2:
            axis, plane = _best_plane(low, high, middle, order, begin, end)
            split = _partition(middle, order, begin, end, axis, plane)
        if split in (begin, end):
            split = (begin + end) // 2
        links[node, 0], links[node, 1] = count, 0
        stack[waiting, 0], stack[waiting, 1] = count, begin
        stack[waiting, 2], stack[waiting, 3] = split, depth + 1
        stack[waiting + 1, 0], stack[waiting + 1, 1] = count + 1, split
        stack[waiting + 1, 2], stack[waiting + 1, 3] = end, depth + 1
        waiting += 2
        count += 2
    return count


@_kernel
def _enclose(low, high, order, begin, end, box):  # type: ignore[no-untyped-def]
    for axis in range(3):
        lowest, highest = np.inf, -np.inf
        for k in range(begin, end):
            lowest = min(lowest, low[order[k], axis])
            highest = max(highest, high[order[k], axis])
        box[axis] = 0.5 * (lowest + highest)
        # Half a size that covers both ends although the centre was rounded.
        box[3 + axis] = max(highest - box[axis], box[axis] - lowest)


@_kernel
def _best_plane(low, high, middle, order, begin, end):  # type: ignore[no-untyped-def]
    """Axis and coordinate at which the two sides' areas times their triangles are the least."""
    best, best_axis, best_plane = np.inf, 0, np.nan
    counts = np.empty(_BINS, np.int64)
    bounds = np.empty((_BINS, 6))
    right = np.empty(_BINS)
    for axis in range(3):
        first, last = np.inf, -np.inf
        for k in range(begin, end):
            first = min(first, middle[order[k], axis])
            last = max(last, middle[order[k], axis])
        if not last > first:
            continue
        counts[:] = 0
        bounds[:, :3], bounds[:, 3:] = np.inf, -np.inf
        for k in range(begin, end):
            t = order[k]
            b = min(_BINS - 1, int(_BINS * (middle[t, axis] - first) / (last - first)))
            counts[b] += 1
            _grow(bounds[b], low[t], high[t])
        side = np.empty(6)
        side[:3], side[3:] = np.inf, -np.inf
        total = 0
        for b in range(_BINS - 1, 0, -1):
            total += counts[b]
            _grow(side, bounds[b, :3], bounds[b, 3:])
            right[b] = total * _area(side) if total > 0 else 0.0
        side[:3], side[3:] = np.inf, -np.inf
        total = 0
        for b in range(1, _BINS):
            total += counts[b - 1]
            _grow(side, bounds[b - 1, :3], bounds[b - 1, 3:])
            cost = total * _area(side) + right[b] if total > 0 else np.inf
            if cost < best:
                best, best_axis = cost, axis
                best_plane = first + b * (last - first) / _BINS
    return best_axis, best_plane


@_kernel
def _grow(bounds, low, high):  # type: ignore[no-untyped-def]
    for axis in range(3):
        bounds[axis] = min(bounds[axis], low[axis])
        bounds[3 + axis] = max(bounds[3 + axis], high[axis])


@_kernel
def _area(bounds):  # type: ignore[no-untyped-def]
    x, y, z = bounds[3] - bounds[0], bounds[4] - bounds[1], bounds[5] - bounds[2]
    return x * y + y * z + z * x


@_kernel
def _partition(middle, order, begin, end, axis, plane):  # type: ignore[no-untyped-def]
    """Bring the triangles below the plane to the front. Returns where the others begin."""
    split = begin
    for k in range(begin, end):
        if middle[order[k], axis] < plane:
            order[k], order[split] = order[split], order[k]
            split += 1
    return split


@_kernel
def winding_numbers(tree, points, directions, on_surface):  # type: ignore[no-untyped-def]
    """(n,) how often the surface goes round each of (n, 3) points, with its normals out.

    A ray is cast from the point, in the first of (r, 3) directions in which it meets no edge. No
    direction may have a component of zero. A point from which none is good is on the surface: that
    counts as on_surface.
    """
    result = np.full(points.shape[0], on_surface, np.int64)
    stack = np.empty(DEEPEST, np.int64)
    for k in range(points.shape[0]):
        for ray in range(directions.shape[0]):
            winding, clear = _crossings(tree, points, k, directions, ray, stack)
            if clear:
                result[k] = winding
                break
    return result


@_kernel
def _crossings(tree, points, k, directions, ray, stack):  # type: ignore[no-untyped-def]
    """How often the ray goes out through the surface, less how often it goes in, and whether it
    keeps clear of all edges."""
    boxes, links = tree.boxes, tree.links
    u, v, w = directions[ray, 0], directions[ray, 1], directions[ray, 2]
    inverses = (1.0 / u, 1.0 / v, 1.0 / w)
    stack[0] = 0
    waiting, winding = 1, 0
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if not _meets(boxes, node, points, k, inverses):
            continue
        first, count = links[node, 0], links[node, 1]
        if count == 0:
            stack[waiting], stack[waiting + 1] = first, first + 1
            waiting += 2
        for t in range(first, first + count):
            crossing, clear = _crossing(tree.corners, t, points, k, directions, ray)
            if not clear:
                return 0, False
            winding += crossing
    return winding, True


@_inlined
def _meets(boxes, box, points, k, inverses):  # type: ignore[no-untyped-def]
    """Whether the ray goes through the box, made a little larger."""
    enter, leave = 0.0, np.inf
    for axis in range(3):
        way = boxes[box, axis] - points[k, axis]
        half = boxes[box, 3 + axis] + 1e-9 * (abs(way) + boxes[box, 3 + axis])
        one, other = (way - half) * inverses[axis], (way + half) * inverses[axis]
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter <= leave


@_inlined
def _crossing(corners, t, points, k, directions, ray):  # type: ignore[no-untyped-def]
    """1 where the ray leaves through the triangle, −1 where it enters, 0 where it misses.

    And whether that is sure: not where it meets an edge, or begins on the triangle, but for
    rounding.
    """
    x, y, z = points[k, 0], points[k, 1], points[k, 2]
    a0, a1, a2 = corners[t, 0] - x, corners[t, 1] - y, corners[t, 2] - z
    b0, b1, b2 = corners[t, 3] - x, corners[t, 4] - y, corners[t, 5] - z
    c0, c1, c2 = corners[t, 6] - x, corners[t, 7] - y, corners[t, 8] - z
    u, v, w = directions[ray, 0], directions[ray, 1], directions[ray, 2]
    ab = u * (a1 * b2 - a2 * b1) + v * (a2 * b0 - a0 * b2) + w * (a0 * b1 - a1 * b0)
    bc = u * (b1 * c2 - b2 * c1) + v * (b2 * c0 - b0 * c2) + w * (b0 * c1 - b1 * c0)
    ca = u * (c1 * a2 - c2 * a1) + v * (c2 * a0 - c0 * a2) + w * (c0 * a1 - c1 * a0)
    size = max(abs(a0), abs(a1), abs(a2), abs(b0), abs(b1), abs(b2))
    size = max(size, abs(c0), abs(c1), abs(c2))
    doubt = _ROUNDING * size * size
    lowest, highest = min(ab, bc, ca), max(ab, bc, ca)
    if lowest < -doubt and highest > doubt:
        return 0, True
    if lowest <= doubt and highest >= -doubt:
        return 0, False
    p0, p1, p2, q0, q1, q2 = b0 - a0, b1 - a1, b2 - a2, c0 - a0, c1 - a1, c2 - a2
    ahead = a0 * (p1 * q2 - p2 * q1) + a1 * (p2 * q0 - p0 * q2) + a2 * (p0 * q1 - p1 * q0)
    way = 1 if lowest > 0.0 else -1
    if abs(ahead) <= doubt * size:
        return 0, False
    return way if ahead * way > 0.0 else 0, True


@_kernel
def piercings(tree, faces, vertices, edges, near, found, places):  # type: ignore[no-untyped-def]
    """Find where edges go through triangles, or come as near to one as `near`.

    faces: (t, 3) vertices of the tree's triangles, in its order. edges: (e, 2) vertices. A triangle
    that has a vertex in common with an edge is left out. Writes into (room, 2) `found` the edge and
    the triangle, and into (room, 3) `places` where. Returns how many: no more than there is room
    for.
    """
    stack = np.empty(DEEPEST, np.int64)
    count = 0
    for e in range(edges.shape[0]):
        first, last = edges[e, 0], edges[e, 1]
        stack[0], waiting = 0, 1
        while waiting > 0:
            waiting -= 1
            node = stack[waiting]
            if not _reaches(tree.boxes, node, vertices, first, last, near):
                continue
            begin, triangles = tree.links[node, 0], tree.links[node, 1]
            if triangles == 0:
                stack[waiting], stack[waiting + 1] = begin, begin + 1
                waiting += 2
            for t in range(begin, begin + triangles):
                a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
                if first in (a, b, c) or last in (a, b, c):
                    continue
                share = _pierced(tree.corners, t, vertices, first, last, near)
                if share < 0.0:
                    continue
                if count == found.shape[0]:
                    return count
                found[count, 0], found[count, 1] = e, t
                for j in range(3):
                    way = vertices[last, j] - vertices[first, j]
                    places[count, j] = vertices[first, j] + share * way
                count += 1
    return count


@_inlined
def _reaches(boxes, box, vertices, first, last, near):  # type: ignore[no-untyped-def]
    """Whether the box round an edge meets this one."""
    for axis in range(3):
        p, q = vertices[first, axis], vertices[last, axis]
        half = boxes[box, 3 + axis] + near
        if min(p, q) > boxes[box, axis] + half or max(p, q) < boxes[box, axis] - half:
            return False
    return True


@_kernel
def _pierced(corners, t, vertices, first, last, near):  # type: ignore[no-untyped-def]
    """Where along an edge it goes through the triangle's plane, from 0 to 1; −1: not through it."""
    a0, a1, a2 = corners[t, 0], corners[t, 1], corners[t, 2]
    p0, p1, p2 = corners[t, 3] - a0, corners[t, 4] - a1, corners[t, 5] - a2
    q0, q1, q2 = corners[t, 6] - a0, corners[t, 7] - a1, corners[t, 8] - a2
    n0, n1, n2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
    size = sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    if size == 0.0:
        return -1.0
    n0, n1, n2 = n0 / size, n1 / size, n2 / size
    s0, s1, s2 = vertices[first, 0] - a0, vertices[first, 1] - a1, vertices[first, 2] - a2
    e0, e1, e2 = vertices[last, 0] - a0, vertices[last, 1] - a1, vertices[last, 2] - a2
    start, end = n0 * s0 + n1 * s1 + n2 * s2, n0 * e0 + n1 * e1 + n2 * e2
    if min(start, end) > near or max(start, end) < -near or start == end:
        return -1.0
    share = min(max(start / (start - end), 0.0), 1.0)
    x0, x1, x2 = s0 + share * (e0 - s0), s1 + share * (e1 - s1), s2 + share * (e2 - s2)
    if abs(n0 * x0 + n1 * x1 + n2 * x2) > near:
        return -1.0
    # Distances from the three edges, positive inside.
    pp, qq = sqrt(p0 * p0 + p1 * p1 + p2 * p2), sqrt(q0 * q0 + q1 * q1 + q2 * q2)
    u = n0 * (p1 * x2 - p2 * x1) + n1 * (p2 * x0 - p0 * x2) + n2 * (p0 * x1 - p1 * x0)
    v = n0 * (x1 * q2 - x2 * q1) + n1 * (x2 * q0 - x0 * q2) + n2 * (x0 * q1 - x1 * q0)
    r0, r1, r2 = q0 - p0, q1 - p1, q2 - p2
    rr = sqrt(r0 * r0 + r1 * r1 + r2 * r2)
    if u < -near * pp or v < -near * qq or size - u - v < -near * rr:
        return -1.0
    return share
