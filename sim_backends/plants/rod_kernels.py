"""The rod's numerics, compiled: local strains, the march from base to tip, its tangent, and the
small linear algebra of shooting; numpy's own overhead would be half of a step.

Strain is (shear, shear, stretch, bend, bend, twist), a wrench the force and moment that go with it,
quaternions are scalar first. Every function that is cached on disk stands in this one file: numba
notices a change only in the file of the cached function itself, so a kernel that called into
another file would go on running its old text.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ABSENT, TENDON, CHAMBER = 0, 1, 2

LEAST_STRETCH = 0.05
"""A body pressed to a twentieth of its length is no rod any more."""

_LOCAL_TOLERANCE = 1e-6
_LOCAL_ITERATIONS = 50
_LARGEST_CORRECTION = 0.5

_kernel = njit(cache=True, error_model="numpy")
"""error_model: a division by zero gives inf, which is looked for, and no exception."""

_inlined = njit(cache=True, error_model="numpy", forceinline=True)


class LoadedRod(NamedTuple):
    """A rod of N intervals with m routes, and what acts on it. All float64 and C-contiguous.

    step: (N,) length of each interval. stiffness: (N, 6) GA, GA, EA, EI, EI, GJ. rest: (N, 3, 6)
    strain without load at the start, middle and end of each interval. offset: (N, 3, m, 4) x, y,
    x', y' of each route at these places. kind: (N, m) int8 ABSENT, TENDON or CHAMBER. tension:
    (N, m), positive pulls. force: (N+1, 3) internal force at the nodes, base frame.
    """

    step: FloatArray
    stiffness: FloatArray
    rest: FloatArray
    offset: FloatArray
    kind: NDArray[np.int8]
    tension: FloatArray
    force: FloatArray


class March(NamedTuple):
    """A rod integrated from its base: not yet one that is in balance at its tip.

    position_mm (N+1, 3), quaternion (N+1, 4) and moment_nmm (N+1, 3) at the nodes; strain
    (N, 3, 6) at the start, middle and end of each interval; length_mm (m,) of each route.
    """

    position_mm: FloatArray
    quaternion: FloatArray
    moment_nmm: FloatArray
    strain: FloatArray
    length_mm: FloatArray


class ChamberDrive(NamedTuple):
    """m chambers on gas lines, with n sliders along each. Float64 and C-contiguous.

    presence: (N, m) 1 where a chamber is, else 0. The rest as in `gas.GasLines` and
    `hysteresis.StopOperators`; gauge pressure is what exceeds `ambient_mpa`.
    """

    presence: FloatArray
    amount: FloatArray
    in_chamber: FloatArray
    supply_mm3: FloatArray
    area_mm2: FloatArray
    kept: float
    ambient_mpa: float
    stiffness: FloatArray
    threshold_mm: FloatArray
    slider_mm: FloatArray


class Start(NamedTuple):
    """Where Newton's method begins: unknowns (3+m,), the strains of a march, and the response
    (3+m, 3+m) of its tip moment and route lengths to them."""

    unknowns: FloatArray
    strain: FloatArray
    response: FloatArray


class NewtonRule(NamedTuple):
    """It begins no further off than `close`, and ends below `tolerance` or after `iterations`.

    foundation: as for `unstable_directions`, N·mm/rad per mm.
    """

    close: float
    tolerance: float
    iterations: int
    foundation: float


class Settled(NamedTuple):
    """What `settle_chambers` has arrived at, all of it finite.

    march, unknowns (3+m,) and response (3+m, 3+m) as in `shooting.Equilibrium`, unstable as
    `unstable_directions` counts; of no meaning where it has not `converged`.
    """

    converged: bool
    march: March
    unknowns: FloatArray
    response: FloatArray
    unstable: int


@_kernel
def _rotation(q: FloatArray, r: FloatArray) -> None:
    """Rotation matrix of a quaternion of any length but zero."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    r[0, 0] = 1.0 - s * (y * y + z * z)
    r[0, 1] = s * (x * y - w * z)
    r[0, 2] = s * (x * z + w * y)
    r[1, 0] = s * (x * y + w * z)
    r[1, 1] = 1.0 - s * (x * x + z * z)
    r[1, 2] = s * (y * z - w * x)
    r[2, 0] = s * (x * z - w * y)
    r[2, 1] = s * (y * z + w * x)
    r[2, 2] = 1.0 - s * (x * x + y * y)


@_kernel
def _body_wrench(r: FloatArray, n: FloatArray, m: FloatArray, wrench: FloatArray) -> None:
    """Force and moment of the cross-section in its own frame."""
    for i in range(3):
        wrench[i] = r[0, i] * n[0] + r[1, i] * n[1] + r[2, i] * n[2]
        wrench[3 + i] = r[0, i] * m[0] + r[1, i] * m[1] + r[2, i] * m[2]


@_inlined
def _route(rod: LoadedRod, k: int, j: int, i: int, strain: FloatArray, along: FloatArray) -> float:
    """What one newton in route i adds to the wrench (`along`), and the route's length per mm.

    A tendon follows its own tangent g = v + u × r + r'. A chamber pushes along the normal of the
    cross-section: the volume that a rigid cross-section sweeps is its area times the normal part
    of g, so that part is the length that its pressure works on.
    """
    x, y = rod.offset[k, j, i, 0], rod.offset[k, j, i, 1]
    g2 = strain[2] + strain[3] * y - strain[4] * x
    if rod.kind[k, i] == CHAMBER:
        along[0], along[1], along[2] = 0.0, 0.0, 1.0
        along[3], along[4], along[5] = y, -x, 0.0
        return float(g2)
    g0 = strain[0] - strain[5] * y + rod.offset[k, j, i, 2]
    g1 = strain[1] + strain[5] * x + rod.offset[k, j, i, 3]
    length = np.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    t0, t1, t2 = g0 / length, g1 / length, g2 / length
    along[0], along[1], along[2] = t0, t1, t2
    along[3], along[4], along[5] = y * t2, -x * t2, x * t1 - y * t0
    return float(length)


@_inlined
def _add_tendon_stiffness(x: float, y: float, s: float, along: FloatArray, h: FloatArray) -> None:
    """A taut tendon resists being turned: s (D'D - along along'), D = dg/d(strain) = [1, -r×].

    s is the tension per length of g. Upper triangle only.
    """
    h[0, 0] += s
    h[1, 1] += s
    h[2, 2] += s
    h[0, 5] -= s * y
    h[1, 5] += s * x
    h[2, 3] += s * y
    h[2, 4] -= s * x
    h[3, 3] += s * y * y
    h[3, 4] -= s * x * y
    h[4, 4] += s * x * x
    h[5, 5] += s * (x * x + y * y)
    for a in range(6):
        for b in range(a, 6):
            h[a, b] -= s * along[a] * along[b]


@_inlined
def _imbalance(
    rod: LoadedRod,
    k: int,
    j: int,
    wrench: FloatArray,
    strain: FloatArray,
    along: FloatArray,
    residual: FloatArray,
    h: FloatArray,
) -> None:
    """What `wrench` exceeds the cross-section's resistance by, and its stiffness h (6, 6), of which
    the upper triangle is filled."""
    for a in range(6):
        residual[a] = wrench[a] - rod.stiffness[k, a] * (strain[a] - rod.rest[k, j, a])
        for b in range(6):
            h[a, b] = 0.0
        h[a, a] = rod.stiffness[k, a]
    for i in range(rod.kind.shape[1]):
        tension = rod.tension[k, i]
        if rod.kind[k, i] == ABSENT or tension == 0.0:
            continue
        length = _route(rod, k, j, i, strain, along)
        for a in range(6):
            residual[a] -= tension * along[a]
        if rod.kind[k, i] == TENDON:
            x, y = rod.offset[k, j, i, 0], rod.offset[k, j, i, 1]
            _add_tendon_stiffness(x, y, tension / length, along, h)


@_kernel
def _factor(h: FloatArray) -> bool:
    """L D L' of the upper triangle of h, in place: L below the diagonal, 1/D on it.

    False where h is not positive definite.
    """
    for a in range(6):
        pivot = h[a, a]
        if not pivot > 0.0:
            return False
        h[a, a] = 1.0 / pivot
        for b in range(a + 1, 6):
            h[b, a] = h[a, b] * h[a, a]
            for c in range(b, 6):
                h[b, c] -= h[b, a] * h[a, c]
    return True


@_kernel
def _solve(h: FloatArray, x: FloatArray) -> None:
    """Solve in place with the factors of `_factor`."""
    for a in range(1, 6):
        for c in range(a):
            x[a] -= h[a, c] * x[c]
    for a in range(5, -1, -1):
        x[a] *= h[a, a]
        for c in range(a + 1, 6):
            x[a] -= h[c, a] * x[c]


@_inlined
def _strain_without_tendons(
    rod: LoadedRod, k: int, j: int, wrench: FloatArray, strain: FloatArray, along: FloatArray
) -> bool:
    """Chambers push alike whatever the strain is, so the strain follows at once. False: tendons."""
    for i in range(rod.kind.shape[1]):
        if rod.kind[k, i] == TENDON and rod.tension[k, i] != 0.0:
            return False
    for a in range(6):
        strain[a] = wrench[a] / rod.stiffness[k, a] + rod.rest[k, j, a]
    for i in range(rod.kind.shape[1]):
        if rod.kind[k, i] == CHAMBER:
            _route(rod, k, j, i, strain, along)
            for a in range(2, 5):
                strain[a] -= rod.tension[k, i] * along[a] / rod.stiffness[k, a]
    return True


@_inlined
def _solve_strain(
    rod: LoadedRod,
    k: int,
    j: int,
    wrench: FloatArray,
    strain: FloatArray,
    along: FloatArray,
    residual: FloatArray,
    h: FloatArray,
) -> bool:
    """The strain that balances `wrench`, by Newton from the guess in `strain`. False: none."""
    if _strain_without_tendons(rod, k, j, wrench, strain, along):
        return bool(strain[2] > LEAST_STRETCH)
    for _ in range(_LOCAL_ITERATIONS):
        _imbalance(rod, k, j, wrench, strain, along, residual, h)
        if not _factor(h):
            return False
        _solve(h, residual)
        size = 0.0
        for a in range(6):
            size += residual[a] * residual[a]
        size = np.sqrt(size)
        share = 1.0 if size <= _LARGEST_CORRECTION else _LARGEST_CORRECTION / size
        for a in range(6):
            strain[a] += share * residual[a]
        # Quadratic convergence: after a last correction this small the error is its square.
        if size <= _LOCAL_TOLERANCE:
            return bool(strain[2] > LEAST_STRETCH)
        if not size < np.inf:
            return False
    return False


@_kernel
def _slopes(
    n: FloatArray,
    r: FloatArray,
    q: FloatArray,
    strain: FloatArray,
    dp: FloatArray,
    dq: FloatArray,
    dm: FloatArray,
) -> None:
    """Derivatives along s of position, quaternion and moment, for internal force n."""
    for a in range(3):
        dp[a] = r[a, 0] * strain[0] + r[a, 1] * strain[1] + r[a, 2] * strain[2]
    u0, u1, u2 = 0.5 * strain[3], 0.5 * strain[4], 0.5 * strain[5]
    dq[0] = -q[1] * u0 - q[2] * u1 - q[3] * u2
    dq[1] = q[0] * u0 + q[2] * u2 - q[3] * u1
    dq[2] = q[0] * u1 + q[3] * u0 - q[1] * u2
    dq[3] = q[0] * u2 + q[1] * u1 - q[2] * u0
    dm[0] = n[1] * dp[2] - n[2] * dp[1]
    dm[1] = n[2] * dp[0] - n[0] * dp[2]
    dm[2] = n[0] * dp[1] - n[1] * dp[0]


@_kernel
def _advance(here: FloatArray, h: float, slopes: FloatArray, there: FloatArray) -> None:
    """One Runge-Kutta step of order 4 for one part of the state."""
    for a in range(here.shape[0]):
        middle = slopes[1, a] + slopes[2, a]
        there[a] = here[a] + h / 6.0 * (slopes[0, a] + 2.0 * middle + slopes[3, a])


@_kernel
def _to_unit_length(q: FloatArray) -> bool:
    """False where q is no rotation."""
    norm = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for a in range(4):
        q[a] /= norm
    return bool(0.0 < norm < np.inf)


@_kernel
def march(rod: LoadedRod, base_moment: FloatArray, out: March) -> bool:
    """Integrate the rod from its clamped base, by Runge-Kutta of order 4. False: no such rod.

    base_moment (3,). `out` is filled; its strain is the guess for the local strains on entry.
    """
    r, h = np.empty((3, 3)), np.empty((6, 6))
    wrench, along, residual = np.empty(6), np.empty(6), np.empty(6)
    q, m, n = np.empty(4), np.empty(3), np.empty(3)
    dp, dq, dm = np.zeros((4, 3)), np.zeros((4, 4)), np.zeros((4, 3))
    for a in range(3):
        out.position_mm[0, a] = 0.0
        out.moment_nmm[0, a] = base_moment[a]
    for a in range(4):
        out.quaternion[0, a] = 1.0 if a == 0 else 0.0
    for i in range(rod.kind.shape[1]):
        out.length_mm[i] = 0.0
    for k in range(rod.step.shape[0]):
        step = rod.step[k]
        for stage in range(4):
            j = (stage + 1) // 2
            last, reach = max(stage - 1, 0), 0.5 * step * min(stage, 1) * max(j, 1)
            for a in range(3):
                m[a] = out.moment_nmm[k, a] + reach * dm[last, a]
                n[a] = rod.force[k, a] + 0.5 * j * (rod.force[k + 1, a] - rod.force[k, a])
            for a in range(4):
                q[a] = out.quaternion[k, a] + reach * dq[last, a]
            _rotation(q, r)
            _body_wrench(r, n, m, wrench)
            strain = out.strain[k, j]
            if not _solve_strain(rod, k, j, wrench, strain, along, residual, h):
                return False
            _slopes(n, r, q, strain, dp[stage], dq[stage], dm[stage])
            weight = step / (6.0 if stage == 0 or stage == 3 else 3.0)
            for i in range(rod.kind.shape[1]):
                if rod.kind[k, i] != ABSENT:
                    out.length_mm[i] += weight * _route(rod, k, j, i, strain, along)
        _advance(out.position_mm[k], step, dp, out.position_mm[k + 1])
        _advance(out.moment_nmm[k], step, dm, out.moment_nmm[k + 1])
        _advance(out.quaternion[k], step, dq, out.quaternion[k + 1])
        if not _to_unit_length(out.quaternion[k + 1]):
            return False
    return True


@_kernel
def _multiply(a: FloatArray, b: FloatArray, columns: int, out: FloatArray) -> None:
    """out = a b, of b the first columns, for matrices too small to be worth a call of BLAS."""
    for i in range(a.shape[0]):
        for j in range(columns):
            out[i, j] = a[i, 0] * b[0, j]
        for c in range(1, a.shape[1]):
            for j in range(columns):
                out[i, j] += a[i, c] * b[c, j]


@_kernel
def _fill(out: FloatArray, value: float) -> None:
    """All elements; slice assignment would take numba seconds longer to compile."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = value


@_kernel
def _copy(a: FloatArray, out: FloatArray) -> None:
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = a[i, j]


@_kernel
def _add(out: FloatArray, h: float, a: FloatArray) -> None:
    """out += h a."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] += h * a[i, j]


@_kernel
def _integral(
    h: float,
    generator: FloatArray,
    state: FloatArray,
    source: FloatArray,
    columns: int,
    slope: FloatArray,
    scratch: FloatArray,
    out: FloatArray,
) -> None:
    """∫ X over an interval of length h, for X' = generator X + source from X = state; the first
    columns of it.

    The series h X + h²/2 D + h³/6 A D + h⁴/24 A² D with D = A X + source, D the first slope.
    """
    _multiply(generator, state, columns, slope)
    for a in range(6):
        for b in range(columns):
            slope[a, b] += source[a, b]
            scratch[a, b] = h / 4.0 * slope[a, b]
    for order in (3.0, 2.0):
        _multiply(generator, scratch, columns, out)
        for a in range(6):
            for b in range(columns):
                scratch[a, b] = h / order * (slope[a, b] + out[a, b])
    for a in range(6):
        for b in range(columns):
            out[a, b] = h * (state[a, b] + scratch[a, b])


@_kernel
def _cross_columns(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Each column of out (3, c) = a × the column of b."""
    for j in range(b.shape[1]):
        out[0, j] = a[1] * b[2, j] - a[2] * b[1, j]
        out[1, j] = a[2] * b[0, j] - a[0] * b[2, j]
        out[2, j] = a[0] * b[1, j] - a[1] * b[0, j]


@_kernel
def _compliance(r: FloatArray, h: FloatArray, column: FloatArray, out: FloatArray) -> None:
    """Inverse of a cross-section's stiffness, whose factor is h, turned into the base frame."""
    for i in range(6):
        for a in range(3):
            column[a] = r[i, a] if i < 3 else 0.0
            column[3 + a] = 0.0 if i < 3 else r[i - 3, a]
        _solve(h, column)
        for a in range(3):
            out[a, i] = r[a, 0] * column[0] + r[a, 1] * column[1] + r[a, 2] * column[2]
            out[3 + a, i] = r[a, 0] * column[3] + r[a, 1] * column[4] + r[a, 2] * column[5]


@_kernel
def _wrench_by_turn(n: FloatArray, m: FloatArray, out: FloatArray) -> None:
    """(n × φ, δm + m × φ) as a matrix on (φ, δm): what the body's frame sees, in the base frame."""
    _fill(out, 0.0)
    for block, w in ((0, n), (3, m)):
        out[block, 1], out[block, 2] = -w[2], w[1]
        out[block + 1, 0], out[block + 1, 2] = w[2], -w[0]
        out[block + 2, 0], out[block + 2, 1] = -w[1], w[0]
    for a in range(3, 6):
        out[a, a] = 1.0


class Middle(NamedTuple):
    """In the middle of an interval, in the base frame: quaternion and rotation (3, 3), force,
    moment and tangent (3,), and what the routes push (6, m); along (6,) is room for one of them."""

    quaternion: FloatArray
    rotation: FloatArray
    force: FloatArray
    moment: FloatArray
    tangent: FloatArray
    along: FloatArray
    pushes: FloatArray


class Section(NamedTuple):
    """Of an interval: kind (m,) of its routes, what they push (6, m), how the strain answers to a
    turn and a moment (6, 6), and to what they push (6, m)."""

    kind: NDArray[np.int8]
    pushes: FloatArray
    strains: FloatArray
    answers: FloatArray


@_kernel
def _middle(rod: LoadedRod, k: int, path: March, middle: Middle) -> None:
    """What `Middle` holds of interval k."""
    q, r, n, m, v, along, pushes = middle
    for a in range(4):
        q[a] = path.quaternion[k, a] + path.quaternion[k + 1, a]
    _rotation(q, r)
    strain = path.strain[k, 1]
    for a in range(3):
        n[a] = 0.5 * (rod.force[k, a] + rod.force[k + 1, a])
        m[a] = 0.5 * (path.moment_nmm[k, a] + path.moment_nmm[k + 1, a])
        v[a] = r[a, 0] * strain[0] + r[a, 1] * strain[1] + r[a, 2] * strain[2]
    _fill(pushes, 0.0)
    for i in range(rod.kind.shape[1]):
        if rod.kind[k, i] != ABSENT:
            _route(rod, k, 1, i, strain, along)
            for a in range(3):
                for b in range(3):
                    pushes[a, i] += r[a, b] * along[b]
                    pushes[3 + a, i] += r[a, b] * along[3 + b]


@_kernel
def _generator(
    n: FloatArray, v: FloatArray, strains: FloatArray, scratch: FloatArray, out: FloatArray
) -> None:
    """d/ds of (φ, δm), as a matrix on (φ, δm): φ' = δu and δm' = n × (δv + φ × v)."""
    _copy(strains[3:], out[:3])
    _copy(strains[:3], scratch)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        scratch[b, a] -= v[c]
        scratch[c, a] += v[b]
    _cross_columns(n, scratch, out[3:])


@_kernel
def _exponential(h: float, a: FloatArray, scratch: FloatArray, out: FloatArray) -> None:
    """exp(h a) to the fourth order: two orders more than the midpoint has, which costs little and
    removes most of the error in the stability of a rod that has buckled."""
    for i in range(6):
        for j in range(6):
            out[i, j] = h / 4.0 * a[i, j]
        out[i, i] += 1.0
    for order in (3.0, 2.0, 1.0):
        _multiply(a, out, 6, scratch)
        for i in range(6):
            for j in range(6):
                out[i, j] = h / order * scratch[i, j]
            out[i, i] += 1.0


@_kernel
def _add_lengthening(
    h: float,
    section: Section,
    spread: FloatArray,
    integral: FloatArray,
    columns: int,
    change: FloatArray,
    response: FloatArray,
) -> None:
    """Lengthening of the routes over an interval: what each pushes, times the change of strain."""
    kind, pushes, strains, answers = section
    _multiply(strains, integral, columns, change)
    for i in range(columns - 3):
        for a in range(6):
            change[a, 3 + i] -= h * answers[a, i] * spread[i]
    for i in range(columns - 3):
        if kind[i] != ABSENT:
            for a in range(6):
                for b in range(columns):
                    response[3 + i, b] += pushes[a, i] * change[a, b]


@_kernel
def tangent(
    rod: LoadedRod, spread: FloatArray, path: March, response: FloatArray, transfer: FloatArray
) -> bool:
    """How a marched rod answers to small changes, by the midpoint rule. False: no such rod.

    spread (N, m): change of the tension in each interval per newton of each route's pull.
    Filled: response (3+m, 3+m), d(tip moment, route lengths) / d(base moment, pulls); transfer
    (N, 6, 6), which takes a turn φ and a change of moment δm, both in the base frame, from node to
    node. With C the compliance of the cross-section and b what a route pushes, the change of strain
    is C (n × φ, δm + m × φ) - C b δτ. Columns of routes that are still to begin stay zero and are
    left out.
    """
    routes, width = rod.kind.shape[1], 3 + rod.kind.shape[1]
    r, h, c, turned = np.empty((3, 3)), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    q, n, m, v, along = np.empty(4), np.empty(3), np.empty(3), np.empty(3), np.empty(6)
    wrench, unused, scratch = np.zeros(6), np.empty(6), np.empty((6, width))
    strains, generator = np.empty((6, 6)), np.empty((6, 6))
    pushes, answers = np.empty((6, routes)), np.zeros((6, routes))
    middle = Middle(q, r, n, m, v, along, pushes)
    state, source = np.zeros((6, width)), np.zeros((6, width))
    slope, integral = np.zeros((6, width)), np.empty((6, width))
    state[3, 0] = state[4, 1] = state[5, 2] = 1.0
    columns = 3
    _fill(response, 0.0)
    for k in range(rod.step.shape[0]):
        for i in range(columns - 3, routes):
            if rod.kind[k, i] != ABSENT:
                columns = 4 + i
        _middle(rod, k, path, middle)
        _imbalance(rod, k, 1, wrench, path.strain[k, 1], along, unused, h)
        if not _factor(h):
            return False
        _compliance(r, h, along, c)
        _wrench_by_turn(n, m, turned)
        _multiply(c, turned, 6, strains)
        _multiply(c, pushes, columns - 3, answers)
        _generator(n, v, strains, turned[:3], generator)
        _exponential(rod.step[k], generator, turned, transfer[k])
        _copy(answers[3:], source[:3, 3:])
        _cross_columns(n, answers[:3], source[3:, 3:])
        for i in range(routes):
            for a in range(6):
                source[a, 3 + i] *= -spread[k, i]
        _integral(rod.step[k], generator, state, source, columns, slope, scratch, integral)
        _multiply(generator, integral, columns, slope)
        _add(state, 1.0, slope)
        _add(state, rod.step[k], source)
        section = Section(rod.kind[k], pushes, strains, answers)
        _add_lengthening(rod.step[k], section, spread[k], integral, columns, slope, response)
    _copy(state[3:], response[:3])
    return True


@_kernel
def _negative_pivots(a: FloatArray) -> int:
    """Number of negative eigenvalues of the symmetric part of a (3, 3), by Sylvester's law."""
    b01, b02 = 0.5 * (a[0, 1] + a[1, 0]), 0.5 * (a[0, 2] + a[2, 0])
    b12 = 0.5 * (a[1, 2] + a[2, 1])
    d0 = a[0, 0]
    d1 = a[1, 1] - b01 * b01 / d0
    c12 = b12 - b01 * b02 / d0
    d2 = a[2, 2] - b02 * b02 / d0 - c12 * c12 / d1
    return int(not (d0 > 0.0)) + int(not (d1 > 0.0)) + int(not (d2 > 0.0))


@_kernel
def _divide(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """out = a⁻¹ b for (3, 3) matrices, by cofactors."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        determinant = 0.0
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            determinant += a[0, j] * (a[1, j1] * a[2, j2] - a[1, j2] * a[2, j1])
        for c in range(3):
            total = 0.0
            for j in range(3):
                j1, j2 = (j + 1) % 3, (j + 2) % 3
                total += (a[j1, i1] * a[j2, i2] - a[j1, i2] * a[j2, i1]) * b[j, c]
            out[i, c] = total / determinant


@_kernel
def unstable_directions(step: FloatArray, transfer: FloatArray, foundation: float) -> int:
    """Number of independent ways in which the rod would rather turn away (its Morse index).

    transfer (N, 6, 6) as `tangent` fills it, tensions and forces held. The energy's second
    variation is a chain of elements between nodes; eliminating node after node from the free tip
    down to the clamped base leaves a 3 × 3 pivot each, and as many negative directions as the
    pivots have negative eigenvalues. `behind` is the stiffness that a node feels from the tip side.
    foundation, N·mm/rad per mm, is added everywhere: more negative than this is unstable.
    """
    behind, pivot = np.zeros((3, 3)), np.empty((3, 3))
    product, negative = np.empty((3, 3)), 0
    for k in range(transfer.shape[0] - 1, -1, -1):
        for a in range(3):
            behind[a, a] += step[k] * foundation
        turn, bend = transfer[k, :3, :3], transfer[k, :3, 3:]
        _multiply(behind, bend, 3, pivot)
        _add(pivot, 1.0, transfer[k, 3:, 3:])
        _multiply(bend.T, pivot, 3, product)
        negative += _negative_pivots(product)
        _multiply(behind, turn, 3, product)
        _add(product, 1.0, transfer[k, 3:, :3])
        _divide(pivot, product, behind)
    return negative


@_kernel
def newton_step(
    response: FloatArray, by_length: FloatArray, by_pull: FloatArray, residual: FloatArray
) -> FloatArray:
    """Newton's step for (base moment, pulls). Not finite where the Jacobian is singular.

    The residual is the tip's moment (3,) and the drives' imbalance (m,); response (3+m, 3+m) gives
    tip moment and lengths by the unknowns, by_length and by_pull (m, m) the imbalance by these.
    """
    size, first = residual.shape[0], residual.shape[0] - by_pull.shape[0]
    a, x = np.empty((size, size)), -residual
    for i in range(first):
        for j in range(size):
            a[i, j] = response[i, j]
    for i in range(size - first):
        for j in range(size):
            a[first + i, j] = by_pull[i, j - first] if j >= first else 0.0
        for k in range(size - first):
            share = by_length[i, k]
            if share != 0.0:
                for j in range(size):
                    a[first + i, j] += share * response[first + k, j]
    for c in range(size):
        pivot = c
        for i in range(c + 1, size):
            if abs(a[i, c]) > abs(a[pivot, c]):
                pivot = i
        for j in range(c, size):
            a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
        x[c], x[pivot] = x[pivot], x[c]
        for i in range(c + 1, size):
            factor = a[i, c] / a[c, c]
            for j in range(c + 1, size):
                a[i, j] -= factor * a[c, j]
            x[i] -= factor * x[c]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]
    return x


@_kernel
def broyden(
    response: FloatArray, step: FloatArray, change: FloatArray, scale: FloatArray
) -> FloatArray:
    """`response` with the least change, in scaled unknowns, that explains what `step` changed."""
    size = step.shape[0]
    norm = 0.0
    for j in range(size):
        norm += (scale[j] * step[j]) ** 2
    out = np.empty((size, size))
    for i in range(size):
        missing = change[i]
        for j in range(size):
            missing -= response[i, j] * step[j]
        for j in range(size):
            out[i, j] = response[i, j] + missing * scale[j] * scale[j] * step[j] / norm
    return out


@_kernel
def _chamber_imbalance(
    drive: ChamberDrive,
    length_mm: FloatArray,
    unknowns: FloatArray,
    residual: FloatArray,
    by_length: FloatArray,
) -> None:
    """Of each chamber, behind the tip's moment in `residual`: its pull minus what gas and sliders
    pull with, N. The derivative of this by the lengths is by_length (m, m), whose diagonal is set.
    """
    for i in range(length_mm.shape[0]):
        length, area = length_mm[i], drive.area_mm2[i]
        held = drive.kept * drive.in_chamber[i] / (area * length)
        whole_mm3 = drive.supply_mm3[i] + area * length
        shared = (1.0 - drive.kept) * drive.amount[i] / whole_mm3
        slope = -held / length - shared * area / whole_mm3
        force, stiffness = 0.0, 0.0
        for j in range(drive.threshold_mm.shape[0]):
            stretch, reach = length - drive.slider_mm[i, j], drive.threshold_mm[j]
            stopped = min(max(stretch, -reach), reach)
            force += drive.stiffness[i, j] * stopped
            if stretch == stopped:
                stiffness += drive.stiffness[i, j]
        residual[3 + i] = unknowns[3 + i] + (held + shared - drive.ambient_mpa) * area - force
        by_length[i, i] = slope * area - stiffness


@_kernel
def _try_chambers(
    rod: LoadedRod,
    drive: ChamberDrive,
    scale: FloatArray,
    unknowns: FloatArray,
    guess: FloatArray,
    out: March,
    residual: FloatArray,
    by_length: FloatArray,
) -> float:
    """March with such unknowns, from the strains of `guess`. Returns the error as `scale` weighs
    it; infinite: there is no such rod."""
    for k in range(rod.tension.shape[0]):
        for i in range(rod.tension.shape[1]):
            rod.tension[k, i] = drive.presence[k, i] * unknowns[3 + i]
        for j in range(3):
            for a in range(6):
                out.strain[k, j, a] = guess[k, j, a]
    if not march(rod, unknowns[:3], out):
        return float(np.inf)
    for a in range(3):
        residual[a] = out.moment_nmm[-1, a]
    _chamber_imbalance(drive, out.length_mm, unknowns, residual, by_length)
    error = 0.0
    for a in range(residual.shape[0]):
        part = abs(residual[a] * scale[a])
        if not part < np.inf:
            return float(np.inf)
        error = max(error, part)
    return float(error)


@_kernel
def _room_for(rod: LoadedRod) -> March:
    """Arrays for a march, not filled."""
    intervals, routes = rod.kind.shape
    return March(
        np.empty((intervals + 1, 3)),
        np.empty((intervals + 1, 4)),
        np.empty((intervals + 1, 3)),
        np.empty((intervals, 3, 6)),
        np.empty(routes),
    )


@_kernel
def settle_chambers(
    rod: LoadedRod,
    drive: ChamberDrive,
    scale: FloatArray,
    start: Start,
    rule: NewtonRule,
) -> Settled:
    """Newton's method as in `shooting.Solver`, as long as every step is a good one.

    Broyden's formula keeps the response up to date. rod.tension is overwritten.
    """
    unknowns, guess, response = start
    close, tolerance, iterations, foundation = rule
    size, routes = unknowns.shape[0], rod.kind.shape[1]
    here, there = _room_for(rod), _room_for(rod)
    change = np.empty(size)
    residual, moved = np.empty(size), np.empty(size)
    by_length, moved_by_length = np.zeros((routes, routes)), np.zeros((routes, routes))
    by_pull = np.eye(routes)
    error = _try_chambers(rod, drive, scale, unknowns, guess, here, residual, by_length)
    if error > close:
        return Settled(False, here, unknowns, response, 0)
    for _ in range(iterations):
        if error <= tolerance:
            answer, transfer = np.empty((size, size)), np.empty((rod.step.shape[0], 6, 6))
            if not tangent(rod, drive.presence, here, answer, transfer):
                break
            total = 0.0
            for a in range(size):
                for b in range(size):
                    total += abs(answer[a, b])
            if not total < np.inf:
                break
            unstable = unstable_directions(rod.step, transfer, foundation)
            return Settled(True, here, unknowns, answer, unstable)
        step = newton_step(response, by_length, by_pull, residual)
        better = unknowns + step
        left = _try_chambers(rod, drive, scale, better, here.strain, there, moved, moved_by_length)
        if not left <= 0.3 * error:
            break
        for a in range(3):
            change[a] = moved[a] - residual[a]
        for i in range(routes):
            change[3 + i] = there.length_mm[i] - here.length_mm[i]
        response = broyden(response, better - unknowns, change, scale)
        here, there, unknowns, error = there, here, better, left
        residual, moved = moved, residual
        by_length, moved_by_length = moved_by_length, by_length
    return Settled(False, here, unknowns, response, 0)
