"""The small linear algebra of shooting, compiled: numpy's own overhead would be half of a step."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_kernel = njit(cache=True, error_model="numpy")


@_kernel
def newton_step(
    response: FloatArray, by_length: FloatArray, by_pull: FloatArray, residual: FloatArray
) -> FloatArray:
    """Newton's step for (base moment, pulls). Not finite where the Jacobian is singular.

    The residual is the tip's moment (3,) and the drives' imbalance (m,); response (3+m, 3+m) gives
    tip moment and lengths by the unknowns, by_length and by_pull (m, m) the imbalance by these.
    """
    size, first = residual.shape[0], residual.shape[0] - by_pull.shape[0]
    a, x = np.empty((size, size)), -residual
    for i in range(first):
        for j in range(size):
            a[i, j] = response[i, j]
    for i in range(size - first):
        for j in range(size):
            a[first + i, j] = by_pull[i, j - first] if j >= first else 0.0
        for k in range(size - first):
            share = by_length[i, k]
            if share != 0.0:
                for j in range(size):
                    a[first + i, j] += share * response[first + k, j]
    for c in range(size):
        pivot = c
        for i in range(c + 1, size):
            if abs(a[i, c]) > abs(a[pivot, c]):
                pivot = i
        for j in range(c, size):
            a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
        x[c], x[pivot] = x[pivot], x[c]
        for i in range(c + 1, size):
            factor = a[i, c] / a[c, c]
            for j in range(c + 1, size):
                a[i, j] -= factor * a[c, j]
            x[i] -= factor * x[c]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]
    return x


@_kernel
def broyden(
    response: FloatArray, step: FloatArray, change: FloatArray, scale: FloatArray
) -> FloatArray:
    """`response` with the least change, in scaled unknowns, that explains what `step` changed."""
    size = step.shape[0]
    norm = 0.0
    for j in range(size):
        norm += (scale[j] * step[j]) ** 2
    out = np.empty((size, size))
    for i in range(size):
        missing = change[i]
        for j in range(size):
            missing -= response[i, j] * step[j]
        for j in range(size):
            out[i, j] = response[i, j] + missing * scale[j] * scale[j] * step[j] / norm
    return out
