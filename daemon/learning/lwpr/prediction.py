"""What fields say of their prediction at a point: slopes, derivative, confidence. Compiled."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from daemon.learning.lwpr.query import Active, Bells, Inputs, Models

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
Records = NDArray[np.void]

_FAST = {"contract", "reassoc", "nsz"}
_kernel = njit(cache=True, error_model="numpy", fastmath=_FAST)


class Projections(NamedTuple):
    """The directions that the models of c fields are regressed on.

    directions: (c, k, r) records of `lwpr_fields.DIRECTION`. along: (c, k, r, w) unit vectors that
    inputs are projected on. load: (c, k, r, w) what a projection explains of the inputs.
    """

    directions: Records
    along: FloatArray
    load: FloatArray


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
