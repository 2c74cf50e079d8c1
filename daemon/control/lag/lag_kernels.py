"""What has arrived of a told motion by many delays at once, compiled: numpy's own overhead would be
most of it.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_kernel = njit(cache=True, error_model="numpy")
"""error_model: a division by zero gives inf or no number, and no exception."""


@_kernel
def arrive(
    times: FloatArray,
    told: FloatArray,
    arrived: FloatArray,
    dead_s: FloatArray,
    first_order_s: FloatArray,
) -> None:
    """Fill the last row of (n, k, 3) `arrived` by k dead times and first-order lags. times: (n,).
    told: (n, 3), evenly between two times."""
    last = times.shape[0] - 1
    passed_s = max(times[last] - times[last - 1], 0.0)
    for k in range(dead_s.shape[0]):
        at_s = times[last] - dead_s[k]
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if times[middle] < at_s:
                low = middle
            else:
                high = middle
        between = min(max((at_s - times[low]) / (times[high] - times[low]), 0.0), 1.0)
        share = -np.expm1(-passed_s / first_order_s[k])
        for i in range(3):
            due = told[low, i] + between * (told[high, i] - told[low, i])
            before = arrived[last - 1, k, i]
            arrived[last, k, i] = before + share * (due - before)


@_kernel
def add_span(
    first: int,
    arrived: FloatArray,
    tips: FloatArray,
    sums: FloatArray,
    gain_sums: FloatArray,
    kept: FloatArray,
    weight: float,
    least_mm: float,
) -> bool:
    """Whether the tip went, or was told to go, `least_mm` from row `first` to the last: then the
    motions' products are added to (3, k, 3) xx, xy and yy and (2, k, 3) xx and xy, of which the
    shares `kept`, (2,), are left."""
    last, delays = tips.shape[0] - 1, arrived.shape[1]
    most = 0.0
    for i in range(3):
        most += (tips[last, i] - tips[first, i]) ** 2
    for k in range(delays):
        far = 0.0
        for i in range(3):
            far += (arrived[last, k, i] - arrived[first, k, i]) ** 2
        most = max(most, far)
    if most < least_mm * least_mm:
        return False
    for k in range(delays):
        for i in range(3):
            x, y = arrived[last, k, i] - arrived[first, k, i], tips[last, i] - tips[first, i]
            sums[0, k, i] = kept[0] * sums[0, k, i] + weight * x * x
            sums[1, k, i] = kept[0] * sums[1, k, i] + weight * x * y
            sums[2, k, i] = kept[0] * sums[2, k, i] + weight * y * y
            gain_sums[0, k, i] = kept[1] * gain_sums[0, k, i] + weight * x * x
            gain_sums[1, k, i] = kept[1] * gain_sums[1, k, i] + weight * x * y
    return True
