"""A mixture of normal distributions after a linear observation, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

K components over d coefficients, q observed numbers. All that is needed comes from two Cholesky
factors of each component, that of its covariance and that of its precision afterwards.
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
    seen = variance.size
    root, inverse = np.empty((d, d)), np.zeros((d, d))
    before, told = np.empty((d, d)), np.empty((d, d))
    left, right = np.empty(seen), np.empty(d)
    likelihoods = np.empty(components)
    noise = 0.0
    for o in range(seen):
        noise += log(6.283185307179586 * variance[o])
    _told(matrix, variance, told)
    largest = -np.inf
    for k in range(components):
        _invert_upper(factors[k], inverse)
        for i in range(d):
            for j in range(i, d):
                entry = beside[i, j]
                for c in range(j, d):
                    entry += inverse[i, c] * inverse[j, c]
                before[i, j] = before[j, i] = entry
        log_before = _cholesky(before, root)
        _precision(root, inverse, before)
        square = 0.0
        right[:] = 0.0
        for o in range(seen):
            left[o] = value[o]
            for i in range(d):
                left[o] -= matrix[o, i] * means[k, i]
            square += left[o] * left[o] / variance[o]
            for i in range(d):
                right[i] += matrix[o, i] * left[o] / variance[o]
        for i in range(d):
            for j in range(d):
                before[i, j] += told[i, j]
        log_after = _cholesky(before, root)
        for i in range(d):
            for c in range(i):
                right[i] -= root[i, c] * right[c]
            right[i] /= root[i, i]
            square -= right[i] * right[i]
        for i in range(d - 1, -1, -1):
            for c in range(i + 1, d):
                right[i] -= root[c, i] * right[c]
            right[i] /= root[i, i]
        for i in range(d):
            out_means[k, i] = means[k, i] + right[i]
            for j in range(d):
                out_factors[k, i, j] = root[j, i] if j >= i else 0.0
        likelihoods[k] = -0.5 * (square + noise) - log_before - log_after
        likelihoods[k] += log(weights[k]) if weights[k] > 0.0 else -np.inf
        if not likelihoods[k] <= largest:
            largest = likelihoods[k]  # of no number, too: that ends in no number
    total = 0.0
    for k in range(components):
        out_weights[k] = np.exp(likelihoods[k] - largest)
        total += out_weights[k]
    for k in range(components):
        out_weights[k] /= total
    return largest + log(total)


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
def _told(matrix, variance, told):  # type: ignore[no-untyped-def]
    """Fill (d, d) with the precision that the observation adds."""
    d = matrix.shape[1]
    for i in range(d):
        for j in range(d):
            entry = 0.0
            for o in range(variance.size):
                entry += matrix[o, i] * matrix[o, j] / variance[o]
            told[i, j] = entry


@_kernel
def _invert_upper(factor, out):  # type: ignore[no-untyped-def]
    """Fill the upper half of (d, d) with the inverse of an upper factor."""
    d = factor.shape[0]
    for j in range(d):
        out[j, j] = 1.0 / factor[j, j]
        for i in range(j - 1, -1, -1):
            entry = 0.0
            for c in range(i + 1, j + 1):
                entry -= factor[i, c] * out[c, j]
            out[i, j] = entry / factor[i, i]


@_kernel
def _cholesky(symmetric, root):  # type: ignore[no-untyped-def]
    """Fill the lower half of (d, d) with its factor. Returns the logarithm of the product of its
    diagonal; not finite where there is none."""
    d = symmetric.shape[0]
    found = 0.0
    for j in range(d):
        for i in range(j, d):
            entry = symmetric[i, j]
            for c in range(j):
                entry -= root[i, c] * root[j, c]
            if i == j:
                root[j, j] = sqrt(entry)
                found += log(root[j, j])
            else:
                root[i, j] = entry / root[j, j]
    return found


@_kernel
def _precision(root, scratch, out):  # type: ignore[no-untyped-def]
    """Fill (d, d): the inverse of what a lower factor is of. Spoils the scratch's upper half."""
    d = root.shape[0]
    for j in range(d):  # the transposed inverse of the root
        scratch[j, j] = 1.0 / root[j, j]
        for i in range(j + 1, d):
            entry = 0.0
            for c in range(j, i):
                entry -= root[i, c] * scratch[j, c]
            scratch[j, i] = entry / root[i, i]
    for i in range(d):
        for j in range(i, d):
            entry = 0.0
            for c in range(j, d):
                entry += scratch[i, c] * scratch[j, c]
            out[i, j] = out[j, i] = entry
