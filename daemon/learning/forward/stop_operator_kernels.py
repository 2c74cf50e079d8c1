"""Where a body with friction is with its axes as they are, compiled (see `stop_operators`).

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_kernel = njit(cache=True, error_model="numpy")
"""error_model: a division by zero gives inf or no number, and no exception."""

_STEP = 0.05
"""Of the travel, at most, in one solution: the stops change little."""
_CLOSE = 1e-10
"""Of the travel."""
_ITERATIONS = 20


@_kernel
def weight(free: float, stiffening: float) -> float:
    """w; farther than a tenth beyond the travel it changes no more."""
    return float(np.exp(-stiffening * (min(max(free, -0.1), 1.1) - 0.5)))


@_kernel
def follow(
    free: FloatArray,
    stops: FloatArray,
    u: FloatArray,
    share: float,
    reaches: FloatArray,
    together: float,
    stiffening: float,
) -> None:
    """The axes went evenly from where they belonged to (m,) `free` to (m,) `u`: change `free` and
    (n, m) `stops`."""
    m = free.shape[0]
    began = free + share * _held(free, stops, stiffening)
    farthest = 0.0
    for j in range(m):
        farthest = max(farthest, abs(u[j] - began[j]))
    parts = max(1, int(np.ceil(farthest / _STEP)))
    way = np.empty(m)
    for part in range(parts):
        due = began + (part + 1) / parts * (u - began)
        _solve(way, free, stops, due, share, reaches, together, stiffening)
        mean = way.mean()
        for j in range(m):
            stretch = (1.0 - together) * way[j] + together * mean
            for i in range(reaches.shape[0]):
                stops[i, j] = min(max(stops[i, j] + stretch, -reaches[i]), reaches[i])
            free[j] += way[j]


@_kernel
def follow_by_share(
    free: FloatArray,
    stops: FloatArray,
    u: FloatArray,
    shares: FloatArray,
    reaches: FloatArray,
    together: float,
    stiffening: float,
) -> None:
    """The same for each of (k,) `shares`: (k, m) `free` and (k, n, m) `stops`."""
    for number in range(shares.shape[0]):
        follow(free[number], stops[number], u, shares[number], reaches, together, stiffening)


@_kernel
def walk(
    places: FloatArray, share: float, reaches: FloatArray, together: float, stiffening: float
) -> FloatArray:
    """(n, m) free places of axes that go from one of (n, m) to the next."""
    free, out = places[0].copy(), np.empty_like(places)
    stops = np.zeros((reaches.shape[0], places.shape[1]))
    for k in range(places.shape[0]):
        follow(free, stops, places[k], share, reaches, together, stiffening)
        out[k] = free
    return out


@_kernel
def needed(
    free: FloatArray,
    stops: FloatArray,
    forth: FloatArray,
    share: float,
    reaches: FloatArray,
    together: float,
    stiffening: float,
) -> FloatArray:
    """(m, m) motion of the axes for the next one of each free place, the stretches going up as
    surely as (m,) `forth` says, 0 to 1."""
    m, n = free.shape[0], reaches.shape[0]
    out, slack = np.empty((m, m)), 1e-3 * reaches[n - 1]
    for j in range(m):
        sticks = 0.0
        for i in range(n):
            sticks += forth[j] / n * (stops[i, j] < reaches[i] - slack)
            sticks += (1.0 - forth[j]) / n * (stops[i, j] > slack - reaches[i])
        w = share * weight(free[j], stiffening)
        out[j] = w * together / m * sticks
        out[j, j] += 1.0 - w * (stiffening * stops[:, j].mean() - (1.0 - together) * sticks)
    return out


@_kernel
def _held(free: FloatArray, stops: FloatArray, stiffening: float) -> FloatArray:
    """(m,) w S."""
    held = np.empty_like(free)
    for j in range(free.shape[0]):
        held[j] = weight(free[j], stiffening) * stops[:, j].mean()
    return held


@_kernel
def _solve(
    way: FloatArray,
    free: FloatArray,
    stops: FloatArray,
    due: FloatArray,
    share: float,
    reaches: FloatArray,
    together: float,
    stiffening: float,
) -> None:
    """Fill (m,) `way` with what brings `free` to where it belongs with the axes at (m,) `due`, by
    Newton's method: the slopes are D + a 1ᵀ with a diagonal D."""
    m, n = free.shape[0], reaches.shape[0]
    way[:] = 0.0
    once, left = np.empty(m), np.empty(m)
    for _ in range(_ITERATIONS):
        mean, farthest = way.mean(), 0.0
        for j in range(m):
            stretch = (1.0 - together) * way[j] + together * mean
            held, sticks = 0.0, 0.0
            for i in range(n):
                stop = stops[i, j] + stretch
                if abs(stop) < reaches[i]:
                    sticks += 1.0 / n
                held += min(max(stop, -reaches[i]), reaches[i]) / n
            w = share * weight(free[j] + way[j], stiffening)
            off = free[j] + way[j] + w * held - due[j]
            farthest = max(farthest, abs(off))
            slope = 1.0 - w * (stiffening * held - (1.0 - together) * sticks)
            left[j], once[j] = off / slope, w * together / m * sticks / slope
        if farthest < _CLOSE:
            return
        way -= left - once * (left.sum() / (1.0 + once.sum()))
