"""A mixture of normal distributions after a linear observation, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

K components over d coefficients, q observed numbers. All that is needed comes from two Cholesky
factors of each component, that of its covariance and that of its precision afterwards. Work is
done for all components at a time: they are the last index, so that they run in parallel lanes.
"""

from math import log, sqrt

import numpy as np
from numba import njit

_kernel = njit(cache=True, error_model="numpy", nogil=True)


@_kernel
def condition(  # type: ignore[no-untyped-def]
    weights, means, factors, beside, matrix, value, variance, out_weights, out_means, out_factors
):
    """Write the mixture given value = matrix · coefficients + noise. Returns the logarithm of the
    density of the value before it was known; not finite: nothing usable was written.

    weights (K,), means (K, d), factors (K, d, d) as a mixture's, and the same of what is written.
    beside (d, d) is added to each covariance. matrix (q, d), value (q,), variance (q,) of the
    noise, whose entries know nothing of each other.
    """
    components, d = means.shape
    root, inverse = np.empty((d, d, components)), np.empty((d, d, components))
    told, right = np.empty((d, d, components)), np.empty((d, components))
    square, logs = np.empty(components), np.zeros(components)
    _invert_upper(factors, inverse)
    _covariance(inverse, beside, told)
    _cholesky(told, root, logs)
    _precision(root, inverse, told)
    _observe(matrix, variance, told)
    _cholesky(told, root, logs)
    _missed(means, matrix, value, variance, right, square)
    _move(root, right, square)
    total = 0.0
    for k in range(components):
        for i in range(d):
            out_means[k, i] = means[k, i] + right[i, k]
            total += abs(out_means[k, i])
            for j in range(d):
                out_factors[k, i, j] = root[j, i, k] if j >= i else 0.0
                total += abs(out_factors[k, i, j])
    log_density = _weigh(weights, variance, square, logs, out_weights)
    return log_density if np.isfinite(total) else np.nan


@_kernel
def spread(weights, means, factors, matrix):  # type: ignore[no-untyped-def]
    """Sum of the variances of matrix · coefficients, of the whole mixture. matrix: (q, d)."""
    components, d = means.shape
    total, row, middle = 0.0, np.empty(d), np.empty(components)
    for o in range(matrix.shape[0]):
        mean = 0.0
        for k in range(components):
            middle[k] = 0.0
            for i in range(d):
                middle[k] += matrix[o, i] * means[k, i]
            mean += weights[k] * middle[k]
        for k in range(components):
            square = (middle[k] - mean) ** 2
            for i in range(d):
                row[i] = matrix[o, i]
                for c in range(i):
                    row[i] -= factors[k, c, i] * row[c]
                row[i] /= factors[k, i, i]
                square += row[i] * row[i]
            total += weights[k] * square
    return total


@_kernel
def write_moved_tip(  # type: ignore[no-untyped-def]
    weights, means, seen_mean, matrix, offset, seen, unsure, length, forgets, value, variance
):
    """Write what a tip that was seen says of another place of the axes, where it is taken to have
    gone as the mixture's mean has: (q,) value and (q,) variance of matrix · coefficients.

    weights (K,), means (K, d) there, and (d,) seen_mean of the mixture where the tip was seen.
    matrix (6, d) and offset (6,): place and direction of the tip. seen: (q,) of both, or the place
    alone. unsure: (2,) variances of place and direction; forgets: standard deviation of the place
    for each mm that it goes on, and of the direction for each rad, or as much by a body's length.
    """
    d, place = seen_mean.size, 3
    went, shift, way = np.zeros(value.size), np.empty(d), 0.0
    for i in range(d):
        shift[i] = -seen_mean[i]
        for k in range(weights.size):
            shift[i] += weights[k] * means[k, i]
    for o in range(value.size):
        for i in range(d):
            went[o] += matrix[o, i] * shift[i]
        value[o] = seen[o] + went[o] - offset[o]
    for o in range(place):
        way += went[o] * went[o]
    turned = way / (length * length)
    if value.size > place:
        turned = max(turned, went[3] * went[3] + went[4] * went[4] + went[5] * went[5])
    for o in range(value.size):
        if o < place:
            variance[o] = unsure[0] + forgets * forgets * way
        else:
            variance[o] = unsure[1] + forgets * forgets * turned


@_kernel
def _invert_upper(factors, out):  # type: ignore[no-untyped-def]
    """Fill the upper halves of (d, d, K) with the inverses of (K, d, d) upper factors."""
    d, _, components = out.shape
    upper = np.empty((d, d, components))
    for k in range(components):
        for i in range(d):
            for j in range(i, d):
                upper[i, j, k] = factors[k, i, j]
    for j in range(d):
        for k in range(components):
            out[j, j, k] = 1.0 / upper[j, j, k]
        for i in range(j - 1, -1, -1):
            for k in range(components):
                out[i, j, k] = 0.0
            for c in range(i + 1, j + 1):
                for k in range(components):
                    out[i, j, k] -= upper[i, c, k] * out[c, j, k]
            for k in range(components):
                out[i, j, k] *= out[i, i, k]


@_kernel
def _covariance(inverse, beside, out):  # type: ignore[no-untyped-def]
    """Fill the lower halves of (d, d, K) with what upper inverse factors are of, and what is beside
    it."""
    d, _, components = out.shape
    for i in range(d):
        for j in range(i, d):
            for k in range(components):
                out[j, i, k] = beside[i, j]
            for c in range(j, d):
                for k in range(components):
                    out[j, i, k] += inverse[i, c, k] * inverse[j, c, k]


@_kernel
def _observe(matrix, variance, out):  # type: ignore[no-untyped-def]
    """Add to the lower halves of (d, d, K) the precision that the observation adds."""
    d, _, components = out.shape
    for i in range(d):
        for j in range(i + 1):
            entry = 0.0
            for o in range(variance.size):
                entry += matrix[o, i] * matrix[o, j] / variance[o]
            for k in range(components):
                out[i, j, k] += entry


@_kernel
def _cholesky(symmetric, root, logs):  # type: ignore[no-untyped-def]
    """Fill the lower halves of (d, d, K) with factors, and add to (K,) the logarithm of the product
    of each diagonal; not finite where there is none. Only the lower halves are looked at."""
    d, _, components = root.shape
    by_diagonal, product = np.empty(components), np.ones(components)
    for j in range(d):
        for i in range(j, d):
            for k in range(components):
                root[i, j, k] = symmetric[i, j, k]
            for c in range(j):
                for k in range(components):
                    root[i, j, k] -= root[i, c, k] * root[j, c, k]
            if i == j:
                for k in range(components):
                    root[j, j, k] = sqrt(root[j, j, k])
                    by_diagonal[k] = 1.0 / root[j, j, k]
                    product[k] *= root[j, j, k]
            else:
                for k in range(components):
                    root[i, j, k] *= by_diagonal[k]
    for k in range(components):
        logs[k] += log(product[k])


@_kernel
def _precision(root, scratch, out):  # type: ignore[no-untyped-def]
    """Fill the lower halves of (d, d, K): the inverses of what lower factors are of."""
    d, _, components = root.shape
    for j in range(d):  # the transposed inverse of the root
        for k in range(components):
            scratch[j, j, k] = 1.0 / root[j, j, k]
    for j in range(d):
        for i in range(j + 1, d):
            for k in range(components):
                scratch[j, i, k] = 0.0
            for c in range(j, i):
                for k in range(components):
                    scratch[j, i, k] -= root[i, c, k] * scratch[j, c, k]
            for k in range(components):
                scratch[j, i, k] *= scratch[i, i, k]
    for i in range(d):
        for j in range(i, d):
            for k in range(components):
                out[j, i, k] = 0.0
            for c in range(j, d):
                for k in range(components):
                    out[j, i, k] += scratch[i, c, k] * scratch[j, c, k]


@_kernel
def _missed(means, matrix, value, variance, right, square):  # type: ignore[no-untyped-def]
    """Fill (d, K) Hᵀ R⁻¹ (y − H μ), and (K,) the square of what the means miss of the value."""
    d, components = right.shape
    square[:], right[:] = 0.0, 0.0
    for k in range(components):
        for o in range(value.size):
            left = value[o]
            for i in range(d):
                left -= matrix[o, i] * means[k, i]
            square[k] += left * left / variance[o]
            for i in range(d):
                right[i, k] += matrix[o, i] * left / variance[o]


@_kernel
def _move(root, right, square):  # type: ignore[no-untyped-def]
    """Make of (d, K) `right` how far the means move, (LLᵀ)⁻¹ right, and take from (K,) the square
    what that explains."""
    d, components = right.shape
    for i in range(d):
        for c in range(i):
            for k in range(components):
                right[i, k] -= root[i, c, k] * right[c, k]
        for k in range(components):
            right[i, k] /= root[i, i, k]
            square[k] -= right[i, k] * right[i, k]
    for i in range(d - 1, -1, -1):
        for c in range(i + 1, d):
            for k in range(components):
                right[i, k] -= root[c, i, k] * right[c, k]
        for k in range(components):
            right[i, k] /= root[i, i, k]


@_kernel
def _weigh(weights, variance, square, logs, out):  # type: ignore[no-untyped-def]
    """Fill (K,) out with the weights afterwards. Returns the logarithm of the value's density.

    square: (K,) of what the value misses. logs: (K,) logarithms of both factors' determinants.
    """
    noise, largest, total = 0.0, -np.inf, 0.0
    for o in range(variance.size):
        noise += log(6.283185307179586 * variance[o])
    for k in range(weights.size):
        out[k] = -0.5 * (square[k] + noise) - logs[k]
        out[k] += log(weights[k]) if weights[k] > 0.0 else -np.inf
        if not out[k] <= largest:
            largest = out[k]  # of no number, too: that ends in no number
    for k in range(weights.size):
        out[k] = np.exp(out[k] - largest)
        total += out[k]
    for k in range(weights.size):
        out[k] /= total
    return largest + log(total)
