"""One sample learnt by the linear models of all receptive fields that it falls into. Compiled.

Every output of a field is regressed on a few directions found one after the other: each is where
the inputs that are left vary with the output that is left (partial least squares). Vijayakumar,
D'Souza and Schaal (2005), table 1, with every sum forgetting.
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

_FAST = {"contract", "reassoc", "nsz"}
_kernel = njit(cache=True, error_model="numpy", fastmath=_FAST)
_inlined = njit(cache=True, error_model="numpy", fastmath=_FAST, forceinline=True)
"""What is called per output: counting references to its arrays would take as long as its work."""


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
    `lwpr_fields.OUTPUT` and `DIRECTION`. along, along_sum, load, load_sum: (c, k, r, w). What each
    is stands with `lwpr_fields.FieldArrays`. Normalised.
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


@_kernel
def learn(
    scales: Scales,
    sample: Sample,
    learning: LearningFields,
    errors: FloatArray,
    predicted: FloatArray,
) -> None:
    """Learn a sample in all fields that it fell into.

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
        before = first.weight * first.forgetting
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
            _project(w, settled, output, mine, vectors, left, remainder)
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
def _project(
    w: float,
    settled: bool,
    output: Record,
    directions: Records,
    vectors: DirectionVectors,
    left: FloatArray,
    remainder: FloatArray,
) -> None:
    """What each direction leaves of the inputs (`left`) and of the output, then learns of them.

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
        keep, weight_s, weight_y = d.forgetting, w * s, w * remainder[r]
        if settled:
            d.error = keep * d.error + w * remainder[r + 1] * remainder[r + 1]
        d.weight = keep * d.weight + w
        d.energy = max(keep * d.energy + weight_s * s, _LEAST_ENERGY)
        d.covariance = keep * d.covariance + weight_y * s
        by_energy = 1.0 / d.energy
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
