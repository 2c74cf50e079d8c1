"""How unlikely a place is for the tip of the body, compiled.

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
        # Cholesky's factor, and the way from the mean in its terms.
        a = sqrt(xx)
        b, c = xy / a, xz / a
        e = sqrt(yy - b * b)
        f = (yz - b * c) / e
        g = sqrt(zz - c * c - f * f)
        p = away_x / a
        q = (away_y - b * p) / e
        r = (away_z - c * p - f * q) / g
        total += weights[k] * _beyond(sqrt(p * p + q * q + r * r))
    return total


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
