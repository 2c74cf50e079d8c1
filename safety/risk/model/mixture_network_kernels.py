"""The mixture density network's numerics, compiled: forward, and backward to its inputs.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

m inputs, f features of them that the first layer sees, K components over d coordinates. A network
comes as three flat things, because every array that is handed to compiled code costs a tenth of a
microsecond:

parameters: all matrices (outputs, inputs) and biases; float32 as a rule.
plan: (1 + layers, 4) int64. The first row is the activation, then where trunk, means and factors
    end. The others are inputs, outputs, where the matrix begins, where the biases begin.
scaling: float64. (m,) offset and (m,) scale of the inputs, (d,) offset_mm of the means, and the
    three numbers scale_mm, lowest and highest logarithm of a factor's diagonal; then (m,) periods
    of the inputs, 0: none.
"""

from math import cos, pi, sin, sqrt

import numpy as np
from numba import njit

RELU, TANH, SILU = 0, 1, 2

_SATURATED = 9.0
"""Beyond, tanh is one but for 3e-8."""

_kernel = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc"})
"""fastmath: sums may be reordered, so that they run in parallel lanes; NaN and inf stay what they
are. error_model: a division by zero gives inf, and no exception."""


@_kernel
def feature_count(period):  # type: ignore[no-untyped-def]
    """How many numbers say where (m,) inputs are, of these periods; 0: none."""
    count = period.size
    for i in range(period.size):
        if period[i] > 0.0:
            count += 1
    return count


@_kernel
def write_features(u, offset, scale, period, out):  # type: ignore[no-untyped-def]
    """Write (f,) of (m,) u: of an input without a period (u − offset) / scale, of another one the
    cosine and the sine of how far it is in its period."""
    place = 0
    for i in range(u.size):
        if period[i] > 0.0:
            angle = 2.0 * pi / period[i] * u[i]
            out[place], out[place + 1] = cos(angle), sin(angle)
            place += 2
        else:
            out[place] = (u[i] - offset[i]) / scale[i]
            place += 1


@_kernel
def is_near(known, u, scale, period, reach):  # type: ignore[no-untyped-def]
    """Whether one of (n, f) known features is no farther from those of (m,) u, which say (m,) scale
    for one unit of an input; never of no number."""
    place = np.empty(feature_count(period))
    write_features(u, np.zeros(u.size), 1.0 / scale, period, place)
    for k in range(known.shape[0]):
        square = 0.0
        for i in range(place.size):
            way = known[k, i] - place[i]
            square += way * way
        if sqrt(square) <= reach:
            return True
    return False


@_kernel
def forward(parameters, plan, scaling, u, weights, means, factors):  # type: ignore[no-untyped-def]
    """Of (n, m) u fill (n, K) weights, (n, K, d) means in mm, (n, K, d, d) factors per mm, whose
    lower half is left.

    Returns whether all are finite. Several at once read the parameters, which are more than a
    processor's nearest caches hold, only once.
    """
    count, inputs = u.shape
    values = np.empty((count, _width(plan)), parameters.dtype)
    heads = _run(parameters, plan, scaling, u, values)
    total = parameters.dtype.type(0.0)
    for n in range(count):
        _to_mixture(values[n], heads, scaling, inputs, weights[n], means[n], factors[n])
        for i in range(values.shape[1]):  # activations and limits could hide what is not finite
            total += abs(values[n, i])
    return np.isfinite(total)


@_kernel
def backward(parameters, plan, scaling, u, by_weights, by_means, by_factors):  # type: ignore[no-untyped-def]
    """(m,) derivative by u of a number whose derivatives by the mixture's parameters are given.

    by_weights (K,), by_means (K, d), by_factors (K, d, d) of which the upper half counts.
    """
    one = np.empty((1, _width(plan)), parameters.dtype)
    heads = _run(parameters, plan, scaling, u.reshape(1, u.size), one)
    values = one[0]
    slopes = np.zeros_like(values)
    _from_mixture(values, heads, scaling, u.size, by_weights, by_means, by_factors, slopes)
    _back(parameters, plan, values, slopes)
    return _by_inputs(values, slopes, scaling, u.size)


@_kernel
def _width(plan):  # type: ignore[no-untyped-def]
    """Numbers of the features and all layers together."""
    return plan[1, 0] + plan[1:, 1].sum()


@_kernel
def _run(parameters, plan, scaling, u, values):  # type: ignore[no-untyped-def]
    """Fill a row of `values` for each of (n, m) u with the features and what each layer has before
    its activation.

    Returns where in it the results of the three heads begin.
    """
    (count, m), features, layers = u.shape, plan[1, 0], plan.shape[0] - 1
    heads = (0, 0, 0)
    active = np.empty((count, max(features, plan[1:, 1].max())), values.dtype)
    for n in range(count):
        offset, scale, period = scaling[:m], scaling[m : 2 * m], scaling[scaling.size - m :]
        write_features(u[n], offset, scale, period, values[n])
    active[:, :features] = values[:, :features]
    trunk = active
    place, stack = features, 0
    for layer in range(layers):
        outputs = plan[1 + layer, 1]
        if stack < 3 and layer == plan[0, 1 + stack]:
            if stack == 0:
                trunk = active.copy()
            else:
                active[:] = trunk
            stack += 1
        _multiply(parameters, plan[1 + layer], active, values, place)
        last = layer == layers - 1 or (stack < 3 and layer == plan[0, 1 + stack] - 1)
        if stack == 0 or not last:
            for n in range(count):
                _activate(plan[0, 0], values[n, place : place + outputs], active[n])
        elif stack == 1:
            heads = (place, 0, 0)
        elif stack == 2:
            heads = (heads[0], place, 0)
        else:
            heads = (heads[0], heads[1], place)
        place += outputs
    return heads


@_kernel
def _multiply(parameters, layer, several, values, place):  # type: ignore[no-untyped-def]
    """Write Mx + b to each row of `values`, from `place` on, for each row of `several`, which
    begins with x; four rows of M at a time, of which the last four may be among those before: so
    all are rounded alike, however many there are."""
    inputs, outputs, matrix, bias = layer
    zero = parameters.dtype.type(0.0)
    o = 0
    while o < outputs and outputs >= 4:
        o = min(o, outputs - 4)
        at = matrix + o * inputs
        first, second = parameters[at : at + inputs], parameters[at + inputs : at + 2 * inputs]
        third = parameters[at + 2 * inputs : at + 3 * inputs]
        fourth = parameters[at + 3 * inputs : at + 4 * inputs]
        for n in range(several.shape[0]):
            x, out, b = several[n], values[n, place + o : place + o + 4], bias + o
            p, q, r, s = zero, zero, zero, zero
            for i in range(inputs):
                p += first[i] * x[i]
                q += second[i] * x[i]
                r += third[i] * x[i]
                s += fourth[i] * x[i]
            out[0], out[1] = p + parameters[b], q + parameters[b + 1]
            out[2], out[3] = r + parameters[b + 2], s + parameters[b + 3]
        o += 4
    while o < outputs:
        row = parameters[matrix + o * inputs : matrix + (o + 1) * inputs]
        for n in range(several.shape[0]):
            x, p = several[n], zero
            for i in range(inputs):
                p += row[i] * x[i]
            values[n, place + o] = p + parameters[bias + o]
        o += 1


@_kernel
def _activate(activation, before, after):  # type: ignore[no-untyped-def]
    one, half, zero = before.dtype.type(1.0), before.dtype.type(0.5), before.dtype.type(0.0)
    if activation == RELU:
        for i in range(before.size):
            after[i] = max(before[i], zero)
    elif activation == TANH:
        for i in range(before.size):
            after[i] = _tanh(before[i], one)
    else:
        for i in range(before.size):
            after[i] = half * before[i] * (one + _tanh(half * before[i], one))


@_kernel
def _slope(activation, before):  # type: ignore[no-untyped-def]
    """Derivative of the activation."""
    if activation == RELU:
        return 1.0 if before > 0.0 else 0.0
    if activation == TANH:
        return 1.0 - _tanh(before, 1.0) ** 2
    share = 0.5 * (1.0 + _tanh(0.5 * before, 1.0))
    return share * (1.0 + before * (1.0 - share))


@_kernel
def _tanh(x, one):  # type: ignore[no-untyped-def]
    """To 2e-7: Lambert's fraction for a quarter of x, and the double-angle formula twice.

    Only arithmetic, so that many are done at once; the library's function takes one at a time.
    one: 1 in the type to calculate in.
    """
    end = _SATURATED * one
    z = min(max(x, -end), end) * (one / 4)
    s = z * z
    above = 135135 * one + s * (17325 * one + s * (378 * one + s))
    below = 135135 * one + s * (62370 * one + s * (3150 * one + s * (28 * one)))
    t = z * above / below
    t = (t + t) / (one + t * t)
    return (t + t) / (one + t * t)


@_kernel
def _to_mixture(values, heads, scaling, m, weights, means, factors):  # type: ignore[no-untyped-def]
    """The heads' results as a mixture."""
    components, d = means.shape
    scale_mm, lowest, highest = scaling[2 * m + d], scaling[2 * m + d + 1], scaling[2 * m + d + 2]
    raw = values[heads[2] :]
    largest, total = -np.inf, 0.0
    for k in range(components):
        largest = max(largest, raw[k])
    for k in range(components):
        weights[k] = np.exp(raw[k] - largest)
        total += weights[k]
    place = heads[1]
    for k in range(components):
        weights[k] /= total
        for i in range(d):
            means[k, i] = scaling[2 * m + i] + scale_mm * values[heads[0] + k * d + i]
            for j in range(i, d):
                value = np.float64(values[place])
                if i == j:
                    value = np.exp(min(max(value, lowest), highest))
                factors[k, i, j] = value / scale_mm
                place += 1


@_kernel
def _from_mixture(  # type: ignore[no-untyped-def]
    values, heads, scaling, m, by_weights, by_means, by_factors, slopes
):
    """Write the derivatives by the heads' results into `slopes`."""
    components, d = by_means.shape
    scale_mm, lowest, highest = scaling[2 * m + d], scaling[2 * m + d + 1], scaling[2 * m + d + 2]
    raw = values[heads[2] :]
    largest, total, mean = -np.inf, 0.0, 0.0
    for k in range(components):
        largest = max(largest, raw[k])
    for k in range(components):
        weight = np.exp(raw[k] - largest)
        total += weight
        mean += weight * by_weights[k]
    mean /= total
    place = heads[1]
    for k in range(components):
        slopes[heads[2] + k] = np.exp(raw[k] - largest) / total * (by_weights[k] - mean)
        for i in range(d):
            slopes[heads[0] + k * d + i] = scale_mm * by_means[k, i]
            for j in range(i, d):
                slope = by_factors[k, i, j] / scale_mm
                if i == j:
                    value = np.float64(values[place])
                    slope *= np.exp(value) if lowest < value < highest else 0.0
                slopes[place] = slope
                place += 1


@_kernel
def _by_inputs(values, slopes, scaling, m):  # type: ignore[no-untyped-def]
    """(m,) slopes by u, of those by its features."""
    period = scaling[scaling.size - m :]
    result, place = np.empty(m), 0
    for i in range(m):
        if period[i] > 0.0:
            across = values[place] * slopes[place + 1] - values[place + 1] * slopes[place]
            result[i] = 2.0 * pi / period[i] * across
            place += 2
        else:
            result[i] = slopes[place] / scaling[m + i]
            place += 1
    return result


@_kernel
def _back(parameters, plan, values, slopes):  # type: ignore[no-untyped-def]
    """Carry `slopes` of the heads' results back through all layers, to those of the features."""
    features, layers = plan[1, 0], plan.shape[0] - 1
    end, trunk_end = values.size, plan[0, 1]
    trunk = features + plan[1:trunk_end, 1].sum()
    for layer in range(layers - 1, -1, -1):
        inputs, outputs, matrix, _ = plan[1 + layer]
        begins_head = layer == trunk_end or layer == plan[0, 2] or layer == plan[0, 3]
        start = trunk if begins_head else end - outputs - inputs
        below, given = slopes[start : start + inputs], slopes[end - outputs : end]
        by_input = np.zeros(inputs, slopes.dtype)
        for o in range(outputs):
            row, slope = parameters[matrix + o * inputs : matrix + (o + 1) * inputs], given[o]
            for i in range(inputs):
                by_input[i] += slope * row[i]
        for i in range(inputs):
            if layer > 0:
                by_input[i] *= _slope(plan[0, 0], values[start + i])
            below[i] += by_input[i]
        end -= outputs
