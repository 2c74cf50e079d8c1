"""Jacobians with a few rows, compiled: damped least squares, and what a motion tells about them. Of
numpy's time for a step on matrices this small, nine tenths are its own overhead.

A row is a coordinate of the tip's task: three of its position, or six where it points as well.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_TINY: Final = 1e-12
_SWEEPS: Final = 20
"""At most; each one about squares what is left beside the diagonal, and five or six do."""


def in_rows(array: ArrayLike) -> FloatArray:
    """The kernels are compiled for one type of number and one layout of memory."""
    return np.ascontiguousarray(array, dtype=np.float64)


class StepBounds(NamedTuple):
    """Of m axes in their own units: the step that the rest is drawn to, the lowest, the highest."""

    drawn: FloatArray
    lowest: FloatArray
    highest: FloatArray


_kernel = njit(cache=True, error_model="numpy")
"""error_model: a division by zero gives inf or no number, and no exception."""


@_kernel
def _turn(a: FloatArray, v: FloatArray, p: int, q: int) -> None:
    """A rotation in the plane of p and q that leaves nothing in a[p, q] (Jacobi); v follows."""
    if a[p, q] == 0.0:
        return
    theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
    t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    for k in range(a.shape[0]):
        left, right = a[k, p], a[k, q]
        a[k, p], a[k, q] = c * left - s * right, s * left + c * right
    for k in range(a.shape[0]):
        left, right = a[p, k], a[q, k]
        a[p, k], a[q, k] = c * left - s * right, s * left + c * right
    for k in range(a.shape[0]):
        left, right = v[k, p], v[k, q]
        v[k, p], v[k, q] = c * left - s * right, s * left + c * right
    a[p, q] = a[q, p] = 0.0


@_kernel
def _eigen(a: FloatArray, v: FloatArray) -> None:
    """Eigenvalues of a symmetric (r, r) onto its diagonal, eigenvectors into the columns of v."""
    rows = a.shape[0]
    for i in range(rows):
        for j in range(rows):
            v[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        beside = along = 0.0
        for p in range(rows):
            along += abs(a[p, p])
            for q in range(p + 1, rows):
                beside += abs(a[p, q])
        if not beside > 1e-17 * along:
            return
        for p in range(rows):
            for q in range(p + 1, rows):
                _turn(a, v, p, q)


@_kernel
def damped_solution(jacobian: FloatArray, wanted: FloatArray, damping: float) -> FloatArray:
    """(m,) as `tip_following.damped_solution` says. jacobian: (r, m). wanted: (r,)."""
    rows, count = jacobian.shape
    a, v, pull = np.zeros((rows, rows)), np.empty((rows, rows)), np.zeros(rows)
    for i in range(rows):
        for j in range(rows):
            for k in range(count):
                a[i, j] += jacobian[i, k] * jacobian[j, k]
    _eigen(a, v)
    for i in range(rows):
        squared = max(a[i, i], 0.0)
        short = max(1.0 - np.sqrt(squared) / damping, 0.0) * damping
        along = 0.0
        for j in range(rows):
            along += v[j, i] * wanted[j]
        share = along / (squared + short * short + _TINY)
        for j in range(rows):
            pull[j] += share * v[j, i]
    x = np.zeros(count)
    for k in range(count):
        for j in range(rows):
            x[k] += jacobian[j, k] * pull[j]
    return x


@_kernel
def bounded_step(
    jacobian: FloatArray,
    wanted: FloatArray,
    drawn: FloatArray,
    lowest: FloatArray,
    highest: FloatArray,
    damping: float,
) -> FloatArray:
    """(m,) as `tip_following.bounded_step` says."""
    rows, count = jacobian.shape
    free, held = jacobian.copy(), np.zeros(count, dtype=np.bool_)
    step = drawn.copy()
    for _ in range(count):
        missing = wanted.copy()
        for i in range(rows):
            for k in range(count):
                missing[i] -= jacobian[i, k] * step[k]
        # An axis that is held has no column: nothing is asked of it.
        answer = damped_solution(free, missing, damping)
        worst, most = -1, 0.0
        for k in range(count):
            if not held[k]:
                trial = drawn[k] + answer[k]
                beyond = max(lowest[k] - trial, trial - highest[k])
                if beyond > most:
                    worst, most = k, beyond
        if worst < 0:
            for k in range(count):
                step[k] += answer[k]
            return step
        step[worst] = min(max(drawn[worst] + answer[worst], lowest[worst]), highest[worst])
        held[worst] = True
        for i in range(rows):
            free[i, worst] = 0.0
    return step


@_kernel
def slowed(step: FloatArray, max_velocity: FloatArray, dt_s: float) -> FloatArray:
    """(m,) the step, as a whole shortened until no axis is faster than it may be."""
    fastest = 0.0
    for k in range(step.shape[0]):
        fastest = max(fastest, abs(step[k]) / max_velocity[k])
    share = 1.0 if fastest <= dt_s else dt_s / fastest
    out = np.empty(step.shape[0])
    for k in range(step.shape[0]):
        out[k] = share * step[k]
    return out


@_kernel
def axis_step(
    jacobian: FloatArray,
    wanted: FloatArray,
    bounds: StepBounds,
    unit: FloatArray,
    max_velocity: FloatArray,
    dt_s: float,
    damping: float,
) -> FloatArray:
    """(m,) the bounded step of axes that are measured in `unit`, (m,), then slowed down."""
    drawn, lowest, highest = bounds
    rows, count = jacobian.shape
    scaled, toward = np.empty((rows, count)), np.empty(count)
    low, high = np.empty(count), np.empty(count)
    for k in range(count):
        for i in range(rows):
            scaled[i, k] = jacobian[i, k] * unit[k]
        toward[k] = drawn[k] / unit[k]
        low[k], high[k] = lowest[k] / unit[k], highest[k] / unit[k]
    step = bounded_step(scaled, wanted, toward, low, high, damping)
    for k in range(count):
        step[k] *= unit[k]
    return slowed(step, max_velocity, dt_s)


@_kernel
def condition(jacobian: FloatArray, rank: int) -> float:
    """Largest singular value by that of number `rank`; infinite, or no number, where that is 0."""
    rows = jacobian.shape[0]
    a, v = np.zeros((rows, rows)), np.empty((rows, rows))
    for i in range(rows):
        for j in range(rows):
            for k in range(jacobian.shape[1]):
                a[i, j] += jacobian[i, k] * jacobian[j, k]
    _eigen(a, v)
    values = np.sort(np.diag(a))
    return float(np.sqrt(values[-1] / values[rows - rank]))


@_kernel
def corrected(
    jacobian: FloatArray,
    covariance: FloatArray,
    moved: FloatArray,
    tip_moved: FloatArray,
    drift_variance: float,
    largest_variance: float,
    noise_variance: float,
    relative_noise_variance: float,
) -> tuple[FloatArray, FloatArray]:
    """Jacobian (r, m) and covariance (m, m) after a motion, as `jacobian_estimate` says."""
    rows, count = jacobian.shape
    travelled = 0.0
    for k in range(count):
        travelled += moved[k] * moved[k]
    grown, most = covariance.copy(), 0.0
    for k in range(count):
        grown[k, k] += drift_variance * np.sqrt(travelled)
        most = max(most, grown[k, k])
    share = min(1.0, largest_variance / most)
    along, explained = np.zeros(count), 0.0
    for i in range(count):
        for j in range(count):
            grown[i, j] *= share
            along[i] += grown[i, j] * moved[j]
        explained += moved[i] * along[i]
    squared = 0.0
    for i in range(rows):
        squared += tip_moved[i] ** 2
    noise = noise_variance + relative_noise_variance * squared
    better = jacobian.copy()
    for i in range(rows):
        missing = tip_moved[i]
        for k in range(count):
            missing -= jacobian[i, k] * moved[k]
        for k in range(count):
            better[i, k] += missing * along[k] / (explained + noise)
    for i in range(count):
        for j in range(count):
            grown[i, j] -= along[i] * along[j] / (explained + noise)
    return better, grown
