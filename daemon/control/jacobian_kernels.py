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
_HALVINGS: Final = 8
"""To half a hundredth of a haste."""
_WHOLE: Final = 0.98
"""Of a way that counts as gone."""
_ROUNDS: Final = 4
"""Per axis, at most, until it is known which are at their bounds; one or two do."""


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
def _share_within(step: FloatArray, change: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """The largest share, up to 1, of a change that leaves every axis between its bounds."""
    share = 1.0
    for k in range(step.shape[0]):
        if step[k] + change[k] > high[k]:
            share = min(share, (high[k] - step[k]) / change[k])
        elif step[k] + change[k] < low[k]:
            share = min(share, (low[k] - step[k]) / change[k])
    return max(share, 0.0)


@_kernel
def _free_change(hessian: FloatArray, slope: FloatArray, held: FloatArray) -> FloatArray:
    """(m,) the change of the axes that are not held which is lowest: -H⁻¹ g, by Cholesky."""
    count = slope.shape[0]
    a, change = np.zeros((count, count)), np.zeros(count)
    for i in range(count):
        for j in range(i + 1):
            a[i, j] = hessian[i, j] if held[i] == 0.0 and held[j] == 0.0 else 0.0
        if held[i] != 0.0:
            a[i, i] = 1.0
        for j in range(i + 1):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] = np.sqrt(max(a[i, i], _TINY)) if i == j else a[i, j] / a[j, j]
        change[i] = 0.0 if held[i] != 0.0 else -slope[i]
        for k in range(i):
            change[i] -= a[i, k] * change[k]
        change[i] /= a[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            change[i] -= a[k, i] * change[k]
        change[i] /= a[i, i]
    return change


@_kernel
def step_within(
    jacobian: FloatArray, wanted: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> FloatArray:
    """(m,) between bounds, which hold zero between them: the step whose tip comes nearest to where
    that of `wanted`, (m,), would, least |J (x - w)|² + damping² |x - w|².

    By active sets (Nocedal and Wright, Numerical Optimization, 16.5), from `wanted` as a whole
    shortened until it is within: what it ends with is never further off than that.
    """
    rows, count = jacobian.shape
    hessian = np.zeros((count, count))
    for i in range(count):
        hessian[i, i] = damping * damping
        for j in range(count):
            for r in range(rows):
                hessian[i, j] += jacobian[r, i] * jacobian[r, j]
    held, slope = np.zeros(count), np.empty(count)
    step = _share_within(np.zeros(count), wanted, low, high) * wanted
    for _ in range(_ROUNDS * count):
        for i in range(count):
            slope[i] = 0.0
            for j in range(count):
                slope[i] += hessian[i, j] * (step[j] - wanted[j])
        change = _free_change(hessian, slope, held)
        share = _share_within(step, change, low, high)
        for k in range(count):
            step[k] = min(max(step[k] + share * change[k], low[k]), high[k])
        if share < 1.0:
            for k in range(count):
                if change[k] > 0.0 and step[k] >= high[k]:
                    held[k] = 1.0
                elif change[k] < 0.0 and step[k] <= low[k]:
                    held[k] = -1.0
            continue
        worst, most = -1, 0.0
        for i in range(count):
            pull = 0.0
            for j in range(count):
                pull += hessian[i, j] * (step[j] - wanted[j])
            if held[i] * pull > most:  # it would rather come back
                worst, most = i, held[i] * pull
        if worst < 0:
            return step
        held[worst] = 0.0
    return step


@_kernel
def least_hurried_step(
    jacobian: FloatArray,
    wanted: FloatArray,
    bounds: StepBounds,
    fastest: FloatArray,
    damping: float,
) -> FloatArray:
    """(m,) whose tip goes as far along the way of `wanted`, (m,), as that itself but for a
    fiftieth, with the least haste of the axis that has most of it. fastest: (m,) what each may in a
    step. bounds: the step's, whatever the axes' speed; `drawn` is not looked at."""
    rows, count = jacobian.shape
    tip, squared, most = np.zeros(rows), 0.0, 0.0
    for r in range(rows):
        for k in range(count):
            tip[r] += jacobian[r, k] * wanted[k]
        squared += tip[r] * tip[r]
    for k in range(count):
        most = max(most, abs(wanted[k]) / fastest[k])
    step, slow, low, high = wanted.copy(), 0.0, np.empty(count), np.empty(count)
    for _ in range(_HALVINGS):
        haste = 0.5 * (slow + most)
        for k in range(count):
            low[k] = max(bounds.lowest[k], -haste * fastest[k])
            high[k] = min(bounds.highest[k], haste * fastest[k])
        trial, along = step_within(jacobian, wanted, low, high, damping), 0.0
        for r in range(rows):
            for k in range(count):
                along += tip[r] * jacobian[r, k] * trial[k]
        if along >= _WHOLE * squared:
            step, most = trial, haste
        else:
            slow = haste
    return step


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
    """(m,) the bounded step of axes that are measured in `unit`, (m,); where an axis would have to
    be faster than it may be, what comes nearest to it."""
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
    hurried = False
    for k in range(count):
        fastest = max_velocity[k] * dt_s / unit[k]
        hurried = hurried or abs(step[k]) > fastest
        low[k], high[k] = max(low[k], -fastest), min(high[k], fastest)
    if hurried:
        step = step_within(scaled, step, low, high, damping)
    for k in range(count):
        step[k] *= unit[k]
    return step


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
