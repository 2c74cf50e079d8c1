"""Curves of given curvature, and how far points are from a body round them; compiled."""

from math import cos, exp, hypot, sin, sqrt

import numpy as np
from numba import njit

_NEAR = 1
"""Pieces to either side, among which a curve that has moved a little is looked for."""
_NUDGE = 1e-5
"""By which a parameter is changed for a derivative."""

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_kernel
def placed(parameters, terms, length_mm, bends, nodes):  # type: ignore[no-untyped-def]
    """Write (n + 1, 3) nodes of a curve of n pieces of equal length.

    parameters: the terms of the curvature about x, times the length; those about y; angles in rad
    about x and y by which the curve's beginning is turned, which else goes along z; the logarithm
    of how long it is, against length_mm; where it begins, in mm from the origin. terms: (n, t) in
    the middles of the pieces. bends: (n, 2) to write angles of the pieces to. The curve's x and y
    axes do not twist about it.
    """
    pieces, count = terms.shape
    for i in range(pieces):
        for axis in range(2):
            bend = 0.0
            for k in range(count):
                bend += terms[i, k] * parameters[axis * count + k]
            bends[i, axis] = bend / pieces
    h = length_mm * exp(parameters[2 * count + 2]) / pieces
    x, y, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    _turn(x, y, z, parameters[2 * count], parameters[2 * count + 1])
    nodes[0] = parameters[2 * count + 3 :]
    for i in range(pieces):
        # The chord of an arc goes half of its angle aside.
        _turn(x, y, z, 0.5 * bends[i, 0], 0.5 * bends[i, 1])
        for j in range(3):
            nodes[i + 1, j] = nodes[i, j] + h * z[j]
        _turn(x, y, z, 0.5 * bends[i, 0], 0.5 * bends[i, 1])


@_inlined
def _turn(x, y, z, about_x, about_y):  # type: ignore[no-untyped-def]
    """Turn a frame about an axis in its own x-y plane."""
    angle = hypot(about_x, about_y)
    if angle < 1e-12:
        return
    a, b = about_x / angle, about_y / angle
    c, s = cos(angle), sin(angle)
    for j in range(3):
        along, across = a * x[j] + b * y[j], -b * x[j] + a * y[j]
        # `along` is the axis, (along, across, z) a right-handed frame.
        turned, up = c * across + s * z[j], -s * across + c * z[j]
        x[j], y[j], z[j] = a * along - b * turned, b * along + a * turned, up


@_inlined
def _nearest(nodes, p, begin, end):  # type: ignore[no-untyped-def]
    """Which of the pieces begin to end is nearest to a point, and the square of the distance."""
    best, least = begin, 1e300
    for i in range(begin, end):
        square, along, whole = 0.0, 0.0, 0.0
        for j in range(3):
            way, off = nodes[i + 1, j] - nodes[i, j], p[j] - nodes[i, j]
            along += way * off
            whole += way * way
            square += off * off
        share = min(max(along / whole, 0.0), 1.0)
        square += share * (share * whole - 2.0 * along)
        if square < least:
            best, least = i, square
    return best, least


@_inlined
def _off(nodes, p, piece, surface):  # type: ignore[no-untyped-def]
    """Signed distance in mm from the surface, negative inside.

    surface: (4,) radius of the tube, number of disks, their radius and thickness.
    """
    last = len(nodes) - 2
    along, whole, square = 0.0, 0.0, 0.0
    for j in range(3):
        way, off = nodes[piece + 1, j] - nodes[piece, j], p[j] - nodes[piece, j]
        along += way * off
        whole += way * way
        square += off * off
    h = sqrt(whole)
    across = sqrt(max(square - along * along / whole, 0.0))
    at = along / h
    beyond = 0.0
    if piece == last and at > h:
        beyond = at - h
    elif at < 0.0:
        beyond = -at
    elif at > h:
        beyond = at - h
    found = hypot(beyond, across) - surface[0]
    if surface[1] > 0.0:
        inside = min(max(at, 0.0), h) if piece < last else max(at, 0.0)
        s, whole_mm = piece * h + inside, (last + 1) * h
        apart = whole_mm / surface[1]
        disk = min(max(round(s / apart), 1.0), surface[1])
        aside = abs(s - disk * apart) - 0.5 * surface[3]
        out = across - surface[2]
        of_disk = hypot(aside, out) if aside > 0.0 and out > 0.0 else max(aside, out)
        found = min(found, of_disk)
    return found


@_kernel
def misses(points, nodes, surface, found, pieces):  # type: ignore[no-untyped-def]
    """Write (p,) signed distances of (p, 3) points in mm, and which piece each is nearest to."""
    for i in range(len(points)):
        pieces[i], _ = _nearest(nodes, points[i], 0, len(nodes) - 1)
        found[i] = _off(nodes, points[i], pieces[i], surface)


@_kernel
def slopes(points, parameters, terms, length_mm, surface, pieces, now, found):  # type: ignore[no-untyped-def]
    """Write (q, p) derivatives of the misses by the parameters.

    now, pieces: what `misses` has found at these parameters.
    """
    last = len(terms)
    nodes, bends, nudged = np.empty((last + 1, 3)), np.empty((last, 2)), parameters.copy()
    for k in range(len(parameters)):
        nudged[k] += _NUDGE
        placed(nudged, terms, length_mm, bends, nodes)
        for i in range(len(points)):
            begin, end = max(0, pieces[i] - _NEAR), min(last, pieces[i] + _NEAR + 1)
            piece, _ = _nearest(nodes, points[i], begin, end)
            found[k, i] = (_off(nodes, points[i], piece, surface) - now[i]) / _NUDGE
        nudged[k] = parameters[k]


@_kernel
def likely(points, curves, thinnest_mm, thickest_mm, most_mm, found):  # type: ignore[no-untyped-def]
    """Write for each of (c, n, 3) curves the mean square of what (p, 3) points are off a body.

    thinnest_mm, thickest_mm: it has a surface anywhere between. most_mm: no point counts for more.
    """
    for k in range(len(curves)):
        total = 0.0
        for i in range(len(points)):
            _, square = _nearest(curves[k], points[i], 0, curves.shape[1] - 1)
            away = sqrt(square)
            off = min(max(away - thickest_mm, thinnest_mm - away, 0.0), most_mm)
            total += off * off
        found[k] = total / len(points)
