"""How much of a normal distribution is within a closed surface, compiled: nearly exact.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

In the component's whitened space, each ray from its mean is in the solid between some of its
crossings with the surface, and what lies beyond a crossing at r has the share sf(r) of the ray,
sf(r) = erfc(r/√2) + √(2/π) r e^{−r²/2}. What remains is an integral over directions, which here is
taken over the surface that they meet, triangle by triangle: y·n dA / (4π r³) is the part of all
directions that a piece of it covers. So no direction is missed, and nothing jumps when parameters
move. With normals out of the solid,

    share = [the mean is in it] − ∮ sf(r) / (4π r³) y·n dA

and its derivatives need E[y] = −∮ φ n dA and E[1 − yyᵀ] = ∮ φ n yᵀ dA over the solid.
"""

from math import atan2, erfc, exp, log, pi, sqrt

import numpy as np
from numba import njit

SUMS = 13
"""share, E[y] and E[1 − yyᵀ] by rows."""
_SMALLEST = 1e-5
"""A surface where the density is by this less than where the mixture's is highest on it, is not
looked at."""
_NEAR = 1.0
"""Nearer than this, a triangle's solid angle is taken out of the integral: the rest is smooth."""
_DEEPEST = 96
"""Of any tree."""
_MOST_QUARTERINGS = 24
_ONE, _THREE, _SEVEN = 0.1, 1.0, 1000.0
"""Up to which measure of change over a triangle so many points are enough. With these the result
was within 4e-4 of itself in all of a number of trials, and within 2e-5 in half of them."""
_ROOT = sqrt(2.0 / pi)
_DENSITY = (2.0 * pi) ** -1.5
_INNER, _OUTER = (6.0 - sqrt(15.0)) / 21.0, (6.0 + sqrt(15.0)) / 21.0
_INNER_WEIGHT, _OUTER_WEIGHT = (155.0 - sqrt(15.0)) / 1200.0, (155.0 + sqrt(15.0)) / 1200.0

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_kernel
def solid_shares(tree, means, factors, levels, inside, sums):  # type: ignore[no-untyped-def]
    """Write each component's share, E[y] and E[1 − yyᵀ] over the solid into (K, SUMS) `sums`.

    levels: (K,) square of the whitened distance at which the component's density is what the
    mixture's highest on the surface is; negative where it is nowhere so high. inside: (K,) bool,
    whether the mean is in the solid.
    """
    stack = np.empty(_DEEPEST, np.int64)
    parts = np.empty((3 * _MOST_QUARTERINGS + 1, 10))
    mean, factor, own = np.empty(3), np.empty((3, 3)), np.empty(SUMS)
    for k in range(means.shape[0]):
        mean[:], factor[:], own[:] = means[k], factors[k], 0.0
        _add_surface(tree, mean, factor, levels[k], stack, parts, own)
        sums[k] = own
        sums[k, 0] += 1.0 if inside[k] else 0.0


@_kernel
def _add_surface(tree, mean, factor, level, stack, parts, sums):  # type: ignore[no-untyped-def]
    reach = sqrt(max(level - 2.0 * log(_SMALLEST), 0.0))
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        box = stack[waiting]
        if _box_distance(tree.boxes, box, mean, factor) > reach * reach:
            continue
        first, triangles = tree.links[box, 0], tree.links[box, 1]
        if triangles == 0:
            stack[waiting], stack[waiting + 1] = first, first + 1
            waiting += 2
        for t in range(first, first + triangles):
            _whiten(tree.corners, t, mean, factor, parts)
            _add_triangle(parts, level, reach, sums)


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
def _whiten(corners, triangle, mean, factor, parts):  # type: ignore[no-untyped-def]
    parts[0, 9] = 0.0
    for c in range(0, 9, 3):
        x0 = corners[triangle, c] - mean[0]
        x1 = corners[triangle, c + 1] - mean[1]
        x2 = corners[triangle, c + 2] - mean[2]
        parts[0, c] = factor[0, 0] * x0 + factor[0, 1] * x1 + factor[0, 2] * x2
        parts[0, c + 1] = factor[1, 1] * x1 + factor[1, 2] * x2
        parts[0, c + 2] = factor[2, 2] * x2


@_kernel
def _add_triangle(parts, level, reach, sums):  # type: ignore[no-untyped-def]
    """Add the triangle in the first row, quartered where it is too large for a few points.

    parts: (n, 10) corners, and how often it is a quarter of a quarter.
    """
    waiting = 1
    while waiting > 0:
        waiting -= 1
        middle, radius, edge = _size(parts, waiting)
        near = max(middle - radius, 0.0)
        if near > reach:
            continue
        counts = exp(-0.5 * max(near * near - level, 0.0))
        close = near < _NEAR
        change = edge * (middle + 1.0 if close else middle + 3.0 / middle)
        square = change * change
        if square * counts < _ONE:
            _add_points(parts, waiting, 1, close, sums)
        elif square * square * counts < _THREE:
            _add_points(parts, waiting, 3, close, sums)
        elif square * square * square * counts < _SEVEN or parts[waiting, 9] >= _MOST_QUARTERINGS:
            _add_points(parts, waiting, 7, close, sums)
        else:
            _quarter(parts, waiting)
            waiting += 4


@_inlined
def _size(parts, row):  # type: ignore[no-untyped-def]
    """Distance of the triangle's middle, radius about it, longest edge."""
    x = (parts[row, 0] + parts[row, 3] + parts[row, 6]) / 3.0
    y = (parts[row, 1] + parts[row, 4] + parts[row, 7]) / 3.0
    z = (parts[row, 2] + parts[row, 5] + parts[row, 8]) / 3.0
    radius, edge = 0.0, 0.0
    for c in range(0, 9, 3):
        d = (c + 3) % 9
        u, v, w = parts[row, c] - x, parts[row, c + 1] - y, parts[row, c + 2] - z
        radius = max(radius, u * u + v * v + w * w)
        u, v = parts[row, c] - parts[row, d], parts[row, c + 1] - parts[row, d + 1]
        w = parts[row, c + 2] - parts[row, d + 2]
        edge = max(edge, u * u + v * v + w * w)
    return sqrt(x * x + y * y + z * z), sqrt(radius), sqrt(edge)


@_inlined
def _quarter(parts, row):  # type: ignore[no-untyped-def]
    """Put the triangle's four quarters in its row and the next three."""
    depth = parts[row, 9] + 1.0
    for k in range(1, 4):
        parts[row + k, 9] = depth
    parts[row, 9] = depth
    for i in range(3):
        a, b, c = parts[row, i], parts[row, 3 + i], parts[row, 6 + i]
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts[row, i], parts[row, 3 + i], parts[row, 6 + i] = a, ab, ca
        parts[row + 1, i], parts[row + 1, 3 + i], parts[row + 1, 6 + i] = ab, b, bc
        parts[row + 2, i], parts[row + 2, 3 + i], parts[row + 2, 6 + i] = ca, bc, c
        parts[row + 3, i], parts[row + 3, 3 + i], parts[row + 3, 6 + i] = ab, bc, ca


@_kernel
def _add_points(parts, row, points, close, sums):  # type: ignore[no-untyped-def]
    """Add a triangle by the values at 1, 3 or 7 of its points (exact to degree 1, 2, 5)."""
    a0, a1, a2 = parts[row, 0], parts[row, 1], parts[row, 2]
    p0, p1, p2 = parts[row, 3] - a0, parts[row, 4] - a1, parts[row, 5] - a2
    q0, q1, q2 = parts[row, 6] - a0, parts[row, 7] - a1, parts[row, 8] - a2
    # n: the normal, as long as the area.
    n0, n1, n2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
    n0, n1, n2 = 0.5 * n0, 0.5 * n1, 0.5 * n2
    height = n0 * a0 + n1 * a1 + n2 * a2
    mean_share, d, e0, e1, e2 = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(points):
        v, w, weight = _place(k, points)
        x, y, z = a0 + v * p0 + w * q0, a1 + v * p1 + w * q1, a2 + v * p2 + w * q2
        square = x * x + y * y + z * z
        r, bell = sqrt(square), exp(-0.5 * square)
        mean_share += weight * (_within(r, bell) if close else -_beyond(r, bell))
        density = weight * _DENSITY * bell
        d += density
        e0, e1, e2 = e0 + density * x, e1 + density * y, e2 + density * z
    sums[0] += height * mean_share
    if close:
        sums[0] -= _solid_angle(parts, row) / (4.0 * pi)
    sums[1], sums[2], sums[3] = sums[1] - n0 * d, sums[2] - n1 * d, sums[3] - n2 * d
    sums[4], sums[5], sums[6] = sums[4] + n0 * e0, sums[5] + n0 * e1, sums[6] + n0 * e2
    sums[7], sums[8], sums[9] = sums[7] + n1 * e0, sums[8] + n1 * e1, sums[9] + n1 * e2
    sums[10], sums[11], sums[12] = sums[10] + n2 * e0, sums[11] + n2 * e1, sums[12] + n2 * e2


@_inlined
def _place(k, points):  # type: ignore[no-untyped-def]
    """Where the point number k is, along two edges, and its weight."""
    if points == 1 or (points == 7 and k == 6):
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 if points == 1 else 0.225
    if points == 3:
        side, weight = 1.0 / 6.0, 1.0 / 3.0
    elif k < 3:
        side, weight = _INNER, _INNER_WEIGHT
    else:
        side, weight = _OUTER, _OUTER_WEIGHT
    corner = k % 3
    return (
        1.0 - 2.0 * side if corner == 1 else side,
        1.0 - 2.0 * side if corner == 2 else side,
        weight,
    )


@_inlined
def _beyond(r, bell):  # type: ignore[no-untyped-def]
    """sf(r) / (4π r³)."""
    return (erfc(r / sqrt(2.0)) + _ROOT * r * bell) / (4.0 * pi * r * r * r)


@_inlined
def _within(r, bell):  # type: ignore[no-untyped-def]
    """(1 − sf(r)) / (4π r³), which is smooth at zero: there it is summed up as a series."""
    if r > 0.5:
        return (1.0 - erfc(r / sqrt(2.0)) - _ROOT * r * bell) / (4.0 * pi * r * r * r)
    term, total, half = 1.0, 0.0, -0.5 * r * r
    for n in range(10):
        total += term / (2 * n + 3)
        term *= half / (n + 1)
    return _ROOT * total / (4.0 * pi)


@_kernel
def _solid_angle(parts, row):  # type: ignore[no-untyped-def]
    """Of the triangle from the origin; positive where its normal points away."""
    a0, a1, a2 = parts[row, 0], parts[row, 1], parts[row, 2]
    b0, b1, b2 = parts[row, 3], parts[row, 4], parts[row, 5]
    c0, c1, c2 = parts[row, 6], parts[row, 7], parts[row, 8]
    a, b = sqrt(a0 * a0 + a1 * a1 + a2 * a2), sqrt(b0 * b0 + b1 * b1 + b2 * b2)
    c = sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    volume = a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)
    ab, bc = a0 * b0 + a1 * b1 + a2 * b2, b0 * c0 + b1 * c1 + b2 * c2
    ca = c0 * a0 + c1 * a1 + c2 * a2
    return 2.0 * atan2(volume, a * b * c + ab * c + bc * a + ca * b)
