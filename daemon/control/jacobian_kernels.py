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
_LACKING: Final = 1e-3
"""Of a wanted motion, squared: where more of it is left undone, axes may be held in vain."""
_RELEASE: Final = 0.25
"""Of the damping, where axes are let go again: with all of it they would come too slowly."""
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
    """(m,) as `redundancy.damped_solution` says. jacobian: (r, m). wanted: (r,)."""
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
def _hessian(jacobian: FloatArray, damping: float) -> FloatArray:
    """(m, m) JᵀJ + damping² I"""
    rows, count = jacobian.shape
    hessian = np.zeros((count, count))
    for i in range(count):
        hessian[i, i] = damping * damping
        for j in range(count):
            for r in range(rows):
                hessian[i, j] += jacobian[r, i] * jacobian[r, j]
    return hessian


@_kernel
def _least_within(
    hessian: FloatArray, pull: FloatArray, begin: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """(m,) x between bounds, least ½ xᵀ H x - pullᵀ x, from `begin`, which is between them.

    By active sets (Nocedal and Wright, Numerical Optimization, 16.5): what it ends with is never
    worse than what it began with.
    """
    count = pull.shape[0]
    held, slope, step = np.zeros(count), np.empty(count), begin.copy()
    for _ in range(_ROUNDS * count):
        _slope(hessian, pull, step, slope)
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
        _slope(hessian, pull, step, slope)
        worst, most = -1, 0.0
        for i in range(count):
            if held[i] * slope[i] > most:  # it would rather come back
                worst, most = i, held[i] * slope[i]
        if worst < 0:
            return step
        held[worst] = 0.0
    return step


@_kernel
def _slope(hessian: FloatArray, pull: FloatArray, step: FloatArray, slope: FloatArray) -> None:
    """H x - pull, into `slope`."""
    count = pull.shape[0]
    for i in range(count):
        slope[i] = -pull[i]
        for j in range(count):
            slope[i] += hessian[i, j] * step[j]


@_kernel
def step_within(
    jacobian: FloatArray, wanted: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> FloatArray:
    """(m,) between bounds: the step whose tip comes nearest to where that of `wanted`, (m,), would,
    least |J (x - w)|² + damping² |x - w|².

    From `wanted` as a whole shortened until it is within: it is never further off than that, if
    bounds hold zero between them. Else each axis begins from its bound that is nearest.
    """
    count = jacobian.shape[1]
    hessian, pull = _hessian(jacobian, damping), np.zeros(count)
    for i in range(count):
        for j in range(count):
            pull[i] += hessian[i, j] * wanted[j]
    step = _share_within(np.zeros(count), wanted, low, high) * wanted
    for k in range(count):
        step[k] = min(max(step[k], low[k]), high[k])
    return _least_within(hessian, pull, step, low, high)


@_kernel
def _held_step(
    jacobian: FloatArray,
    wanted: FloatArray,
    drawn: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    damping: float,
) -> tuple[FloatArray, bool]:
    """(m,) x with J x ≈ `wanted`, otherwise near `drawn`. An axis that would pass a bound is set to
    it, the worst one first, and the rest is solved again without it. And whether one was."""
    count = jacobian.shape[1]
    lowest, highest = bounds
    free, held = jacobian.copy(), np.zeros(count, dtype=np.bool_)
    step, some_held = drawn.copy(), False
    for _ in range(count):
        missing = wanted - _made(jacobian, step)
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
            return step + answer, some_held
        step[worst] = min(max(drawn[worst] + answer[worst], lowest[worst]), highest[worst])
        held[worst] = some_held = True
        free[:, worst] = 0.0
    return step, some_held


@_kernel
def _made(jacobian: FloatArray, step: FloatArray) -> FloatArray:
    """(r,) J x. For matrices this small a loop is quicker than BLAS."""
    rows, count = jacobian.shape
    made = np.zeros(rows)
    for i in range(rows):
        for k in range(count):
            made[i] += jacobian[i, k] * step[k]
    return made


@_kernel
def _squared(vector: FloatArray) -> float:
    total = 0.0
    for value in vector:
        total += value * value
    return total


@_kernel
def bounded_step(
    jacobian: FloatArray,
    wanted: FloatArray,
    drawn: FloatArray,
    lowest: FloatArray,
    highest: FloatArray,
    damping: float,
    lets_go: bool,
) -> FloatArray:
    """(m,) as `redundancy.bounded_step` says."""
    rows, count = jacobian.shape
    step, some_held = _held_step(jacobian, wanted, drawn, (lowest, highest), damping)
    if not (some_held and lets_go):
        return step
    # What would be made without bounds: a direction that all axes hardly move stays given up.
    missing = wanted - _made(jacobian, drawn)
    whole = _made(jacobian, drawn + damped_solution(jacobian, missing, damping))
    lacking = _squared(whole - _made(jacobian, step))
    if lacking <= _LACKING * _squared(whole):
        return step
    # Each axis was set to its bound for what the others were to do then. With most of them there,
    # the rest can do little, however far those that were first would now go back.
    little = _RELEASE * damping
    pull = little * little * drawn
    for k in range(count):
        for i in range(rows):
            pull[k] += jacobian[i, k] * whole[i]
    released = _least_within(_hessian(jacobian, little), pull, step, lowest, highest)
    return released if _squared(whole - _made(jacobian, released)) < lacking else step


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
    lets_go: bool,
) -> tuple[FloatArray, FloatArray]:
    """(m,) the bounded step of axes that are measured in `unit`, (m,); where an axis would have to
    be faster than it may be, what comes nearest to it. And (r,) what would have come of it if none
    were too slow for it."""
    drawn, lowest, highest = bounds
    rows, count = jacobian.shape
    scaled, toward = np.empty((rows, count)), np.empty(count)
    low, high = np.empty(count), np.empty(count)
    for k in range(count):
        for i in range(rows):
            scaled[i, k] = jacobian[i, k] * unit[k]
        toward[k] = drawn[k] / unit[k]
        low[k], high[k] = lowest[k] / unit[k], highest[k] / unit[k]
    step = bounded_step(scaled, wanted, toward, low, high, damping, lets_go)
    made, hurried = _made(scaled, step), False
    for k in range(count):
        fastest = max_velocity[k] * dt_s / unit[k]
        hurried = hurried or abs(step[k]) > fastest
        low[k], high[k] = max(low[k], -fastest), min(high[k], fastest)
    if hurried:
        step = step_within(scaled, step, low, high, damping)
    for k in range(count):
        step[k] *= unit[k]
    return step, made


@_kernel
def kept_within(
    step: FloatArray, lowest: FloatArray, highest: FloatArray, fastest: FloatArray
) -> FloatArray:
    """(m,) a step that goes no further than (m,) bounds, and with no axis further than (m,)
    `fastest`; of no number, no number."""
    out = step.copy()
    for k in range(step.shape[0]):
        if not np.isnan(step[k]):
            out[k] = min(max(step[k], lowest[k]), highest[k])
            out[k] = min(max(out[k], -fastest[k]), fastest[k])
    return out


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
