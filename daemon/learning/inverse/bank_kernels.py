"""Moments of the rewarded sums, kept up to date while samples come and go; compiled.

No function here calls one of another file: numba's cache notices a change only in the file of the
cached function itself.

The sums that a field needs, Σ w exp(−½ σ² C) φ, change with every sample for all samples, because
σ² does. Around an anchor s₀ of σ² they are a power series whose terms do not:

    Σ w exp(−½ s C) φ = Σ_j (s − s₀)ʲ T_j,   T_j = Σ w exp(−½ s₀ C) (−½ C)ʲ / j! φ

Costs count from the rewarded mean cost at s₀: that is a factor common to all terms, rewards stay
numbers of order one, and the series is best for the samples that weigh most.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

INVERSE_MEAN, ESS, PRINTED = 0, 1, 2

_SHRUNK = 1e-6
"""Sums are made anew when a field's mass falls below this share of its largest: what rounding has
left of the samples that went away would no longer be small against those that stay. They are,
too, when a sample comes that weighs so much more than all others together."""
_MEAN_AWAY = 1.0
"""They are, too, when ½ s₀ (rewarded mean cost − reference) has gone beyond this."""
_BISECTIONS = 40
_TOGETHER = 4
"""Samples summed at a time when sums are made anew."""

_kernel = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc"})


class Moments(NamedTuple):
    """Sums of each field over the samples whose weight in it is above the cut.

    terms: (f, J+1, F) T_j. squares: (f, J+1) the same for Σ w² exp(−s C). mass: (f,) Σ w. square:
    (f,) Σ w². cost: (f,) Σ w C. samples: (f,) how many. peak: (f,) largest mass since the sums were
    made anew. anchor: (f,) s₀. reference: (f,) what costs count from. broken: (f,) the sums have
    to be made anew before they are used. stale: (f,) they have changed since the field was solved.
    """

    terms: FloatArray
    squares: FloatArray
    mass: FloatArray
    square: FloatArray
    cost: FloatArray
    samples: IndexArray
    peak: FloatArray
    anchor: FloatArray
    reference: FloatArray
    broken: BoolArray
    stale: BoolArray


class Ring(NamedTuple):
    """The window's samples by slot: places (d, n), cost (n,), products (n, F). filled:
    (1,) how many."""

    places: FloatArray
    cost: FloatArray
    products: FloatArray
    filled: IndexArray


class Rule(NamedTuple):
    """How σ² follows from costs, and how far it may be from an anchor.

    kind: INVERSE_MEAN, ESS or PRINTED. sharpness: κ. least_mean_cost: below it costs tell nothing.
    least_samples: of ESS. tolerance: |s − s₀| / s₀ up to which the series is used. log_cut: samples
    with a smaller ln w in a field are none of its own.
    """

    kind: int
    sharpness: float
    least_mean_cost: float
    least_samples: float
    tolerance: float
    log_cut: float


@_kernel
def exchange(moments, ring, slot, leaves, log_weights, products, cost, rule):  # type: ignore[no-untyped-def]
    """Take a sample into all fields' sums, and the one at `slot` out if it `leaves`.

    log_weights: (2, f) ln w of the new one and of the one at `slot`. products: (F,) of the new one.
    """
    fields, terms, size = moments.terms.shape
    enters = np.empty(terms)
    goes = np.empty(terms)
    old = ring.products[slot]
    for i in range(fields):
        takes = log_weights[0, i] > rule.log_cut
        gives = leaves and log_weights[1, i] > rule.log_cut
        if not (takes or gives):
            continue
        enters[:] = 0.0
        goes[:] = 0.0
        if takes:
            _count(moments, i, 1, log_weights[0, i], cost, enters)
        if gives:
            _count(moments, i, -1, log_weights[1, i], ring.cost[slot], goes)
        moments.stale[i] = True
        if moments.samples[i] <= 0:
            _empty(moments, i)
            continue
        if moments.mass[i] < _SHRUNK * moments.peak[i] or moments.cost[i] < 0.0:
            moments.broken[i] = True
        moments.peak[i] = max(moments.peak[i], moments.mass[i])
        if not moments.broken[i]:
            for j in range(terms):
                term, more, less = moments.terms[i, j], enters[j], goes[j]
                for f in range(size):
                    term[f] += more * products[f] - less * old[f]


@_kernel
def _count(moments, i, sign, log_weight, cost, coefficients):  # type: ignore[no-untyped-def]
    """Count a sample into (sign 1) or out of (−1) field i; write its (J+1,) coefficients of φ."""
    weight = np.exp(log_weight)
    moments.samples[i] += sign
    moments.mass[i] += sign * weight
    moments.square[i] += sign * weight * weight
    moments.cost[i] += sign * weight * cost
    if moments.broken[i]:
        return
    above = cost - moments.reference[i]
    _series(log_weight, moments.anchor[i], above, coefficients)
    if sign > 0 and _SHRUNK * coefficients[0] > moments.terms[i, 0, 0]:
        moments.broken[i] = True
        return
    square = coefficients[0] * coefficients[0]
    for j in range(coefficients.size):
        moments.squares[i, j] += sign * square
        square *= -above / (j + 1)


@_kernel
def _series(log_weight, anchor, above, coefficients):  # type: ignore[no-untyped-def]
    """Write w exp(−½ s₀ C) (−½ C)ʲ / j! for j = 0 … J, C counted from the reference."""
    value = np.exp(log_weight - 0.5 * anchor * above)
    for j in range(coefficients.size):
        coefficients[j] = value
        value *= -0.5 * above / (j + 1)


@_kernel
def _empty(moments, i):  # type: ignore[no-untyped-def]
    """Nothing is left in field i: no residue either."""
    moments.terms[i] = 0.0
    moments.squares[i] = 0.0
    moments.mass[i] = 0.0
    moments.square[i] = 0.0
    moments.cost[i] = 0.0
    moments.samples[i] = 0
    moments.peak[i] = 0.0
    moments.anchor[i] = 0.0
    moments.reference[i] = 0.0
    moments.broken[i] = False


@_kernel
def evaluate(which, moments, geometry, ring, rule, sums):  # type: ignore[no-untyped-def]
    """Write the `sums` of the k fields `which` at their σ² of now: (k, F) products and (k,) mass.

    Sums that cannot be trusted are made anew. Gives how many.
    """
    terms, size = moments.terms.shape[1:]
    capacity = ring.cost.size
    log_weight, work, own = np.empty(capacity), np.empty(capacity), np.empty(capacity, np.int64)
    anew = 0
    for k in range(which.size):
        i = which[k]
        moments.stale[i] = False
        step = 0.0
        if moments.samples[i] > 0 and not moments.broken[i]:
            step = _scale(moments, i, rule) - moments.anchor[i]
        if moments.broken[i] or not _reaches(moments, i, step, rule):
            _make_anew(i, moments, geometry, ring, rule, log_weight, work, own)
            anew += 1
            step = 0.0
        sums.mass[k] = moments.mass[i]
        products, last = sums.products[k], moments.terms[i, terms - 1]
        for f in range(size):
            products[f] = last[f]
        for j in range(terms - 2, -1, -1):
            term = moments.terms[i, j]
            for f in range(size):
                products[f] = products[f] * step + term[f]
    return anew


@_kernel
def _reaches(moments, i, step, rule):  # type: ignore[no-untyped-def]
    """Whether field i's series is good at s₀ + step."""
    anchor = moments.anchor[i]
    away = anchor * abs(moments.terms[i, 1, 0])
    return abs(step) <= rule.tolerance * anchor and away <= _MEAN_AWAY * moments.terms[i, 0, 0]


@_kernel
def stale_fields(log_weight, cut, moments, prior_mass, least_mass, out):  # type: ignore[no-untyped-def]
    """Write those that have a share in an answer and changed since they were solved; give how many.

    log_weight: (f,) at the query. cut: ln of the smallest share against the largest weight of a
    field that knows anything.
    """
    largest, count = -np.inf, 0
    for i in range(log_weight.size):
        if moments.mass[i] + prior_mass[i] >= least_mass:
            largest = max(largest, log_weight[i])
    for i in range(log_weight.size):
        if moments.stale[i] and log_weight[i] >= largest + cut:
            out[count] = i
            count += 1
    return count


@_kernel
def _mean_rule(mass, cost, rule):  # type: ignore[no-untyped-def]
    """σ² by the mean cost."""
    if rule.kind == PRINTED:
        return cost / mass
    return rule.sharpness / max(cost / mass, rule.least_mean_cost)


@_kernel
def _scale(moments, i, rule):  # type: ignore[no-untyped-def]
    """σ² of field i from its moments; NaN where only all samples can tell."""
    sharpest = _mean_rule(moments.mass[i], moments.cost[i], rule)
    if rule.kind != ESS:
        return sharpest
    if moments.mass[i] * moments.mass[i] <= rule.least_samples * moments.square[i]:
        return 0.0
    anchor = moments.anchor[i]
    low = anchor * (1.0 - rule.tolerance)
    high = min(anchor * (1.0 + rule.tolerance), sharpest)
    if not low <= high or _effective(moments, i, low - anchor) < rule.least_samples:
        return np.nan
    if _effective(moments, i, high - anchor) >= rule.least_samples:
        return high if high == sharpest else np.nan
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _effective(moments, i, middle - anchor) >= rule.least_samples:
            low = middle
        else:
            high = middle
    return low


@_kernel
def _effective(moments, i, step):  # type: ignore[no-untyped-def]
    """Effective samples of field i at s₀ + step, by the series."""
    total, squares = 0.0, 0.0
    for j in range(moments.squares.shape[1] - 1, -1, -1):
        total = total * step + moments.terms[i, j, 0]
        squares = squares * step + moments.squares[i, j]
    return total * total / squares


@_kernel
def _make_anew(i, moments, geometry, ring, rule, log_weight, work, own):  # type: ignore[no-untyped-def]
    """Field i's sums from the samples themselves, anchored at its σ² of now.

    log_weight, work: (n,) and own: (n,), overwritten.
    """
    _log_weights_of_samples(i, geometry, ring, log_weight, work)
    _empty(moments, i)
    count = 0
    for k in range(ring.filled[0]):
        if log_weight[k] > rule.log_cut:
            own[count] = k
            count += 1
            weight = np.exp(log_weight[k])
            moments.mass[i] += weight
            moments.square[i] += weight * weight
            moments.cost[i] += weight * ring.cost[k]
    if count == 0:
        return
    moments.samples[i] = count
    moments.peak[i] = moments.mass[i]
    anchor = _mean_rule(moments.mass[i], moments.cost[i], rule)
    if rule.kind == ESS:
        anchor = _sharpest(own[:count], log_weight, ring.cost, anchor, rule)
    moments.anchor[i] = anchor
    moments.reference[i] = _rewarded(own[:count], log_weight, ring.cost, anchor)[1]
    _sum_up(i, own[:count], log_weight, moments, ring)


@_kernel
def _log_weights_of_samples(i, geometry, ring, out, part):  # type: ignore[no-untyped-def]
    """Write (n,) ln w of all samples in field i into `out`. part: (n,), overwritten."""
    d, capacity = ring.places.shape
    out[:] = 0.0
    for a in range(d):
        part[:] = 0.0
        for b in range(a, geometry.reach[a]):
            factor, centre, places = geometry.roots[a, b, i], geometry.centres[b, i], ring.places[b]
            for k in range(capacity):
                part[k] += factor * (places[k] - centre)
        for k in range(capacity):
            out[k] -= 0.5 * part[k] * part[k]


@_kernel
def _sharpest(own, log_weight, cost, sharpest, rule):  # type: ignore[no-untyped-def]
    """The largest σ² up to `sharpest` that leaves enough effective samples, by bisection."""
    least = rule.least_samples
    if _rewarded(own, log_weight, cost, 0.0)[0] <= least:
        return 0.0
    if _rewarded(own, log_weight, cost, sharpest)[0] >= least:
        return sharpest
    low, high = 0.0, sharpest
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _rewarded(own, log_weight, cost, middle)[0] >= least:
            low = middle
        else:
            high = middle
    return low


@_kernel
def _rewarded(own, log_weight, cost, scale):  # type: ignore[no-untyped-def]
    """Effective samples, and rewarded mean cost, of the slots `own`."""
    largest = -np.inf
    for k in own:
        largest = max(largest, log_weight[k] - 0.5 * scale * cost[k])
    total, squares, costs = 0.0, 0.0, 0.0
    for k in own:
        rewarded = np.exp(log_weight[k] - 0.5 * scale * cost[k] - largest)
        total += rewarded
        squares += rewarded * rewarded
        costs += rewarded * cost[k]
    return total * total / squares, costs / total


@_kernel
def _sum_up(i, own, log_weight, moments, ring):  # type: ignore[no-untyped-def]
    """T_j of field i over the slots `own`, a few samples at a time to spare the memory."""
    terms, size = moments.terms.shape[1:]
    coefficients = np.zeros((_TOGETHER, terms))
    slots = np.zeros(_TOGETHER, np.int64)
    for start in range(0, own.size, _TOGETHER):
        coefficients[:] = 0.0
        for t in range(min(_TOGETHER, own.size - start)):
            k = own[start + t]
            slots[t] = k
            above = ring.cost[k] - moments.reference[i]
            _series(log_weight[k], moments.anchor[i], above, coefficients[t])
            square = coefficients[t, 0] * coefficients[t, 0]
            for j in range(terms):
                moments.squares[i, j] += square
                square *= -above / (j + 1)
        first, second = ring.products[slots[0]], ring.products[slots[1]]
        third, fourth = ring.products[slots[2]], ring.products[slots[3]]
        for j in range(terms):
            term = moments.terms[i, j]
            c0, c1 = coefficients[0, j], coefficients[1, j]
            c2, c3 = coefficients[2, j], coefficients[3, j]
            for f in range(size):
                term[f] += c0 * first[f] + c1 * second[f] + c2 * third[f] + c3 * fourth[f]
