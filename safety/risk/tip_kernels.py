"""How unlikely a place is for the tip of the body, and what of the body it speaks for, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

K components over d coefficients of the body's shape. The tip is linear in them, so that under each
component it is normally distributed, with what it is measured by added to its covariance.
"""

from math import erfc, exp, pi, sqrt

import numpy as np
from numba import njit

_kernel = njit(cache=True, error_model="numpy", nogil=True)


@_kernel
def tail(weights, means, factors, base, modes, variance, place):  # type: ignore[no-untyped-def]
    """The probability that the tip is further out than (3,) place: that of each of (K,) components
    beyond its own ellipsoid through it, weighed.

    means (K, d), factors (K, d, d) as a mixture's. base (3,) and modes (d, 3) of the tip. variance:
    (3,) mm², beside the mixture's own. Not finite where the place is not.
    """
    components, d = means.shape
    spread = np.empty((d, 3))
    total = 0.0
    for k in range(components):
        away_x, away_y, away_z = place[0] - base[0], place[1] - base[1], place[2] - base[2]
        for i in range(d):
            away_x -= means[k, i] * modes[i, 0]
            away_y -= means[k, i] * modes[i, 1]
            away_z -= means[k, i] * modes[i, 2]
        _solve_transposed(factors[k], modes, spread)
        xx, yy, zz = variance[0], variance[1], variance[2]
        xy = xz = yz = 0.0
        for i in range(d):
            x, y, z = spread[i, 0], spread[i, 1], spread[i, 2]
            xx += x * x
            yy += y * y
            zz += z * z
            xy += x * y
            xz += x * z
            yz += y * z
        a, b, c, e, f, g = _factor(xx, xy, xz, yy, yz, zz)
        # The way from the mean in its terms.
        p = away_x / a
        q = (away_y - b * p) / e
        r = (away_z - c * p - f * q) / g
        total += weights[k] * _beyond(sqrt(p * p + q * q + r * r))
    return total


@_kernel
def likeliest_shift(weights, means, factors, base, modes, variance, place, shift):  # type: ignore[no-untyped-def]
    """Write the (d,) by which the coefficients are likeliest to be off from their mean where the
    tip is at (3,) place; return how far that is from the tip of the mean, in mm.

    Arguments are those of `tail`. As of one normal distribution with the mixture's moments, Σ: the
    shift is Σ M (Mᵀ Σ M + R)⁻¹ off, with M the modes and R the variance.
    """
    d = means.shape[1]
    mean, off, with_tip = np.zeros(d), place - base, np.zeros((d, 3))
    for k in range(weights.size):
        for i in range(d):
            mean[i] += weights[k] * means[k, i]
    for i in range(d):
        for j in range(3):
            off[j] -= mean[i] * modes[i, j]
    _add_moments(weights, means, factors, mean, modes, with_tip)
    told = np.zeros((3, 3))
    for i in range(d):
        for j in range(3):
            for c in range(3):
                told[j, c] += modes[i, j] * with_tip[i, c]
    for j in range(3):
        told[j, j] += variance[j]
    a, b, c, e, f, g = _factor(
        told[0, 0], told[0, 1], told[0, 2], told[1, 1], told[1, 2], told[2, 2]
    )
    p = off[0] / a
    q = (off[1] - b * p) / e
    z = (off[2] - c * p - f * q) / (g * g)
    y = (q - f * z) / e
    x = (p - b * y - c * z) / a
    for i in range(d):
        shift[i] = with_tip[i, 0] * x + with_tip[i, 1] * y + with_tip[i, 2] * z
    return sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2])


@_kernel
def _add_moments(weights, means, factors, mean, modes, with_tip):  # type: ignore[no-untyped-def]
    """Add to (d, 3) Σ M of the whole mixture: within its components, and between their means."""
    components, d = means.shape
    spread = np.empty((d, 3))
    for k in range(components):
        _solve_transposed(factors[k], modes, spread)
        for j in range(3):
            apart = 0.0
            for i in range(d):
                apart += (means[k, i] - mean[i]) * modes[i, j]
            for i in range(d - 1, -1, -1):
                for c in range(i + 1, d):
                    spread[i, j] -= factors[k, i, c] * spread[c, j]
                spread[i, j] /= factors[k, i, i]
                with_tip[i, j] += weights[k] * (spread[i, j] + apart * (means[k, i] - mean[i]))


@_kernel
def _factor(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """Cholesky's factor of a symmetric matrix of three rows, column by column."""
    a = sqrt(xx)
    b, c = xy / a, xz / a
    e = sqrt(yy - b * b)
    f = (yz - b * c) / e
    return a, b, c, e, f, sqrt(zz - c * c - f * f)


@_kernel
def _solve_transposed(factor, right, out):  # type: ignore[no-untyped-def]
    """Fill (d, 3) out with what (d, d) upper factor, transposed, makes (d, 3) right."""
    for i in range(right.shape[0]):
        for j in range(3):
            known = right[i, j]
            for k in range(i):
                known -= factor[k, i] * out[k, j]
            out[i, j] = known / factor[i, i]


@_kernel
def _beyond(radius):  # type: ignore[no-untyped-def]
    """Of a standard normal distribution in three dimensions, what is further from its middle."""
    return erfc(radius / sqrt(2.0)) + sqrt(2.0 / pi) * radius * exp(-0.5 * radius * radius)
