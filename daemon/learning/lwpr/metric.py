"""The shape of receptive fields, learnt from the errors that their linear models make. Compiled.

A field's cost is what it would have mispredicted of each sample had it been left out, by weight,
plus a penalty on a narrow field. Its gradient needs what a change of the newest weight does to the
errors of all older samples: the traces H and K of every direction carry that along. Follows
Vijayakumar, D'Souza and Schaal (2005), appendix; outputs that share a field share its cost, which
is the mean of theirs.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
Records = NDArray[np.void]

_LEAST_MEMORY = 0.1
_LARGEST_STEP = 0.1
"""Of the largest element of the root: a longer step is not believed."""
_LARGEST_RATE_STEP = 0.1
_LARGEST_LOG_RATE = 10.0
_LARGEST_LEVERAGE = 0.99
"""One sample may nearly fix a young field's model, but what was left out stays finite."""
_TINY = 1e-10

_FAST = {"contract", "reassoc", "nsz"}
_kernel = njit(cache=True, error_model="numpy", fastmath=_FAST)
_inlined = njit(cache=True, error_model="numpy", fastmath=_FAST, forceinline=True)
"""What is called per output: counting references to its arrays would take as long as its work."""


@_kernel
def adapt(
    x: FloatArray,
    norm_in: FloatArray,
    where: IndexArray,
    period: FloatArray,
    found: int,
    fields: IndexArray,
    weights: FloatArray,
    regressed: IndexArray,
    regressed_period: FloatArray,
    anchor: FloatArray,
    mean: FloatArray,
    along: FloatArray,
    load: FloatArray,
    centres: FloatArray,
    metrics: FloatArray,
    root: FloatArray,
    rate: FloatArray,
    log_rate: FloatArray,
    meta_trace: FloatArray,
    outputs: Records,
    directions: Records,
    errors: FloatArray,
    bisquare: bool,
    penalty: float,
    meta: bool,
    meta_rate: float,
    compat: bool,
) -> None:
    """One step of every field that the sample fell into, after `learn` and before `close`.

    where: (l,) the localisation inputs; regressed: (n,) the regression inputs; period of both:
    normalised, 0 is none. errors: (c, k, 2) as `learn` left them. root, rate, log_rate,
    meta_trace: (c, t); metrics (t, c) follows root.
    """
    size, inputs = where.size, regressed.size
    here, left = np.zeros(along.shape[3]), np.empty(along.shape[3])
    projections = np.empty(along.shape[2])
    diagonal = root.shape[1] == size
    way = np.empty(size)
    m, d, product = np.zeros((size, size)), np.empty((size, size)), np.empty((size, size))
    for a in range(found):
        f, w = fields[a], weights[a]
        first = directions[f, 0, 0]
        if not first.samples * (1.0 - first.forgetting) > _LEAST_MEMORY:
            continue
        for i in range(size):
            at = x[where[i]] / norm_in[where[i]]
            way[i] = at - centres[i, f]
            if period[i] > 0.0:
                way[i] -= period[i] * np.rint(way[i] / period[i])
        for i in range(inputs):
            at = x[regressed[i]] / norm_in[regressed[i]]
            if regressed_period[i] > 0.0:
                turns = np.rint((at - anchor[f, i]) / regressed_period[i])
                at -= turns * regressed_period[i]
            here[i] = at - mean[f, i]
        belief, by_weight, by_weight_twice = _cost_by_weight(
            w, inputs, here, left, outputs[f], directions[f], along[f], load[f], projections,
            errors[f], meta, compat,
        )  # fmt: skip
        w1, w2 = -0.5 * w, 0.25 * w
        if bisquare:
            w1, w2 = -0.5 * np.sqrt(w), 0.125
        pull = belief * 4.0 * penalty / size * w / first.weight
        if diagonal:
            _step_diagonal(
                way, w1, w2, pull, by_weight, by_weight_twice, root[f], rate[f], log_rate[f],
                meta_trace[f], meta, meta_rate, compat,
            )  # fmt: skip
            for i in range(size):
                metrics[i, f] = root[f, i] * root[f, i]
        else:
            _unpack(root[f], m)
            _square(m, d)
            _step_full(
                way, w1, w2, pull, by_weight, by_weight_twice, m, d, product, root[f], rate[f],
                log_rate[f], meta_trace[f], meta, meta_rate, compat,
            )  # fmt: skip
            _unpack(root[f], m)
            _square(m, d)
            k = 0
            for i in range(size):
                for j in range(i, size):
                    metrics[k, f] = d[i, j] if i == j else 2.0 * d[i, j]
                    k += 1


@_inlined
def _cost_by_weight(
    w: float,
    inputs: int,
    here: FloatArray,
    left: FloatArray,
    outputs: Records,
    directions: Records,
    along: FloatArray,
    load: FloatArray,
    projections: FloatArray,
    errors: FloatArray,
    meta: bool,
    compat: bool,
) -> tuple[float, float, float]:
    """First and second derivative of the cost by this sample's weight; then the traces go on.

    Each output has a belief in it, from 0 to 1: little as long as its model still changes so much
    that errors before and after learning differ. Returns the mean belief, and the mean derivatives
    by belief.
    """
    count = outputs.shape[0]
    belief, once, twice = 0.0, 0.0, 0.0
    first = directions[0, 0]
    by_total = 1.0 / first.weight
    for k in range(count):
        rank = outputs[k].rank
        used = 0
        while (
            used < rank and directions[k, used].samples * (1.0 - first.forgetting) > _LEAST_MEMORY
        ):
            used += 1
        mature = rank if directions[k, rank - 1].samples > 2.0 * inputs else rank - 1
        left[:] = here
        after = errors[k, 0] - _project(
            rank, mature, directions[k], along[k], load[k], left, projections
        )
        before, error = errors[k, 1], directions[k, max(mature - 1, 0)].error
        old = directions[k, rank - 1].forgetting * outputs[k].transient
        outputs[k].transient = old + w * after * after
        leverage, with_h, with_k, spread = 0.0, 0.0, 0.0, 0.0
        for r in range(used):
            d, s = directions[k, r], projections[r]
            leverage += w * s * s / d.energy
            with_h += s * after / d.energy * d.trace_h
            with_k += (s / d.energy) ** 2 * d.trace_k
            spread += s * s * after / d.energy
        one = (before * before - error * by_total - 2.0 * with_h - 2.0 * with_k) * by_total
        trust = min(1.0, (outputs[k].transient / (error + _TINY)) ** 4)
        belief += trust
        once += trust * one
        if meta:
            second = 0.0
            for r in range(used):
                d, s = directions[k, r], projections[r]
                second += (s * after * by_total + s * spread) / d.energy * d.trace_h
            second = 4.0 * second + error * by_total * by_total
            second += 2.0 * (after * after * leverage / w - before * before * by_total)
            twice += trust * second * by_total
        if not compat:
            leverage = min(leverage, _LARGEST_LEVERAGE)
        share = trust * w / (1.0 - leverage)
        for r in range(used):
            d, s = directions[k, r], projections[r]
            d.trace_h = d.forgetting * d.trace_h + share * s * before
            d.trace_k = d.forgetting * d.trace_k + share * w * (s * before) ** 2
    return belief / count, once / count, twice / count


@_inlined
def _project(
    rank: int,
    mature: int,
    directions: Records,
    along: FloatArray,
    load: FloatArray,
    left: FloatArray,
    projections: FloatArray,
) -> float:
    """The sample's projections (r,) after learning it, and what the mature ones make of it."""
    value = 0.0
    for r in range(rank):
        s = 0.0
        for i in range(left.size):
            s += along[r, i] * left[i]
        for i in range(left.size):
            left[i] -= load[r, i] * s
        projections[r] = s
        if r < mature:
            value += directions[r].beta * s
    return value


@_kernel
def _step_diagonal(
    way: FloatArray,
    w1: float,
    w2: float,
    pull: float,
    once: float,
    twice: float,
    root: FloatArray,
    rate: FloatArray,
    log_rate: FloatArray,
    meta_trace: FloatArray,
    meta: bool,
    meta_rate: float,
    compat: bool,
) -> None:
    largest = np.abs(root).max()
    for i in range(way.size):
        m, squared = root[i], way[i] * way[i]
        slope = 2.0 * squared * m
        gradient = pull * m * m * m + w1 * slope * once
        if meta:
            second = 3.0 * pull * m * m + (w2 * slope * slope + 2.0 * w1 * squared) * once
            second += (w1 * slope) ** 2 * twice
            _learn_rate(i, gradient, second, rate, log_rate, meta_trace, meta_rate)
        step = rate[i] * gradient
        if _too_long(step, largest, compat):
            _slow_down(i, rate, log_rate, compat)
        else:
            root[i] = m - step


@_kernel
def _step_full(
    way: FloatArray,
    w1: float,
    w2: float,
    pull: float,
    once: float,
    twice: float,
    m: FloatArray,
    d: FloatArray,
    product: FloatArray,
    root: FloatArray,
    rate: FloatArray,
    log_rate: FloatArray,
    meta_trace: FloatArray,
    meta: bool,
    meta_rate: float,
    compat: bool,
) -> None:
    """m (l, l) the root, d = mᵀm, product: room for m d, which is the penalty's gradient."""
    size = way.size
    _multiply_triangle(m, d, product)
    largest = np.abs(root).max()
    k = 0
    for a in range(size):
        reach, length = 0.0, 0.0
        for i in range(a, size):
            reach += m[a, i] * way[i]
            length += m[a, i] * m[a, i]
        for b in range(a, size):
            slope = 2.0 * way[b] * reach
            gradient = pull * product[a, b] + w1 * slope * once
            if meta:
                second = pull * (d[b, b] + length + m[a, b] * m[a, b])
                second += (w2 * slope * slope + 2.0 * w1 * way[b] * way[b]) * once
                second += (w1 * slope) ** 2 * twice
                _learn_rate(k, gradient, second, rate, log_rate, meta_trace, meta_rate)
            step = rate[k] * gradient
            if _too_long(step, largest, compat):
                _slow_down(k, rate, log_rate, compat)
            else:
                root[k] -= step
            k += 1


@_kernel
def _learn_rate(
    i: int,
    gradient: float,
    second: float,
    rate: FloatArray,
    log_rate: FloatArray,
    meta_trace: FloatArray,
    meta_rate: float,
) -> None:
    """Faster where gradients keep their sign (Sutton's incremental delta-bar-delta)."""
    change = meta_rate * gradient * meta_trace[i]
    change = max(-_LARGEST_RATE_STEP, min(_LARGEST_RATE_STEP, change))
    log_rate[i] = max(-_LARGEST_LOG_RATE, min(_LARGEST_LOG_RATE, log_rate[i] - change))
    rate[i] = np.exp(log_rate[i])
    keep = max(0.0, 1.0 - rate[i] * second)
    meta_trace[i] = meta_trace[i] * keep - rate[i] * gradient


@_kernel
def _too_long(step: float, largest: float, compat: bool) -> bool:
    if compat:
        # The reference library lets a field shrink as fast as it likes.
        return step > _LARGEST_STEP * largest
    return not abs(step) <= _LARGEST_STEP * largest


@_kernel
def _slow_down(i: int, rate: FloatArray, log_rate: FloatArray, compat: bool) -> None:
    rate[i] *= 0.5
    if not compat:
        log_rate[i] = np.log(rate[i])


@_kernel
def _unpack(root: FloatArray, m: FloatArray) -> None:
    """The upper triangle; below it m stays zero."""
    k = 0
    for a in range(m.shape[0]):
        for b in range(a, m.shape[0]):
            m[a, b] = root[k]
            k += 1


@_kernel
def _square(m: FloatArray, d: FloatArray) -> None:
    """d = mᵀm of an upper triangular m; of d only the upper triangle."""
    size = m.shape[0]
    d[:] = 0.0
    for a in range(size):
        for i in range(a, size):
            for j in range(i, size):
                d[i, j] += m[a, i] * m[a, j]


@_kernel
def _multiply_triangle(m: FloatArray, d: FloatArray, product: FloatArray) -> None:
    """The upper triangle of m d, of d only the upper triangle."""
    size = m.shape[0]
    for i in range(size):
        for j in range(i):
            d[i, j] = d[j, i]
    product[:] = 0.0
    for a in range(size):
        for i in range(a, size):
            for j in range(a, size):
                product[a, j] += m[a, i] * d[i, j]
