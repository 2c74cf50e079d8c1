"""The quadratic programme of a horizon, compiled: one small solve for each direction of the axes.

Over n intervals the m axes go v, shares of their range by interval. The tip's coordinates come to
free + A v Sᵀ, with the (n, n) response A of the body to a motion in each interval and the (3, m)
Jacobian S. Least is

    |wanted − A v Sᵀ|² + smooth² |D v − d₀|² + Σ over directions of axes of w² |v − rest|²

with D the changes from interval to interval, the first one from what the axes do now. Within are
how far the axes go in an interval, and their travel at the end of each. In the eigenvectors of SᵀS
the directions fall apart. The bounds, which tie them together, are met by alternating directions
(Boyd et al. 2011; Stellato et al., OSQP, 2020).
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ROUNDS: Final = 80
"""At most. What is beyond the bounds then, who makes the step cuts off."""
_CLOSE: Final = 1e-5
"""In ranges of the axes: closer to the bounds than this is within them."""
_RELAXED: Final = 1.6
"""Over-relaxation, as OSQP has it."""
_NOTHING: Final = 1e-9
"""Of the largest curvature, below which a direction leaves the tip where it is."""
_PENALTY: Final = 0.1
"""Of bounds that are missed, relative to the largest curvature."""

_kernel = njit(cache=True, error_model="numpy")


class Horizon(NamedTuple):
    """What is asked. Axes in shares of their range."""

    response: FloatArray
    """(n, n) A: by how much of it the tip has followed a motion of an interval, at the ends."""
    jacobian: FloatArray
    """(3, m) S: mm by share."""
    wanted: FloatArray
    """(n, 3) mm from where the tip will be anyway."""
    now: FloatArray
    """(m,) what the axes go in an interval, at the speed that they have."""
    rest: FloatArray
    """(m,) what they shall go in an interval where the tip does not mind."""


class Weights(NamedTuple):
    """Prices, mm by share."""

    smooth: float
    """Of a change of what the axes go in an interval."""
    effort: float
    """Of going at all, where it moves the tip ..."""
    rest: float
    """... and of going otherwise than `rest`, where it does not."""


class Bounds(NamedTuple):
    """(m,) each, in shares."""

    fastest: FloatArray
    """In an interval."""
    lowest: FloatArray
    """At the end of an interval, from where the axes are."""
    highest: FloatArray


@_kernel
def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Of matrices so small that a library's own overhead would be most of it."""
    found = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                found[i, j] += a[i, k] * b[k, j]
    return found


@_kernel
def _turned_over(a: FloatArray) -> FloatArray:
    """Its transpose, in rows."""
    found = np.empty((a.shape[1], a.shape[0]))
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            found[j, i] = a[i, j]
    return found


@_kernel
def _decomposed(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (m,), smallest first, and eigenvectors in the columns of (m, m), of SᵀS."""
    values, vectors = np.linalg.eigh(_dot(_turned_over(jacobian), jacobian))
    return values, np.ascontiguousarray(vectors)


@_kernel
def _inverses(
    values: FloatArray, free: FloatArray, horizon: Horizon, weights: Weights, penalty: float
) -> FloatArray:
    """(m, n, n): of the curvature along each direction."""
    curvature = _dot(_turned_over(horizon.response), horizon.response)
    n, count = curvature.shape[0], values.shape[0]
    found = np.empty((count, n, n))
    for j in range(count):
        if j > 0 and free[j] > 0.0 and free[j - 1] > 0.0:
            found[j] = found[j - 1]
            continue
        a = max(values[j], 0.0) * curvature
        price = weights.rest if free[j] > 0.0 else weights.effort
        for i in range(n):
            a[i, i] += price * price + penalty
            a[i, i] += weights.smooth**2 * (2.0 if i + 1 < n else 1.0)
            if i + 1 < n:
                a[i, i + 1] -= weights.smooth**2
                a[i + 1, i] -= weights.smooth**2
            for k in range(n):
                a[i, k] += penalty * (n - max(i, k))  # sums up to the end of each interval
        found[j] = np.linalg.inv(a)
    return found


@_kernel
def _pull(vectors: FloatArray, free: FloatArray, horizon: Horizon, weights: Weights) -> FloatArray:
    """(n, m) along the axes' directions: minus the slope where nothing moves."""
    pull = _dot(_dot(_turned_over(horizon.response), horizon.wanted), horizon.jacobian)
    for k in range(pull.shape[1]):
        pull[0, k] += weights.smooth**2 * horizon.now[k]
    turned = _dot(pull, vectors)
    for j in range(free.shape[0]):
        if free[j] > 0.0:
            rest = 0.0
            for k in range(free.shape[0]):
                rest += horizon.rest[k] * vectors[k, j]
            for i in range(turned.shape[0]):
                turned[i, j] += weights.rest**2 * rest
    return turned


@_kernel
def _solved(inverses: FloatArray, turned: FloatArray, vectors: FloatArray) -> FloatArray:
    """(n, m) of the axes, for (n, m) in their directions."""
    found = np.empty_like(turned)
    n = turned.shape[0]
    for j in range(inverses.shape[0]):
        for i in range(n):
            total = 0.0
            for k in range(n):
                total += inverses[j, i, k] * turned[k, j]
            found[i, j] = total
    return _dot(found, _turned_over(vectors))


@_kernel
def _places(v: FloatArray) -> FloatArray:
    """(n, m) where the axes are at the ends of the intervals."""
    places = v.copy()
    for i in range(1, v.shape[0]):
        places[i] += places[i - 1]
    return places


@_kernel
def _sums_from(places: FloatArray) -> FloatArray:
    """(n, m) what a slope at the ends is for what is gone in each interval."""
    sums = places.copy()
    for i in range(places.shape[0] - 2, -1, -1):
        sums[i] += sums[i + 1]
    return sums


@_kernel
def _missed(v: FloatArray, bounds: Bounds) -> float:
    """By how much the worst bound is passed."""
    worst = 0.0
    places = _places(v)
    for i in range(v.shape[0]):
        for k in range(v.shape[1]):
            worst = max(worst, abs(v[i, k]) - bounds.fastest[k])
            worst = max(worst, bounds.lowest[k] - places[i, k])
            worst = max(worst, places[i, k] - bounds.highest[k])
    return worst


@_kernel
def _kept(wanted: FloatArray, lowest: FloatArray, highest: FloatArray) -> FloatArray:
    """(n, m) the nearest within (m,) bounds."""
    kept = np.empty_like(wanted)
    for i in range(wanted.shape[0]):
        for k in range(wanted.shape[1]):
            kept[i, k] = min(max(wanted[i, k], lowest[k]), highest[k])
    return kept


@_kernel
def best_motion(
    horizon: Horizon, weights: Weights, bounds: Bounds, prices: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, m) v, and (2, n, m) prices of the bounds, which the next step begins with."""
    values, vectors = _decomposed(horizon.jacobian)
    largest = max(values[-1], 1e-9)
    free = np.zeros(values.shape[0])
    for j in range(values.shape[0]):
        if values[j] < _NOTHING * largest:
            free[j] = 1.0
    turned = _pull(vectors, free, horizon, weights)
    v = _solved(_inverses(values, free, horizon, weights, 0.0), turned, vectors)
    if not _missed(v, bounds) > _CLOSE:
        return v, np.zeros_like(prices)
    penalty = _PENALTY * largest
    inverses = _inverses(values, free, horizon, weights, penalty)
    slowest = -bounds.fastest
    step_price, place_price = prices[0].copy(), prices[1].copy()
    steps = _kept(v, slowest, bounds.fastest)
    places = _kept(_places(v), bounds.lowest, bounds.highest)
    for _ in range(_ROUNDS):
        last = v
        back = steps - step_price + _sums_from(places - place_price)
        v = _solved(inverses, turned + penalty * _dot(back, vectors), vectors)
        near = _RELAXED * v + (1.0 - _RELAXED) * steps + step_price
        steps = _kept(near, slowest, bounds.fastest)
        step_price = near - steps
        near = _RELAXED * _places(v) + (1.0 - _RELAXED) * places + place_price
        places = _kept(near, bounds.lowest, bounds.highest)
        place_price = near - places
        if not _missed(v, bounds) > _CLOSE and np.abs(v - last).max() < _CLOSE:
            break
    kept = np.empty_like(prices)
    kept[0], kept[1] = step_price, place_price
    return v, kept
