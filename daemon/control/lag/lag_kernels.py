"""What has arrived of a told motion by many delays at once, and what small matrices and plays
tell of how a tip answers, compiled: numpy's own overhead would be most of it.

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
    told: (n, 3), evenly between two times, of which a first-order lag is behind by its time."""
    last = times.shape[0] - 1
    passed_s = max(times[last] - times[last - 1], 1e-9)
    for k in range(dead_s.shape[0]):
        at_s, before_s = times[last] - dead_s[k], times[last - 1] - dead_s[k]
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if times[middle] < at_s:
                low = middle
            else:
                high = middle
        then = low
        while then > 0 and times[then] > before_s:
            then -= 1
        between = min(max((at_s - times[low]) / (times[low + 1] - times[low]), 0.0), 1.0)
        between_then = min(
            max((before_s - times[then]) / (times[then + 1] - times[then]), 0.0), 1.0
        )
        kept = np.exp(-passed_s / first_order_s[k])
        for i in range(3):
            due = told[low, i] + between * (told[low + 1, i] - told[low, i])
            due_then = told[then, i] + between_then * (told[then + 1, i] - told[then, i])
            behind = first_order_s[k] / passed_s * (due - due_then)
            over = arrived[last - 1, k, i] - due_then + behind
            arrived[last, k, i] = due - behind + kept * over


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


@_kernel
def gains(
    delays: FloatArray, lag_s: float, gain_sums: FloatArray, one_mm2: float, alike: float
) -> FloatArray:
    """(3,) gains that explain (2, k, 3) xx and xy best of the one of (k,) delays that is nearest to
    the lag: as much motion as `one_mm2` has a gain of 1, and a share `alike` of all motion has the
    gain of all of it."""
    here = 0
    for k in range(delays.shape[0]):
        if abs(delays[k] - lag_s) < abs(delays[here] - lag_s):
            here = k
    xx, xy = gain_sums[0, here], gain_sums[1, here]
    told, came = xx[0] + xx[1] + xx[2], xy[0] + xy[1] + xy[2]
    whole, weight = (came + one_mm2) / (told + one_mm2), one_mm2 + alike * told
    out = np.empty(3)
    for i in range(3):
        out[i] = (xy[i] + weight * whole) / (xx[i] + weight)
    return out


@_kernel
def add_answer(
    told: FloatArray,
    made: FloatArray,
    kept: float,
    due: FloatArray,
    came: FloatArray,
    prior: FloatArray,
) -> FloatArray:
    """(3, 3) matrix that explains best that (3,) `came` of (3,) `due`, and those before: of their
    sums, (3, 3) `told` and `made`, the share `kept` is left. prior: (3, 3) that is taken for seen.
    """
    for i in range(3):
        for j in range(3):
            told[i, j] = kept * told[i, j] + due[i] * due[j]
            made[i, j] = kept * made[i, j] + came[i] * due[j]
    inverse = np.ascontiguousarray(_solved(told + prior, np.eye(3)))
    return np.asarray(np.dot(made + prior, inverse))


@_kernel
def add_foretold(
    foretold: FloatArray,
    kept: float,
    weight: float,
    matrix: FloatArray,
    due: FloatArray,
    came: FloatArray,
) -> None:
    """What (3, 3) `matrix` said of a motion, of which (3,) `came` where (3,) were `due`, goes into
    (4,) `foretold`, of which the share `kept` is left."""
    said, lacked = np.dot(matrix - np.eye(3), due), came - due
    foretold[0] = kept * foretold[0] + weight * np.dot(said, lacked)
    foretold[1] = kept * foretold[1] + weight * np.dot(said, said)
    foretold[2] = kept * foretold[2] + weight * np.dot(lacked, lacked)
    foretold[3] = kept * foretold[3] + weight * 3.0


@_kernel
def to_tell(
    answer: FloatArray, times: FloatArray, loaded: FloatArray, wanted: FloatArray
) -> FloatArray:
    """(3,) motion to be told for (3,) `wanted`, of a tip that goes on as (3, 3) `answer` has it, by
    (3,) `times` along each axis of space, and with a load by (3, 3) `loaded`."""
    return _solved(np.dot(answer * times, loaded), wanted)


@_kernel
def within_play(
    within: FloatArray, moved: FloatArray, reach: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(m,) how far axes are ahead of what they move that were so, (m,) `within`, and go (m,)
    `moved` further, in plays of (m,) `reach`; and how much farther they are than they were."""
    now, farther = np.empty_like(within), np.empty_like(within)
    for j in range(within.shape[0]):
        now[j] = min(max(within[j] + moved[j], -reach[j]), reach[j])
        farther[j] = now[j] - within[j]
    return now, farther


@_kernel
def with_play(
    step: FloatArray, within: FloatArray, reach: FloatArray, taken_up: float
) -> FloatArray:
    """(m,) a step, and what of it is lost in plays of (m,) `reach` for axes that are (m,) `within`
    them: no more at once than `taken_up` times the step."""
    out = np.empty_like(step)
    for j in range(step.shape[0]):
        left = reach[j] - within[j] if step[j] > 0.0 else reach[j] + within[j]
        out[j] = step[j] + np.sign(step[j]) * min(left, taken_up * abs(step[j]))
    return out


@_kernel
def turned(forth: FloatArray, stretch: FloatArray, share: float, least: float) -> FloatArray:
    """(m,) how surely axes go up, 0 to 1, that were told (m,) `stretch`: a share nearer to 1, or to
    0 where it leads down. Less than `least` is none."""
    out = forth.copy()
    for j in range(forth.shape[0]):
        if abs(stretch[j]) > least:
            out[j] += share * ((1.0 if stretch[j] > 0.0 else 0.0) - forth[j])
    return out


@_kernel
def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """What (3, 3) `matrix` makes `right` of; of what is no number, no numbers."""
    if not np.isfinite(matrix).all():
        return np.full_like(right, np.nan)
    return np.asarray(np.linalg.solve(matrix, right))
