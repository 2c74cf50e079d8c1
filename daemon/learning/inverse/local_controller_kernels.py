"""The local controllers' numerics, compiled: weights of fields, solutions, blended answers.

No function here calls one of another file: numba's cache notices a change only in the file of the
cached function itself.

P regressors with the bias first, m targets, F products of them, packed as xxᵀ's upper half by rows,
then xyᵀ by rows; d = P − 4 coordinates of a place. See `regressors`. Loops run over many fields
innermost, so that the compiler puts them in parallel lanes.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

SUPPORT_CUTOFF = 1e-3
"""Fields with a smaller share of the largest weight are not asked what supports an answer."""

_LANES = 16
"""Fields solved at a time: as many as fit the nearest cache."""
_SMALLEST_PIVOT = 1e-13
"""Of a field's mass: below it the matrix is singular by rounding."""

_kernel = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc"})
"""fastmath: sums may be reordered; NaN and inf stay what they are. error_model: a division by zero
gives inf, and no exception."""

_finite_kernel = njit(cache=True, error_model="numpy", nogil=True, fastmath=True)
"""For what is finite by construction: only so are maxima found in parallel lanes."""


class Geometry(NamedTuple):
    """Receptive fields, places counted from the regressors' middle.

    centres: (d, f). roots: (d, d, f) upper triangular M, D = MᵀM. reach: (d,) for each row of M
    one past the last column that is not zero in all fields: diagonal metrics are cheaper.
    """

    centres: FloatArray
    roots: FloatArray
    reach: IndexArray


class Sums(NamedTuple):
    """Of k fields. products: (k, F) Σ W φ, times any factor. mass: (k,) as how many samples they
    count."""

    products: FloatArray
    mass: FloatArray


class Solutions(NamedTuple):
    """What is known of each field after it was solved.

    packed: (f, F) laid out as products are: U, upper triangular with its diagonal's reciprocals,
    UᵀU = A with its ridge, and then β. mass: (f,) of window and prior together; 0 where nothing is
    known. The rest is not then.
    """

    packed: FloatArray
    mass: FloatArray


@_kernel
def log_weights(geometry, places, out):  # type: ignore[no-untyped-def]
    """Write (k, f) −½ |M (z − c)|² into `out`, for (k, d) places z."""
    d, fields = geometry.centres.shape
    away = np.empty((d, fields))
    part = np.empty(fields)
    for k in range(len(places)):
        for a in range(d):
            for i in range(fields):
                away[a, i] = places[k, a] - geometry.centres[a, i]
        out[k] = 0.0
        for a in range(d):
            part[:] = 0.0
            for b in range(a, geometry.reach[a]):
                for i in range(fields):
                    part[i] += geometry.roots[a, b, i] * away[b, i]
            for i in range(fields):
                out[k, i] -= 0.5 * part[i] * part[i]


@_finite_kernel
def exponents(log_weight, cost, scale, out):  # type: ignore[no-untyped-def]
    """Write ln w − ½ σ² C less its largest into the first n columns of `out`.

    log_weight and out: (f, n or more), ln w. cost: (n,) C. scale: (f,) σ².
    """
    count = cost.size
    for i in range(scale.size):
        half = 0.5 * scale[i]
        largest = -np.inf
        for k in range(count):
            largest = max(largest, log_weight[i, k] - half * cost[k])
        for k in range(count):
            out[i, k] = log_weight[i, k] - half * cost[k] - largest


@_kernel
def products_of(row, target, out):  # type: ignore[no-untyped-def]
    """Write (F,) φ of (P,) x and (m,) y."""
    f = 0
    for a in range(row.size):
        for b in range(a, row.size):
            out[f] = row[a] * row[b]
            f += 1
    for a in range(row.size):
        for j in range(target.size):
            out[f] = row[a] * target[j]
            f += 1


@_kernel
def solve_fields(which, axes, window, prior, ridge, least_mass, solutions):  # type: ignore[no-untyped-def]
    """Solve the k fields `which` from the window's sums, of k fields, and the prior's, of all."""
    p = axes + 7
    size = window.products.shape[1]
    work = np.zeros((size, _LANES))
    mass = np.zeros(_LANES)
    for start in range(0, which.size, _LANES):
        lanes = min(_LANES, which.size - start)
        for lane in range(lanes):
            k = start + lane
            _add_up(k, window, which[k], prior, lane, work)
            mass[lane] = work[0, lane]
        _add_ridge(work, p, ridge, mass)
        _eliminate(work, p, axes, mass)
        _substitute(work, p, axes)
        for lane in range(lanes):
            i = which[start + lane]
            solutions.mass[i] = mass[lane] if mass[lane] >= least_mass else 0.0
            for f in range(size):
                solutions.packed[i, f] = work[f, lane]


@_kernel
def _add_up(k, window, i, prior, lane, work):  # type: ignore[no-untyped-def]
    """Write the k-th sums of the window and the i-th of the prior together, each by its mass.

    A sum's first product is the sum of its weights.
    """
    share = 0.0
    if window.mass[k] > 0.0 and window.products[k, 0] > 0.0:
        share = window.mass[k] / window.products[k, 0]
    prior_mass = prior.mass[i]
    for f in range(len(work)):
        work[f, lane] = share * window.products[k, f] + prior_mass * prior.products[i, f]


@_kernel
def _add_ridge(work, p, ridge, mass):  # type: ignore[no-untyped-def]
    """To all of A's diagonal but the bias."""
    at = p
    for a in range(1, p):
        diagonal = work[at]
        for lane in range(mass.size):
            diagonal[lane] += ridge * mass[lane]
        at += p - a


@_kernel
def _eliminate(work, p, m, mass):  # type: ignore[no-untyped-def]
    """[A | B] to [U | U⁻ᵀB] with the reciprocals of U's diagonal, A = UᵀU. All lanes at once.

    The bias goes first, which takes the mean off all other regressors. Where A is not positive
    definite, mass becomes 0.
    """
    cross = p * (p + 1) // 2
    at = 0
    for a in range(p):
        _scale_row(work, at, p - a, cross + a * m, m, mass)
        below = at + p - a
        for b in range(a + 1, p):
            factor = work[at + b - a]
            for c in range(p - b):
                row, above = work[below + c], work[at + b - a + c]
                for lane in range(mass.size):
                    row[lane] -= factor[lane] * above[lane]
            for j in range(m):
                row, above = work[cross + b * m + j], work[cross + a * m + j]
                for lane in range(mass.size):
                    row[lane] -= factor[lane] * above[lane]
            below += p - b
        at += p - a


@_kernel
def _scale_row(work, at, length, cross, m, mass):  # type: ignore[no-untyped-def]
    """Divide a row of [A | B] by the root of its pivot, and put the reciprocal in its place."""
    pivot = work[at]
    for lane in range(mass.size):
        if not pivot[lane] > _SMALLEST_PIVOT * mass[lane]:
            mass[lane] = 0.0
            pivot[lane] = 1.0
        pivot[lane] = 1.0 / np.sqrt(pivot[lane])
    for c in range(1, length):
        row = work[at + c]
        for lane in range(mass.size):
            row[lane] *= pivot[lane]
    for j in range(m):
        row = work[cross + j]
        for lane in range(mass.size):
            row[lane] *= pivot[lane]


@_kernel
def _substitute(work, p, m):  # type: ignore[no-untyped-def]
    """[U | V] to [U | U⁻¹V]. All lanes at once."""
    cross = p * (p + 1) // 2
    at = cross
    for a in range(p - 1, -1, -1):
        at -= p - a
        for b in range(a + 1, p):
            factor = work[at + b - a]
            for j in range(m):
                row, below = work[cross + a * m + j], work[cross + b * m + j]
                for lane in range(factor.size):
                    row[lane] -= factor[lane] * below[lane]
        pivot = work[at]
        for j in range(m):
            row = work[cross + a * m + j]
            for lane in range(pivot.size):
                row[lane] *= pivot[lane]


@_kernel
def blend(row, log_weight, cutoff, solutions, out):  # type: ignore[no-untyped-def]
    """Write (m,) the blended answer to `row`; give the support. 0: no field knows anything.

    cutoff: fields with a smaller log weight against the largest one are left out.
    """
    p, m = row.size, out.size
    cross = p * (p + 1) // 2
    largest = -np.inf
    for i in range(log_weight.size):
        if solutions.mass[i] > 0.0:
            largest = max(largest, log_weight[i])
    out[:] = 0.0
    if not largest > -np.inf:
        return 0.0
    total, leverage, counted = 0.0, 0.0, 0.0
    solved = np.empty(p)
    for i in range(log_weight.size):
        relative = log_weight[i] - largest
        if solutions.mass[i] > 0.0 and relative >= cutoff:
            weight = np.exp(relative)
            total += weight
            field = solutions.packed[i]
            for a in range(p):
                part = weight * row[a]
                for j in range(m):
                    out[j] += part * field[cross + a * m + j]
            if weight >= SUPPORT_CUTOFF:
                counted += weight
                leverage += weight * _leverage(row, field, solved)
    for j in range(m):
        out[j] /= total
    return counted / leverage


@_kernel
def _leverage(row, factor, solved):  # type: ignore[no-untyped-def]
    """x A⁻¹ xᵀ of (P,) x with A's packed factor."""
    square = 0.0
    solved[:] = row
    at = 0
    for a in range(row.size):
        value = solved[a] * factor[at]
        square += value * value
        for b in range(a + 1, row.size):
            solved[b] -= value * factor[at + b - a]
        at += row.size - a
    return square


# Receptive fields as the kernels want them: coordinate by coordinate, all fields side by side.


def geometry_of(fields: ReceptiveFields, middle: Vector, part: slice = slice(None)) -> Geometry:
    """Of some of the fields; centres count from (d,) `middle`."""
    centres, roots = fields.centres[part], fields.roots[part]
    used = np.abs(roots).max(axis=0, initial=0.0) > 0.0
    reach = np.array([1 + np.flatnonzero(row).max(initial=a) for a, row in enumerate(used)])
    return Geometry(
        np.ascontiguousarray((centres - middle).T),
        np.ascontiguousarray(roots.transpose(1, 2, 0)),
        reach.astype(np.int64),
    )


def log_weights_of(geometry: Geometry, places: Vector) -> Vector:
    """(f, n) ln w of (n, d) places, counted from the geometry's middle."""
    weights = np.empty((len(places), geometry.centres.shape[1]))
    log_weights(geometry, places, weights)
    return np.ascontiguousarray(weights.T)
