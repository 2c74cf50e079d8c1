"""Which receptive fields a point falls into, and what they say of it together. Compiled.

Prediction, its slopes, its derivative, and how sure it is.

Centres and metrics lie coordinate by coordinate, so that one pass over all fields is a few long
rows of multiplications: with two thousand fields this pass is what a query costs.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
Records = NDArray[np.void]

_BLOCK = 128
"""Fields whose differences are kept at a time: they stay in the processor's first cache."""

# A kernel that is kept on disk is compiled anew when its own file changes: whatever it calls and
# whatever named tuple it takes stands in that file too.
_FAST = {"contract", "reassoc", "nsz"}
_kernel = njit(cache=True, error_model="numpy", fastmath=_FAST)


class Inputs(NamedTuple):
    """What inputs are divided by, (n,), and which of them are localised on and regressed on.

    localised: (l,) and regressed: (r,) indices of inputs. localised_period: (l,) and
    regressed_period: (r,) normalised, 0 where an input does not come round.
    """

    norm: FloatArray
    localised: IndexArray
    localised_period: FloatArray
    regressed: IndexArray
    regressed_period: FloatArray


class Bells(NamedTuple):
    """Where c fields are and how wide, normalised.

    centres: (l, c). metrics: (l, c) the diagonals, or (l(l+1)/2, c) the coefficients of the
    quadratic form. bisquare: the kernel is that, and else a Gaussian.
    """

    centres: FloatArray
    metrics: FloatArray
    bisquare: bool


class Models(NamedTuple):
    """The linear models of c fields, normalised: prediction = level + slope · (x - mean).

    anchor, mean: (c, w) of the regression inputs and zeros up to the width w. trusted: (c,).
    outputs: (c, k) records of `fields.OUTPUT`. slope: (c, k, w).
    """

    anchor: FloatArray
    mean: FloatArray
    trusted: NDArray[np.bool_]
    outputs: Records
    slope: FloatArray


class Active(NamedTuple):
    """How many fields weigh a point, which, and how much: only so many of either are set."""

    found: int
    fields: IndexArray
    weights: FloatArray


class Projections(NamedTuple):
    """The directions that the models of c fields are regressed on.

    directions: (c, k, r) records of `fields.DIRECTION`. along: (c, k, r, w) unit vectors that
    inputs are projected on. load: (c, k, r, w) what a projection explains of the inputs.
    """

    directions: Records
    along: FloatArray
    load: FloatArray


@_kernel
def activate(
    x: FloatArray,
    inputs: Inputs,
    bells: Bells,
    count: int,
    cutoff: float,
    fields: IndexArray,
    weights: FloatArray,
) -> tuple[int, int, int, float, float]:
    """Writes the fields that weigh x more than `cutoff`, and their weights.

    x: (n,) as measured. count: fields in use. Returns how many they are, the nearest field and the
    next (-1: there is none), and the weights of these two. Raises ValueError unless x is finite.
    """
    norm_in, where, period = inputs.norm, inputs.localised, inputs.localised_period
    centres, metrics, bisquare = bells
    if x.size != norm_in.size:
        raise ValueError("the input has not as many elements as the model's inputs")
    for i in range(x.size):
        if not np.isfinite(x[i]):
            raise ValueError("the input is not finite: such a sample or query is refused")
    z = np.empty(where.size)
    for a in range(where.size):
        z[a] = x[where[a]] / norm_in[where[a]]
    q = np.empty(count)
    if metrics.shape[0] == z.size:
        _diagonal_distances(z, period, centres, metrics, q)
    else:
        _full_distances(z, period, centres, metrics, q)
    found = 0
    limit = _farthest(bisquare, cutoff)
    first, second, q_first, q_second = -1, -1, np.inf, np.inf
    for j in range(count):
        if q[j] < q_second:
            if q[j] < q_first:
                first, second, q_first, q_second = j, first, q[j], q_first
            else:
                second, q_second = j, q[j]
        if q[j] <= limit:
            weight = _weight(q[j], bisquare)
            if weight > cutoff:
                fields[found], weights[found] = j, weight
                found += 1
    return found, first, second, _weight(q_first, bisquare), _weight(q_second, bisquare)


@_kernel
def predict(
    x: FloatArray,
    inputs: Inputs,
    norm_out: FloatArray,
    bells: Bells,
    models: Models,
    count: int,
    cutoff: float,
    predicted: FloatArray,
) -> None:
    """The mean of what the trusted fields predict at x, by their weights (k,); 0 where none is.

    x: (n,) as measured. norm_out: (k,) what outputs are divided by. count and cutoff as for
    `activate`. ValueError unless x is finite.
    """
    norm_in, regressed, regressed_period = inputs.norm, inputs.regressed, inputs.regressed_period
    anchor, mean, trusted, outputs, slope = models
    fields, weights = np.empty(count, dtype=np.int64), np.empty(count)
    found = activate(x, inputs, bells, count, cutoff, fields, weights)[0]
    width, total = mean.shape[1], 0.0
    at, here = np.zeros(width), np.empty(width)
    for i in range(regressed.size):
        at[i] = x[regressed[i]] / norm_in[regressed[i]]
    predicted[:] = 0.0
    for a in range(found):
        f, w = fields[a], weights[a]
        if not trusted[f]:
            continue
        total += w
        for i in range(width):
            here[i] = at[i] - mean[f, i]
        for i in range(regressed_period.size):
            if regressed_period[i] > 0.0:
                turns = np.rint((at[i] - anchor[f, i]) / regressed_period[i])
                here[i] -= turns * regressed_period[i]
        for k in range(predicted.size):
            value = outputs[f, k].level
            for i in range(width):
                value += slope[f, k, i] * here[i]
            predicted[k] += w * value
    if total > 0.0:
        for k in range(predicted.size):
            predicted[k] *= norm_out[k] / total


@_kernel
def _weight(q: float, bisquare: bool) -> float:
    if bisquare:
        return (1.0 - 0.25 * q) ** 2 if q < 4.0 else 0.0
    return float(np.exp(-0.5 * q))


@_kernel
def _farthest(bisquare: bool, cutoff: float) -> float:
    """No field farther than this weighs more than the cutoff; a little more, for rounding."""
    if cutoff < 0.0:
        return np.inf
    if bisquare:
        return 4.0
    return float(-2.0 * np.log(cutoff)) * (1.0 + 1e-9) + 1e-9


@_kernel
def _difference(z: float, period: float, centre: FloatArray, out: FloatArray) -> None:
    """From each centre to z along one coordinate, the shorter way round if it comes round."""
    for j in range(out.size):
        out[j] = z - centre[j]
    if period > 0.0:
        for j in range(out.size):
            out[j] -= period * np.rint(out[j] / period)


@_kernel
def _diagonal_distances(
    z: FloatArray, period: FloatArray, centres: FloatArray, metrics: FloatArray, q: FloatArray
) -> None:
    q[:] = 0.0
    difference = np.empty(q.size)
    for a in range(z.size):
        metric = metrics[a]
        if period[a] > 0.0:
            _difference(z[a], period[a], centres[a], difference)
            for j in range(q.size):
                q[j] += metric[j] * difference[j] * difference[j]
        else:
            centre, at = centres[a], z[a]
            for j in range(q.size):
                q[j] += metric[j] * (at - centre[j]) * (at - centre[j])


@_kernel
def _full_distances(
    z: FloatArray, period: FloatArray, centres: FloatArray, metrics: FloatArray, q: FloatArray
) -> None:
    size = z.size
    differences = np.empty((size, _BLOCK))
    for start in range(0, q.size, _BLOCK):
        stop = min(start + _BLOCK, q.size)
        block = q[start:stop]
        block[:] = 0.0
        for a in range(size):
            _difference(z[a], period[a], centres[a, start:stop], differences[a, : block.size])
        k = 0
        for a in range(size):
            for b in range(a, size):
                metric = metrics[k, start:stop]
                for j in range(block.size):
                    block[j] += metric[j] * differences[a, j] * differences[b, j]
                k += 1


@_kernel
def _from_mean(
    at: FloatArray, period: FloatArray, anchor: FloatArray, mean: FloatArray, here: FloatArray
) -> None:
    """From the field's mean to the point; inputs that come round are taken near its birthplace."""
    for i in range(at.size):
        here[i] = at[i] - mean[i]
    for i in range(period.size):
        if period[i] > 0.0:
            way = at[i] - anchor[i]
            here[i] = anchor[i] + way - period[i] * np.rint(way / period[i]) - mean[i]


@_kernel
def blend_slopes(
    found: int,
    fields: IndexArray,
    weights: FloatArray,
    trusted: NDArray[np.bool_],
    slope: FloatArray,
    blended: FloatArray,
) -> None:
    """Mean of the trusted fields' slopes (k, n), normalised, by their weights; else 0."""
    blended[:] = 0.0
    total = 0.0
    for a in range(found):
        f, w = fields[a], weights[a]
        if not trusted[f]:
            continue
        total += w
        for k in range(blended.shape[0]):
            for i in range(blended.shape[1]):
                blended[k, i] += w * slope[f, k, i]
    if total > 0.0:
        blended /= total


@_kernel
def blend_confidence(
    x: FloatArray,
    inputs: Inputs,
    active: Active,
    models: Models,
    projections: Projections,
    compat: bool,
    confidence: FloatArray,
) -> None:
    """One standard deviation of the blended prediction (k,), normalised.

    From the errors of each field on samples it had not learnt yet, how far x is from what it knows,
    and how far the fields disagree. A field that has seen too few samples to count its errors, or
    spent them all on its directions, cannot tell. Infinite where none can (`compat`: 1e20).
    """
    norm_in, where, period = inputs.norm, inputs.regressed, inputs.regressed_period
    found, fields, weights = active
    anchor, mean, trusted, outputs, slope = models
    directions, along, load = projections
    size, width = where.size, mean.shape[1]
    at, here = np.zeros(width), np.empty(width)
    for i in range(size):
        at[i] = x[where[i]] / norm_in[where[i]]
    for k in range(confidence.size):
        total, variance, blended, disagreement = 0.0, 0.0, 0.0, 0.0
        for a in range(found):
            f, w = fields[a], weights[a]
            if not trusted[f]:
                continue
            _from_mean(at, period, anchor[f], mean[f], here)
            rank, mine = outputs[f, k].rank, directions[f, k]
            mature = rank if mine[rank - 1].samples > 2.0 * size else rank - 1
            if mature == 0 or not (compat or mine[mature - 1].error > 0.0):
                continue
            spare = mine[mature - 1].weight - outputs[f, k].freedom
            if compat:
                spare = abs(spare)
            if not spare > 0.0:
                continue
            value, distance = outputs[f, k].level, 0.0
            for i in range(width):
                value += slope[f, k, i] * here[i]
            for r in range(mature):
                s = 0.0
                for i in range(width):
                    s += along[f, k, r, i] * here[i]
                for i in range(width):
                    here[i] -= load[f, k, r, i] * s
                distance += s * s / mine[r].energy
            variance += w * mine[mature - 1].error / spare * (1.0 + w * distance)
            away = value - blended
            disagreement += away * away * w * total / (total + w)
            total += w
            blended += away * w / total
        if total > 0.0:
            confidence[k] = np.sqrt(variance + disagreement) / total
        else:
            confidence[k] = 1e20 if compat else np.inf


@_kernel
def derivative(
    x: FloatArray,
    inputs: Inputs,
    active: Active,
    bells: Bells,
    models: Models,
    jacobian: FloatArray,
) -> None:
    """The prediction derived by all inputs: (k, n), normalised. 0 where no field speaks."""
    norm_in, localised, localised_period, regressed, regressed_period = inputs
    found, fields, weights = active
    centres, metrics, bisquare = bells
    anchor, mean, trusted, outputs, slope = models
    size, count = regressed.size, jacobian.shape[0]
    at, here = np.zeros(mean.shape[1]), np.empty(mean.shape[1])
    for i in range(size):
        at[i] = x[regressed[i]] / norm_in[regressed[i]]
    way, turn, all_turns = (
        np.empty(localised.size),
        np.empty(localised.size),
        np.zeros(localised.size),
    )
    values = np.zeros(count)
    total = 0.0
    jacobian[:] = 0.0
    for a in range(found):
        f, w = fields[a], weights[a]
        if not trusted[f]:
            continue
        total += w
        for i in range(way.size):
            way[i] = x[localised[i]] / norm_in[localised[i]] - centres[i, f]
            if localised_period[i] > 0.0:
                way[i] -= localised_period[i] * np.rint(way[i] / localised_period[i])
        _half_gradient(way, metrics, f, turn)
        turn *= -np.sqrt(w) if bisquare else -w
        all_turns += turn
        _from_mean(at, regressed_period, anchor[f], mean[f], here)
        for k in range(count):
            value = outputs[f, k].level
            for i in range(size):
                value += slope[f, k, i] * here[i]
                jacobian[k, regressed[i]] += w * slope[f, k, i]
            values[k] += w * value
            for i in range(way.size):
                jacobian[k, localised[i]] += turn[i] * value
    if total > 0.0:
        for k in range(count):
            for i in range(way.size):
                jacobian[k, localised[i]] -= all_turns[i] * values[k] / total
        jacobian /= total


@_kernel
def _half_gradient(way: FloatArray, metrics: FloatArray, f: int, out: FloatArray) -> None:
    """D way, which is half of how the squared distance grows."""
    size = way.size
    if metrics.shape[0] == size:
        for i in range(size):
            out[i] = metrics[i, f] * way[i]
        return
    out[:] = 0.0
    k = 0
    for i in range(size):
        out[i] += metrics[k, f] * way[i]
        k += 1
        for j in range(i + 1, size):
            out[i] += 0.5 * metrics[k, f] * way[j]
            out[j] += 0.5 * metrics[k, f] * way[i]
            k += 1
