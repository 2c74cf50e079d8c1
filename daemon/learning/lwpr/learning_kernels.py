"""One sample learnt by all receptive fields that it falls into: models, then shapes. Compiled.

Every output of a field is regressed on a few directions found one after the other: each is where
the inputs that are left vary with the output that is left (partial least squares). Vijayakumar,
D'Souza and Schaal (2005), table 1, with every sum forgetting.

A field's shape is learnt from the errors that its linear models make. Its cost is what it would
have mispredicted of each sample had it been left out, by weight, plus a penalty on a narrow field.
The gradient needs what a change of the newest weight does to the errors of all older samples: the
traces H and K of every direction carry that along. Follows the appendix of that paper; outputs that
share a field share its cost, which is the mean of theirs.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
Records = NDArray[np.void]
Record = Any
"""One of them: its fields are attributes in compiled code."""

_LEAST_COVARIANCE = 1e-24
_LEAST_ENERGY = 1e-200
"""A field that sees the same point for ever forgets what varied, and must not divide by it."""
_LEAST_MEMORY = 0.1
"""How much of its memory a field has filled before its errors are believed."""
_MASS_OF_NOTHING = 1e-10

_LARGEST_STEP = 0.1
"""Of the largest element of the root: a longer step is not believed."""
_LARGEST_RATE_STEP = 0.1
_LARGEST_LOG_RATE = 10.0
_LARGEST_LEVERAGE = 0.99
"""One sample may nearly fix a young field's model, but what was left out stays finite."""
_TINY = 1e-10

# A kernel that is kept on disk is compiled anew when its own file changes: whatever it calls and
# whatever named tuple it takes stands in that file too.
_FAST = {"contract", "reassoc", "nsz"}
_kernel = njit(cache=True, error_model="numpy", fastmath=_FAST)
_inlined = njit(cache=True, error_model="numpy", fastmath=_FAST, forceinline=True)
"""What is called per output: counting references to its arrays would take as long as its work.

And whatever else is called: were it left to the compiler what to inline, it would decide by what
lies in the cache already, and sums that may be reordered would come out differently by it.
"""


class Scales(NamedTuple):
    """What inputs (n,) and outputs (k,) are divided by, and which inputs a field learns from.

    localised: (l,) and regressed: (r,) indices of inputs. localised_period: (l,) and
    regressed_period: (r,) normalised, 0 where an input does not come round.
    """

    norm_in: FloatArray
    norm_out: FloatArray
    localised: IndexArray
    localised_period: FloatArray
    regressed: IndexArray
    regressed_period: FloatArray


class Sample(NamedTuple):
    """A sample as measured, x (n,) and y (k,), for the `found` fields that it fell into.

    fields: (c,) which they are. weights: (c,) what each weighs it. Only `found` of either are set.
    """

    x: FloatArray
    y: FloatArray
    found: int
    fields: IndexArray
    weights: FloatArray


class LearningFields(NamedTuple):
    """All that c fields keep of their linear models, of k outputs and up to r directions each.

    anchor, mean: (c, w) of the regression inputs and zeros up to the width w. heir, trusted: (c,).
    inherited, slope: (c, k, w). outputs: (c, k) and directions: (c, k, r) records of
    `fields.OUTPUT` and `DIRECTION`. along, along_sum, load, load_sum: (c, k, r, w). What each
    is stands with `fields.FieldArrays`. Normalised.
    """

    anchor: FloatArray
    mean: FloatArray
    inherited: FloatArray
    heir: NDArray[np.bool_]
    trusted: NDArray[np.bool_]
    outputs: Records
    directions: Records
    along: FloatArray
    along_sum: FloatArray
    load: FloatArray
    load_sum: FloatArray
    slope: FloatArray


class DirectionVectors(NamedTuple):
    """Of the r directions of one output in one field: all (r, w), as in `LearningFields`."""

    along: FloatArray
    along_sum: FloatArray
    load: FloatArray
    load_sum: FloatArray


class DirectionRule(NamedTuple):
    """How directions forget, from `initial` to `final` by `tau`, the energy that a new one begins
    with, and the share of the error that one must take away for another to be tried."""

    initial: float
    final: float
    tau: float
    init_s2: float
    add_threshold: float


class Shapes(NamedTuple):
    """Where c fields are, how wide, and how fast they learn that. Normalised.

    centres: (l, c). metrics: (t, c) as in `query_kernels.Bells`. root, rate, log_rate and
    meta_trace: (c, t) as in `fields.FieldArrays`.
    """

    centres: FloatArray
    metrics: FloatArray
    root: FloatArray
    rate: FloatArray
    log_rate: FloatArray
    meta_trace: FloatArray


class ShapeRule(NamedTuple):
    """How shapes are learnt, as in `settings.LwprSettings`; bisquare: the kernel is that."""

    bisquare: bool
    penalty: float
    meta: bool
    meta_rate: float
    compat: bool


class FieldModels(NamedTuple):
    """Of one field: its outputs (k,), directions (k, r), their vectors (k, r, w), errors (k, 2)."""

    outputs: Records
    directions: Records
    along: FloatArray
    load: FloatArray
    errors: FloatArray


class Residue(NamedTuple):
    """Of a sample: here (w,) from the field's mean; room for what directions leave of it (w,), and
    for its projections (r,)."""

    here: FloatArray
    left: FloatArray
    projections: FloatArray


class Slopes(NamedTuple):
    """Of a field's cost. w1, w2: first and second derivative of the weight by the squared distance.

    pull: of the penalty. once, twice: derivatives of the errors by the weight.
    """

    w1: float
    w2: float
    pull: float
    once: float
    twice: float


class Root(NamedTuple):
    """Of one field's metric: the t elements of its root, and how fast each is learnt."""

    root: FloatArray
    rate: FloatArray
    log_rate: FloatArray
    meta_trace: FloatArray


class Matrices(NamedTuple):
    """(l, l) each: the root m, upper triangular, d = mᵀm, and room for m d."""

    m: FloatArray
    d: FloatArray
    product: FloatArray


@_kernel
def learn(
    scales: Scales,
    sample: Sample,
    learning: LearningFields,
    errors: FloatArray,
    predicted: FloatArray,
    by_weight: bool,
    kept_s2: float,
) -> None:
    """Learn a sample in all fields that it fell into.

    by_weight: a field forgets by how much the sample weighs in it. kept_s2: as in the settings.

    For the metric's step it leaves errors (c, k, 2), normalised: of the mean, and of the model
    before it learnt the sample. predicted: (k,) what the trusted fields say after it, in the
    outputs' own units. Raises ValueError unless y is finite.
    """
    norm_in, norm_out = scales.norm_in, scales.norm_out
    where, period = scales.regressed, scales.regressed_period
    x, y, found, fields, weights = sample
    anchor, mean, inherited, heir = (
        learning.anchor,
        learning.mean,
        learning.inherited,
        learning.heir,
    )
    trusted, outputs, directions = learning.trusted, learning.outputs, learning.directions
    along, along_sum, load = learning.along, learning.along_sum, learning.load
    load_sum, slope = learning.load_sum, learning.slope
    if y.size != norm_out.size:
        raise ValueError("the output has not as many elements as the model's outputs")
    for k in range(y.size):
        if not np.isfinite(y[k]):
            raise ValueError("the output is not finite: such a sample is refused")
    size, width, total = where.size, along.shape[3], 0.0
    at, near, here = np.zeros(width), np.zeros(width), np.empty(width)
    left, remainder = np.empty(width), np.empty(along.shape[2] + 1)
    predicted[:] = 0.0
    for i in range(size):
        at[i] = near[i] = x[where[i]] / norm_in[where[i]]
    for a in range(found):
        f, w = fields[a], weights[a]
        first = directions[f, 0, 0]
        part = w if by_weight else 1.0
        before = first.weight * (1.0 - part * (1.0 - first.forgetting))
        share = 1.0 / (before + w)
        for i in range(size):
            if period[i] > 0.0:
                turns = np.rint((at[i] - anchor[f, i]) / period[i])
                near[i] = at[i] - turns * period[i]
        middle = mean[f]
        for i in range(width):
            middle[i] = (before * middle[i] + w * near[i]) * share
            here[i] = near[i] - middle[i]
        trusted[f] = heir[f] or first.samples > 2.0 * size
        settled = first.samples * (1.0 - first.forgetting) > _LEAST_MEMORY
        if trusted[f]:
            total += w
        for k in range(y.size):
            output, mine, tangent = outputs[f, k], directions[f, k], slope[f, k]
            given, given_here = 0.0, 0.0
            if heir[f]:
                for i in range(width):
                    given += inherited[f, k, i] * (near[i] - anchor[f, i])
                    given_here += inherited[f, k, i] * here[i]
            target = y[k] / norm_out[k] - given
            output.mean = (before * output.mean + w * target) * share
            output.level = output.mean + given - given_here
            remainder[0] = target - output.mean
            for i in range(width):
                left[i] = here[i]
            vectors = DirectionVectors(along[f, k], along_sum[f, k], load[f, k], load_sum[f, k])
            _learn_directions(w, part, kept_s2, settled, output, mine, vectors, left, remainder)
            mature = _mature_rank(output.rank, mine, size)
            errors[f, k, 0], errors[f, k, 1] = remainder[0], remainder[mature]
            _sum_up(mature, mine, along[f, k], load[f, k], inherited[f, k], tangent)
            if trusted[f]:
                value = output.level
                for i in range(width):
                    value += tangent[i] * here[i]
                predicted[k] += w * value
    if total > 0.0:
        for k in range(y.size):
            predicted[k] *= norm_out[k] / total


@_inlined
def _learn_directions(
    w: float,
    part: float,
    kept_s2: float,
    settled: bool,
    output: Record,
    directions: Records,
    vectors: DirectionVectors,
    left: FloatArray,
    remainder: FloatArray,
) -> None:
    """What each direction leaves of the inputs (`left`) and of the output, then learns of them.

    part: of what a sample makes a field forget, as much as this one does.
    A direction takes its part out as it was before this sample: `remainder` (r+1,) are errors on a
    sample never seen. One pass over a direction's vectors, because they are what the time goes to.
    """
    along, along_sum, load, load_sum = vectors
    size, taken = left.size, 0.0
    for r in range(output.rank):
        d = directions[r]
        s = 0.0
        for i in range(size):
            s += along[r, i] * left[i]
        remainder[r + 1] = remainder[r] - d.beta * s
        keep = 1.0 - part * (1.0 - d.forgetting)
        weight_s, weight_y = w * s, w * remainder[r]
        if settled:
            d.error = keep * d.error + w * remainder[r + 1] * remainder[r + 1]
        d.weight = keep * d.weight + w
        d.energy = max(keep * d.energy + weight_s * s, _LEAST_ENERGY)
        d.covariance = keep * d.covariance + weight_y * s
        by_energy = 1.0 / (d.energy + kept_s2)
        d.beta = d.covariance * by_energy
        taken += weight_s * weight_s * by_energy
        slow, norm = 0.9 + 0.1 * keep, 0.0
        for i in range(size):
            here = left[i]
            along_sum[r, i] = slow * along_sum[r, i] + weight_y * here
            norm += along_sum[r, i] * along_sum[r, i]
            left[i] = here - load[r, i] * s
            load_sum[r, i] = keep * load_sum[r, i] + weight_s * here
            load[r, i] = load_sum[r, i] * by_energy
        if norm > _LEAST_COVARIANCE:
            by_norm = 1.0 / np.sqrt(norm)
            for i in range(size):
                along[r, i] = along_sum[r, i] * by_norm
    output.freedom = directions[output.rank - 1].forgetting * output.freedom + taken


@_inlined
def _mature_rank(rank: int, directions: Records, size: int) -> int:
    """The last direction has a say when it has seen enough."""
    return rank if directions[rank - 1].samples > 2.0 * size else rank - 1


@_inlined
def _sum_up(
    mature: int,
    directions: Records,
    along: FloatArray,
    load: FloatArray,
    inherited: FloatArray,
    slope: FloatArray,
) -> None:
    """The slope of Σ β s with respect to the input, from the last direction to the first."""
    last = max(mature - 1, 0)
    gain = directions[last].beta if mature > 0 else 0.0
    for i in range(slope.size):
        slope[i] = gain * along[last, i]
    for r in range(last - 1, -1, -1):
        gain = directions[r].beta
        for i in range(slope.size):
            gain -= slope[i] * load[r, i]
        for i in range(slope.size):
            slope[i] += gain * along[r, i]
    for i in range(slope.size):
        slope[i] += inherited[i]


@_kernel
def close(sample: Sample, learning: LearningFields, size: int, rule: DirectionRule) -> int:
    """The end of a sample: a further direction where it pays, then the counts and forgetting.

    size: how many inputs are regressed on. Returns the largest number of directions.
    """
    fields, largest = sample.fields, 0
    outputs, directions, slope = learning.outputs, learning.directions, learning.slope
    along, load, inherited = learning.along, learning.load, learning.inherited
    initial, final, tau, init_s2, add_threshold = rule
    for a in range(sample.found):
        f = fields[a]
        for k in range(outputs.shape[1]):
            output, mine = outputs[f, k], directions[f, k]
            mature = _mature_rank(output.rank, mine, size)
            if output.rank < size and _needs_another(mine, output.rank, add_threshold):
                r = output.rank
                _add_direction(mine[r], along[f, k, r], load[f, k, r], r, initial, init_s2)
                output.freedom = 0.0
                output.rank = r + 1
            for r in range(output.rank):
                d = mine[r]
                d.samples = d.forgetting * d.samples + 1.0
                # Written so that rounding does not pull it to one side ten thousand times.
                d.forgetting = final + tau * (d.forgetting - final)
            now_mature = _mature_rank(output.rank, mine, size)
            if now_mature != mature:
                _sum_up(now_mature, mine, along[f, k], load[f, k], inherited[f, k], slope[f, k])
            largest = max(largest, output.rank)
    return largest


@_inlined
def _needs_another(directions: Records, rank: int, threshold: float) -> bool:
    last, one_less = directions[rank - 1], directions[rank - 2]
    if not last.samples > 0.99 * directions[0].samples:
        return False
    if not last.samples * (1.0 - last.forgetting) > 0.5:
        return False
    error = last.error / last.weight + _MASS_OF_NOTHING
    return bool(error < threshold * (one_less.error / one_less.weight + _MASS_OF_NOTHING))


@_inlined
def _add_direction(
    d: Record, along: FloatArray, load: FloatArray, r: int, initial: float, init_s2: float
) -> None:
    d.energy, d.weight, d.forgetting = init_s2, _MASS_OF_NOTHING, initial
    d.covariance = d.beta = d.samples = d.error = d.trace_h = d.trace_k = 0.0
    along[:] = 0.0
    load[:] = 0.0
    along[r] = load[r] = 1.0


@_kernel
def adapt(
    scales: Scales,
    sample: Sample,
    learning: LearningFields,
    shapes: Shapes,
    errors: FloatArray,
    rule: ShapeRule,
) -> None:
    """One step of every shape that the sample fell into, after `learn` and before `close`.

    errors: (c, k, 2) as `learn` left them.
    """
    norm_in, where, period = scales.norm_in, scales.localised, scales.localised_period
    regressed, regressed_period = scales.regressed, scales.regressed_period
    x, found, fields, weights = sample.x, sample.found, sample.fields, sample.weights
    anchor, mean = learning.anchor, learning.mean
    outputs, directions = learning.outputs, learning.directions
    along, load = learning.along, learning.load
    centres, metrics, root, rate, log_rate, meta_trace = shapes
    size, inputs = where.size, regressed.size
    here, left = np.zeros(along.shape[3]), np.empty(along.shape[3])
    residue = Residue(here, left, np.empty(along.shape[2]))
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
        models = FieldModels(outputs[f], directions[f], along[f], load[f], errors[f])
        belief, once, twice = _cost_by_weight(w, inputs, models, residue, rule)
        w1, w2 = -0.5 * w, 0.25 * w
        if rule.bisquare:
            w1, w2 = -0.5 * np.sqrt(w), 0.125
        pull = belief * 4.0 * rule.penalty / size * w / first.weight
        slopes = Slopes(w1, w2, pull, once, twice)
        mine = Root(root[f], rate[f], log_rate[f], meta_trace[f])
        if diagonal:
            _step_diagonal(way, slopes, mine, rule)
            for i in range(size):
                metrics[i, f] = root[f, i] * root[f, i]
        else:
            _unpack(root[f], m)
            _square(m, d)
            _step_full(way, slopes, Matrices(m, d, product), mine, rule)
            _unpack(root[f], m)
            _square(m, d)
            k = 0
            for i in range(size):
                for j in range(i, size):
                    metrics[k, f] = d[i, j] if i == j else 2.0 * d[i, j]
                    k += 1


@_inlined
def _cost_by_weight(
    w: float, inputs: int, models: FieldModels, residue: Residue, rule: ShapeRule
) -> tuple[float, float, float]:
    """First and second derivative of the cost by this sample's weight; then the traces go on.

    Each output has a belief in it, from 0 to 1: little as long as its model still changes so much
    that errors before and after learning differ. Returns the mean belief, and the mean derivatives
    by belief.
    """
    outputs, directions, along, load, errors = models
    here, left, projections = residue
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
        vectors = along[k], load[k]
        after = errors[k, 0] - _project(rank, mature, directions[k], vectors, left, projections)
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
        if rule.meta:
            second = 0.0
            for r in range(used):
                d, s = directions[k, r], projections[r]
                second += (s * after * by_total + s * spread) / d.energy * d.trace_h
            second = 4.0 * second + error * by_total * by_total
            second += 2.0 * (after * after * leverage / w - before * before * by_total)
            twice += trust * second * by_total
        if not rule.compat:
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
    vectors: tuple[FloatArray, FloatArray],
    left: FloatArray,
    projections: FloatArray,
) -> float:
    """The sample's projections (r,) after learning it, and what the mature ones make of it."""
    value = 0.0
    along, load = vectors
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


@_inlined
def _step_diagonal(way: FloatArray, slopes: Slopes, mine: Root, rule: ShapeRule) -> None:
    w1, w2, pull, once, twice = slopes
    root, rate = mine.root, mine.rate
    largest = np.abs(root).max()
    for i in range(way.size):
        m, squared = root[i], way[i] * way[i]
        slope = 2.0 * squared * m
        gradient = pull * m * m * m + w1 * slope * once
        if rule.meta:
            second = 3.0 * pull * m * m + (w2 * slope * slope + 2.0 * w1 * squared) * once
            second += (w1 * slope) ** 2 * twice
            _learn_rate(i, gradient, second, mine, rule.meta_rate)
        step = rate[i] * gradient
        if _too_long(step, largest, rule.compat):
            _slow_down(i, mine, rule.compat)
        else:
            root[i] = m - step


@_inlined
def _step_full(
    way: FloatArray, slopes: Slopes, matrices: Matrices, mine: Root, rule: ShapeRule
) -> None:
    """m d is the penalty's gradient."""
    w1, w2, pull, once, twice = slopes
    m, d, product = matrices
    root, rate = mine.root, mine.rate
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
            if rule.meta:
                second = pull * (d[b, b] + length + m[a, b] * m[a, b])
                second += (w2 * slope * slope + 2.0 * w1 * way[b] * way[b]) * once
                second += (w1 * slope) ** 2 * twice
                _learn_rate(k, gradient, second, mine, rule.meta_rate)
            step = rate[k] * gradient
            if _too_long(step, largest, rule.compat):
                _slow_down(k, mine, rule.compat)
            else:
                root[k] -= step
            k += 1


@_inlined
def _learn_rate(i: int, gradient: float, second: float, mine: Root, meta_rate: float) -> None:
    """Faster where gradients keep their sign (Sutton's incremental delta-bar-delta)."""
    rate, log_rate, meta_trace = mine.rate, mine.log_rate, mine.meta_trace
    change = meta_rate * gradient * meta_trace[i]
    change = max(-_LARGEST_RATE_STEP, min(_LARGEST_RATE_STEP, change))
    log_rate[i] = max(-_LARGEST_LOG_RATE, min(_LARGEST_LOG_RATE, log_rate[i] - change))
    rate[i] = np.exp(log_rate[i])
    keep = max(0.0, 1.0 - rate[i] * second)
    meta_trace[i] = meta_trace[i] * keep - rate[i] * gradient


@_inlined
def _too_long(step: float, largest: float, compat: bool) -> bool:
    if compat:
        # The reference library lets a field shrink as fast as it likes.
        return step > _LARGEST_STEP * largest
    return not abs(step) <= _LARGEST_STEP * largest


@_inlined
def _slow_down(i: int, mine: Root, compat: bool) -> None:
    mine.rate[i] *= 0.5
    if not compat:
        mine.log_rate[i] = np.log(mine.rate[i])


@_inlined
def _unpack(root: FloatArray, m: FloatArray) -> None:
    """The upper triangle; below it m stays zero."""
    k = 0
    for a in range(m.shape[0]):
        for b in range(a, m.shape[0]):
            m[a, b] = root[k]
            k += 1


@_inlined
def _square(m: FloatArray, d: FloatArray) -> None:
    """d = mᵀm of an upper triangular m; of d only the upper triangle."""
    size = m.shape[0]
    d[:] = 0.0
    for a in range(size):
        for i in range(a, size):
            for j in range(i, size):
                d[i, j] += m[a, i] * m[a, j]


@_inlined
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
