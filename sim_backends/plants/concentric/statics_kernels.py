"""Statics of precurved tubes in each other, compiled.

All tubes share one centre line, whose frame R does not twist (Bishop: u has no z). Tube i stands in
it at angle ψ, turns by w = ψ' per length and would alone bend with κ about its own x axis:

    p' = R e3,  R' = R û,  M' = -u × M - e3 × Rᵀn
    u = (M_xy + Σ c (cos ψ, sin ψ)) / Σ EI,  GJ w' = c (u_x sin ψ - u_y cos ψ),  c = EI κ
    ψ(0) = α + ℓ w(0),  w = 0 at a tube's end,  M = 0 at the last

n is the internal force, known under dead loads; M the internal moment in the frame R, its z part
Σ GJ w; ℓ the length behind the mouth over which a tube can twist (Rucker, Jones and Webster, T-RO
26, 2010, in total-wrench form). Unknown are w(0) of every tube and M_xy(0). Without loads M is zero
and the twist does not need the frame: n - 1 unknowns. A determinant of d(ends) / d(unknowns) that
is positive, and 1 for short tubes, vanishes where a branch of equilibria ends: there they snap.

Units are mm, N, N·mm and rad, quaternions scalar first. Every function that is cached on disk
stands in this one file: numba notices a change only in the file of the cached function itself.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME_PLACE_MM = 1e-6
"""Cuts closer to each other than this are one."""
_CLOSE_RAD = 1e-5
"""A Newton step that turns no tube by more is the last one: what remains is its square."""
_LONGEST_STEP_RAD = 0.5
_CONTRACTION = 0.5
_GENTLY_RAD = 0.01
"""Where tubes turn by less than this from one row of a sweep to the next, the one after it is
looked for as much further: what is left to find is the square of that."""
_SWEPT = 10
"""Steps of Newton's method from one row of a sweep to the next; thrice as many from nothing."""

_kernel = njit(cache=True, error_model="numpy")
"""error_model: a division by zero gives inf, which is looked for, and no exception."""

_inlined = njit(cache=True, error_model="numpy", forceinline=True)


class TubeSet(NamedTuple):
    """n tubes, outermost first, of up to S sections each. All float64 and C-contiguous.

    end_mm: (n, S) where each section ends, from the tube's collar; those that a tube does not have
    repeat its last. curvature_per_mm: (n, S). bending_n_mm2, torsion_n_mm2: (n,) EI and GJ.
    weight_n_mm: (n,) per length.
    """

    end_mm: FloatArray
    curvature_per_mm: FloatArray
    bending_n_mm2: FloatArray
    torsion_n_mm2: FloatArray
    weight_n_mm: FloatArray


class Layout(NamedTuple):
    """The tubes pushed into each other, cut into N intervals wherever one changes.

    node_mm: (N+1,) from the mouth. bending_n_mm2: (N,) of all that are there. curved_nmm: (N, n)
    EI κ, 0 where a tube is not. torsion_n_mm2: (N, n), likewise. force_n: (N, 2, 3) internal force
    at the start and the end of each interval, base frame. twist_length_mm: (n,). contact: (n, S)
    the node at which a section ends, -1 behind the mouth; partner: (n, S) the tube that rubs there,
    -1: none. tip_node: where the innermost tube ends. last: the tube that ends last.
    """

    node_mm: FloatArray
    bending_n_mm2: FloatArray
    curved_nmm: FloatArray
    torsion_n_mm2: FloatArray
    force_n: FloatArray
    twist_length_mm: FloatArray
    contact: IntArray
    partner: IntArray
    tip_node: int
    last: int


class Friction(NamedTuple):
    """Dry friction between two tubes where a section of one ends.

    slider_rad: (n, S) the angle between the two at which none acts. bound_nmm: what slips.
    stiffness_nmm_rad: before it slips.
    """

    slider_rad: FloatArray
    bound_nmm: float
    stiffness_nmm_rad: float


class Drag(NamedTuple):
    """A resistance against turning away from a past shape, as a thick fluid between the tubes has.

    past_rad: (N, 3, n) angles at the start, middle and end of each interval. stiffness_n: N·mm/rad
    per mm; 0: none.
    """

    past_rad: FloatArray
    stiffness_n: float


class March(NamedTuple):
    """The tubes integrated from the mouth, at the N+1 nodes.

    position_mm (N+1, 3), quaternion (N+1, 4) of R, angle_rad and twist_rad_mm (N+1, n), the last
    two as they were at its end for a tube that has ended; moment_nmm (N+1, 2) of M.
    """

    position_mm: FloatArray
    quaternion: FloatArray
    angle_rad: FloatArray
    twist_rad_mm: FloatArray
    moment_nmm: FloatArray


class Settled(NamedTuple):
    """Where Newton's method has arrived. base: (n+2,) w(0), then M_xy(0).

    The rest has no meaning where it has not converged."""

    converged: bool
    base: FloatArray
    determinant: float
    march: March


@_kernel
def _cuts(tubes: TubeSet, collar_mm: FloatArray) -> FloatArray:
    """Places in front of the mouth where a section ends, in order, and 0."""
    count, sections = tubes.end_mm.shape
    cuts = np.zeros(1 + count * sections)
    found = 1
    for i in range(count):
        for j in range(sections):
            place = collar_mm[i] + tubes.end_mm[i, j]
            if place <= _SAME_PLACE_MM:
                continue
            k = found
            while cuts[k - 1] > place:
                k -= 1
            if place - cuts[k - 1] <= _SAME_PLACE_MM:
                continue
            if k < found and cuts[k] - place <= _SAME_PLACE_MM:
                continue
            for m in range(found, k, -1):
                cuts[m] = cuts[m - 1]
            cuts[k] = place
            found += 1
    return cuts[:found]


@_kernel
def _node_of(node_mm: FloatArray, place_mm: float) -> int:
    """The node at a place; -1 behind the mouth."""
    if place_mm <= _SAME_PLACE_MM:
        return -1
    for k in range(1, node_mm.shape[0]):
        if node_mm[k] > place_mm - 2.0 * _SAME_PLACE_MM:
            return k
    return int(node_mm.shape[0] - 1)


@_kernel
def _partner_of(tubes: TubeSet, collar_mm: FloatArray, i: int, j: int) -> int:
    """Whom a tube rubs on where its section j ends: at its end the tube within, at a change of its
    curvature the one round it, where there is one. -1: nobody."""
    count, sections = tubes.end_mm.shape
    place = collar_mm[i] + tubes.end_mm[i, j] - _SAME_PLACE_MM
    ends = tubes.end_mm[i, j] >= tubes.end_mm[i, sections - 1]
    if ends and j > 0 and tubes.end_mm[i, j - 1] >= tubes.end_mm[i, j]:
        return -1  # a section that the tube does not have
    if not ends and i > 0 and collar_mm[i - 1] + tubes.end_mm[i - 1, sections - 1] > place:
        return i - 1
    if i + 1 < count and collar_mm[i + 1] + tubes.end_mm[i + 1, sections - 1] > place:
        return i + 1
    return -1


@_kernel
def _add_forces(
    tubes: TubeSet, collar_mm: FloatArray, tip_n: FloatArray, down: FloatArray, layout: Layout
) -> None:
    """Fill the internal force: what hangs on the innermost tube's tip, and the tubes' weight."""
    sections = tubes.end_mm.shape[1]
    for k in range(layout.bending_n_mm2.shape[0]):
        for side in range(2):
            weight = 0.0
            for i in range(collar_mm.shape[0]):
                left = collar_mm[i] + tubes.end_mm[i, sections - 1] - layout.node_mm[k + side]
                weight += tubes.weight_n_mm[i] * max(left, 0.0)
            for a in range(3):
                held = tip_n[a] if k < layout.tip_node else 0.0
                layout.force_n[k, side, a] = held + weight * down[a]


@_kernel
def lay_out(
    tubes: TubeSet,
    collar_mm: FloatArray,
    twisting: bool,
    tip_n: FloatArray,
    down: FloatArray,
    interval_mm: float,
) -> Layout:
    """Tubes with their collars at collar_mm (n,), none in front of the mouth and at least one
    reaching out of it. twisting: they twist between collar and mouth. down: unit vector (3,).
    interval_mm: about the longest."""
    count, sections = tubes.end_mm.shape
    cuts = _cuts(tubes, collar_mm)
    intervals = 0
    for c in range(1, cuts.shape[0]):
        intervals += int(np.ceil((cuts[c] - cuts[c - 1]) / interval_mm - 1e-9))
    node = np.empty(intervals + 1)
    bending, curved = np.zeros(intervals), np.zeros((intervals, count))
    torsion, force = np.zeros((intervals, count)), np.zeros((intervals, 2, 3))
    node[0] = 0.0
    k = 0
    for c in range(1, cuts.shape[0]):
        pieces = int(np.ceil((cuts[c] - cuts[c - 1]) / interval_mm - 1e-9))
        middle = 0.5 * (cuts[c] + cuts[c - 1])
        for piece in range(pieces):
            node[k + 1] = cuts[c - 1] + (cuts[c] - cuts[c - 1]) * (piece + 1) / pieces
            for i in range(count):
                j = 0
                while j < sections and collar_mm[i] + tubes.end_mm[i, j] <= middle:
                    j += 1
                if j < sections:
                    bending[k] += tubes.bending_n_mm2[i]
                    curved[k, i] = tubes.bending_n_mm2[i] * tubes.curvature_per_mm[i, j]
                    torsion[k, i] = tubes.torsion_n_mm2[i]
            k += 1
    contact, partner = np.empty((count, sections), np.int64), np.empty((count, sections), np.int64)
    twist_length, last = np.zeros(count), count - 1
    for i in range(count):
        if twisting:
            twist_length[i] = -collar_mm[i]
        reach = collar_mm[i] + tubes.end_mm[i, sections - 1]
        if reach > collar_mm[last] + tubes.end_mm[last, sections - 1] + _SAME_PLACE_MM:
            last = i
        for j in range(sections):
            contact[i, j] = _node_of(node, collar_mm[i] + tubes.end_mm[i, j])
            partner[i, j] = _partner_of(tubes, collar_mm, i, j)
    tip_node = max(contact[count - 1, sections - 1], 0)
    layout = Layout(
        node, bending, curved, torsion, force, twist_length, contact, partner, tip_node, last
    )
    _add_forces(tubes, collar_mm, tip_n, down, layout)
    return layout


@_kernel
def _directions(
    layout: Layout, k: int, angle: FloatArray, sine: FloatArray, cosine: FloatArray
) -> tuple[float, float]:
    """Fill sine and cosine (n,) of the curved tubes' angles, and return Σ c cos ψ and Σ c sin ψ."""
    along, across = 0.0, 0.0
    for i in range(sine.shape[0]):
        curved = layout.curved_nmm[k, i]
        if curved != 0.0:
            sine[i], cosine[i] = np.sin(angle[i]), np.cos(angle[i])
            along += curved * cosine[i]
            across += curved * sine[i]
        else:
            sine[i], cosine[i] = 0.0, 0.0
    return along, across


@_inlined
def _turning(
    layout: Layout,
    k: int,
    share: FloatArray,
    angle: FloatArray,
    changes: FloatArray,
    columns: int,
    sine: FloatArray,
    cosine: FloatArray,
    out: FloatArray,
    out_changes: FloatArray,
) -> None:
    """w' of all tubes without loads, and its changes (columns, n) with those of the angles.

    share: (n,) c / (GJ Σ EI).
    """
    count = sine.shape[0]
    along, across = _directions(layout, k, angle, sine, cosine)
    for i in range(count):
        out[i] = share[i] * (sine[i] * along - cosine[i] * across)
    for b in range(columns):
        by_along, by_across = 0.0, 0.0
        for i in range(count):
            curved = layout.curved_nmm[k, i] * changes[b, i]
            by_along -= curved * sine[i]
            by_across += curved * cosine[i]
        for i in range(count):
            own = (cosine[i] * along + sine[i] * across) * changes[b, i]
            out_changes[b, i] = share[i] * (own + sine[i] * by_along - cosine[i] * by_across)


@_kernel
def _twist_free(
    layout: Layout,
    rotation: FloatArray,
    twist: FloatArray,
    residual: FloatArray,
    by_twist: FloatArray,
) -> None:
    """The twist left at the ends of all tubes but the last, residual (n-1,), and its derivative by
    their twist at the mouth, without loads. By Nyström's method of order 4 for ψ'' = f(ψ).

    rotation: (n,) of the tubes at their collars. twist: (n,) at the mouth, of no moment in all.
    """
    count = rotation.shape[0]
    columns = count - 1
    angle, rate = np.empty(count), twist.copy()
    change, rates = np.zeros((columns, count)), np.zeros((columns, count))
    at, ats = np.empty(count), np.empty((columns, count))
    one, two, three = np.empty(count), np.empty(count), np.empty(count)
    ones, twos = np.empty((columns, count)), np.empty((columns, count))
    threes, share = np.empty((columns, count)), np.empty(count)
    sine, cosine = np.empty(count), np.empty(count)
    for i in range(count):
        angle[i] = rotation[i] + layout.twist_length_mm[i] * twist[i]
    for b in range(columns):
        free = b if b < layout.last else b + 1
        rates[b, free] = 1.0
        rates[b, layout.last] = (
            -layout.torsion_n_mm2[0, free] / layout.torsion_n_mm2[0, layout.last]
        )
        for i in range(count):
            change[b, i] = layout.twist_length_mm[i] * rates[b, i]
    for k in range(layout.bending_n_mm2.shape[0]):
        h, curved = layout.node_mm[k + 1] - layout.node_mm[k], 0
        for i in range(count):
            curved += layout.curved_nmm[k, i] != 0.0
            share[i] = 0.0
            if layout.torsion_n_mm2[k, i] > 0.0:
                stiffness = layout.torsion_n_mm2[k, i] * layout.bending_n_mm2[k]
                share[i] = layout.curved_nmm[k, i] / stiffness
        if curved < 2:  # nothing turns them
            for i in range(count):
                angle[i] += h * rate[i]
            for b in range(columns):
                for i in range(count):
                    change[b, i] += h * rates[b, i]
            continue
        _turning(layout, k, share, angle, change, columns, sine, cosine, one, ones)
        for i in range(count):
            at[i] = angle[i] + 0.5 * h * (rate[i] + 0.25 * h * one[i])
        for b in range(columns):
            for i in range(count):
                ats[b, i] = change[b, i] + 0.5 * h * (rates[b, i] + 0.25 * h * ones[b, i])
        _turning(layout, k, share, at, ats, columns, sine, cosine, two, twos)
        for i in range(count):
            at[i] = angle[i] + h * (rate[i] + 0.5 * h * two[i])
        for b in range(columns):
            for i in range(count):
                ats[b, i] = change[b, i] + h * (rates[b, i] + 0.5 * h * twos[b, i])
        _turning(layout, k, share, at, ats, columns, sine, cosine, three, threes)
        for i in range(count):
            angle[i] += h * (rate[i] + h / 6.0 * (one[i] + 2.0 * two[i]))
            rate[i] += h / 6.0 * (one[i] + 4.0 * two[i] + three[i])
        for b in range(columns):
            for i in range(count):
                change[b, i] += h * (rates[b, i] + h / 6.0 * (ones[b, i] + 2.0 * twos[b, i]))
                rates[b, i] += h / 6.0 * (ones[b, i] + 4.0 * twos[b, i] + threes[b, i])
    for a in range(columns):
        place = a if a < layout.last else a + 1
        residual[a] = rate[place]
        for b in range(columns):
            by_twist[a, b] = rates[b, place]


@_inlined
def _slopes(
    layout: Layout,
    k: int,
    drag: Drag,
    stage: int,
    state: FloatArray,
    force: FloatArray,
    changes: FloatArray,
    columns: int,
    sine: FloatArray,
    cosine: FloatArray,
    out: FloatArray,
    out_changes: FloatArray,
) -> tuple[float, float]:
    """Derivatives of (ψ, w, M_x, M_y), and of their changes, which have φ behind them: the turn of
    R in its own frame. Returns the curvature u of the centre line. force: (3,) Rᵀ n."""
    count, bending = sine.shape[0], layout.bending_n_mm2[k]
    along, across = _directions(layout, k, state[:count], sine, cosine)
    bend, about = state[2 * count], state[2 * count + 1]
    ux, uy = (bend + along) / bending, (about + across) / bending
    twisting = 0.0
    for i in range(count):
        torsion = layout.torsion_n_mm2[k, i]
        if torsion == 0.0:
            out[i], out[count + i] = 0.0, 0.0
            continue
        rate = state[count + i]
        twisting += torsion * rate
        out[i] = rate
        turning = layout.curved_nmm[k, i] * (ux * sine[i] - uy * cosine[i])
        if drag.stiffness_n > 0.0:
            turning += drag.stiffness_n * (state[i] - drag.past_rad[k, stage, i])
        out[count + i] = turning / torsion
    out[2 * count] = force[1] - uy * twisting
    out[2 * count + 1] = ux * twisting - force[0]
    for b in range(columns):
        own, slope = changes[b], out_changes[b]
        by_along, by_across, by_twisting = 0.0, 0.0, 0.0
        for i in range(count):
            curved = layout.curved_nmm[k, i] * own[i]
            by_along -= curved * sine[i]
            by_across += curved * cosine[i]
            by_twisting += layout.torsion_n_mm2[k, i] * own[count + i]
        dx, dy = (own[2 * count] + by_along) / bending, (own[2 * count + 1] + by_across) / bending
        for i in range(count):
            torsion = layout.torsion_n_mm2[k, i]
            if torsion == 0.0:
                slope[i], slope[count + i] = 0.0, 0.0
                continue
            slope[i] = own[count + i]
            stiffness = layout.curved_nmm[k, i] * (ux * cosine[i] + uy * sine[i])
            turned = layout.curved_nmm[k, i] * (dx * sine[i] - dy * cosine[i])
            slope[count + i] = (turned + (stiffness + drag.stiffness_n) * own[i]) / torsion
        fx, fy, fz = own[2 * count + 2], own[2 * count + 3], own[2 * count + 4]
        turned_x, turned_y = force[1] * fz - force[2] * fy, force[2] * fx - force[0] * fz
        slope[2 * count] = turned_y - dy * twisting - uy * by_twisting
        slope[2 * count + 1] = dx * twisting + ux * by_twisting - turned_x
        slope[2 * count + 2] = dx - uy * fz
        slope[2 * count + 3] = dy + ux * fz
        slope[2 * count + 4] = uy * fx - ux * fy
    return ux, uy


@_inlined
def _turned(q: FloatArray, x: float, y: float, z: float, out: FloatArray) -> None:
    """The quaternion q, then a turn by the small rotation vector (x, y, z) in its own frame."""
    size = x * x + y * y + z * z
    c = 1.0 - size / 8.0 * (1.0 - size / 48.0 * (1.0 - size / 120.0))
    s = 0.5 * (1.0 - size / 24.0 * (1.0 - size / 80.0 * (1.0 - size / 168.0)))
    x, y, z = s * x, s * y, s * z
    out[0] = q[0] * c - q[1] * x - q[2] * y - q[3] * z
    out[1] = q[0] * x + q[1] * c + q[2] * z - q[3] * y
    out[2] = q[0] * y - q[1] * z + q[2] * c + q[3] * x
    out[3] = q[0] * z + q[1] * y - q[2] * x + q[3] * c


@_inlined
def _seen_from(q: FloatArray, force: FloatArray, tangent: FloatArray, out: FloatArray) -> None:
    """Rᵀ n in `out` and R e3 in `tangent` of the unit quaternion q."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    tangent[0], tangent[1] = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    tangent[2] = 1.0 - 2.0 * (x * x + y * y)
    fx, fy, fz = force[0], force[1], force[2]
    out[0] = (1.0 - 2.0 * (y * y + z * z)) * fx + 2.0 * (
        (x * y + w * z) * fy + (x * z - w * y) * fz
    )
    out[1] = (1.0 - 2.0 * (x * x + z * z)) * fy + 2.0 * (
        (x * y - w * z) * fx + (y * z + w * x) * fz
    )
    out[2] = tangent[0] * fx + tangent[1] * fy + tangent[2] * fz


@_kernel
def _rub(
    layout: Layout,
    tubes: TubeSet,
    friction: Friction,
    node: int,
    state: FloatArray,
    changes: FloatArray,
    columns: int,
) -> None:
    """The steps in the twist of two tubes that rub on each other at a node."""
    count = layout.twist_length_mm.shape[0]
    for i in range(count):
        for j in range(layout.contact.shape[1]):
            other = layout.partner[i, j]
            if layout.contact[i, j] != node or other < 0:
                continue
            stiffness = friction.stiffness_nmm_rad
            torque = stiffness * (state[i] - state[other] - friction.slider_rad[i, j])
            if abs(torque) >= friction.bound_nmm:
                torque, stiffness = np.sign(torque) * friction.bound_nmm, 0.0
            one, two = tubes.torsion_n_mm2[i], tubes.torsion_n_mm2[other]
            state[count + i] += torque / one
            state[count + other] -= torque / two
            for b in range(columns):
                by_change = stiffness * (changes[b, i] - changes[b, other])
                changes[b, count + i] += by_change / one
                changes[b, count + other] -= by_change / two


@_kernel
def march(
    layout: Layout,
    tubes: TubeSet,
    rotation: FloatArray,
    base: FloatArray,
    friction: Friction,
    drag: Drag,
    columns: int,
    out: March,
    residual: FloatArray,
    by_base: FloatArray,
) -> None:
    """Integrate all from the mouth, by Runge and Kutta's method of order 4 (frame: Munthe-Kaas).

    rotation: (n,) at the collars. base: (n+2,) w(0), M_xy(0). `out` is filled, and residual (n+2,)
    with the twists and the moment left at the ends; its derivative by_base where columns is n+2,
    not where it is 0.
    """
    count, size = rotation.shape[0], 2 * rotation.shape[0] + 2
    state, at, slopes = np.empty(size), np.empty(size), np.empty((4, size))
    change, ats = np.zeros((columns, size + 3)), np.empty((columns, size + 3))
    change_slopes = np.empty((4, columns, size + 3))
    q, qs, rates = np.empty(4), np.empty(4), np.zeros((4, 3))
    tangent, tangents = np.empty(3), np.zeros(3)
    force, seen = np.empty(3), np.empty(3)
    sine, cosine = np.empty(count), np.empty(count)
    for i in range(count):
        state[i] = rotation[i] + layout.twist_length_mm[i] * base[i]
        state[count + i] = base[i]
    state[2 * count], state[2 * count + 1] = base[count], base[count + 1]
    for b in range(columns):
        change[b, count + b] = 1.0
        if b < count:
            change[b, b] = layout.twist_length_mm[b]
    for a in range(3):
        out.position_mm[0, a] = 0.0
    for a in range(4):
        q[a] = out.quaternion[0, a] = 1.0 if a == 0 else 0.0
    intervals = layout.bending_n_mm2.shape[0]
    for k in range(intervals + 1):
        if k > 0 and friction.bound_nmm > 0.0:
            _rub(layout, tubes, friction, k, state, change, columns)
        for i in range(count):
            out.angle_rad[k, i], out.twist_rad_mm[k, i] = state[i], state[count + i]
        out.moment_nmm[k, 0], out.moment_nmm[k, 1] = state[2 * count], state[2 * count + 1]
        if k == intervals:
            break
        h = layout.node_mm[k + 1] - layout.node_mm[k]
        for a in range(3):
            tangents[a] = 0.0
        for stage in range(4):
            middle, last = (stage + 1) // 2, max(stage - 1, 0)
            reach = 0.5 * h * min(stage, 1) * max(middle, 1)
            for a in range(size):
                at[a] = state[a] + reach * slopes[last, a] if stage else state[a]
            for b in range(columns):
                for a in range(size + 3):
                    ats[b, a] = change[b, a]
                    if stage:
                        ats[b, a] += reach * change_slopes[last, b, a]
            tx, ty, tz = reach * rates[last, 0], reach * rates[last, 1], reach * rates[last, 2]
            if stage == 0:
                tx = ty = tz = 0.0
            _turned(q, tx, ty, tz, qs)
            for a in range(3):
                first, second = layout.force_n[k, 0, a], layout.force_n[k, 1, a]
                force[a] = first + 0.5 * middle * (second - first)
            _seen_from(qs, force, tangent, seen)
            ux, uy = _slopes(
                layout,
                k,
                drag,
                middle,
                at,
                seen,
                ats,
                columns,
                sine,
                cosine,
                slopes[stage],
                change_slopes[stage],
            )
            # The rotation vector's rate: u + T × u / 2 + T × (T × u) / 12.
            cx, cy, cz = -tz * uy, tz * ux, tx * uy - ty * ux
            rates[stage, 0] = ux + 0.5 * cx + (ty * cz - tz * cy) / 12.0
            rates[stage, 1] = uy + 0.5 * cy + (tz * cx - tx * cz) / 12.0
            rates[stage, 2] = 0.5 * cz + (tx * cy - ty * cx) / 12.0
            weight = h / (6.0 if stage == 0 or stage == 3 else 3.0)
            for a in range(3):
                tangents[a] += weight * tangent[a]
        for a in range(size):
            both = slopes[1, a] + slopes[2, a]
            state[a] += h / 6.0 * (slopes[0, a] + 2.0 * both + slopes[3, a])
        for b in range(columns):
            for a in range(size + 3):
                both = change_slopes[1, b, a] + change_slopes[2, b, a]
                ends = change_slopes[0, b, a] + change_slopes[3, b, a]
                change[b, a] += h / 6.0 * (ends + 2.0 * both)
        for a in range(3):
            out.position_mm[k + 1, a] = out.position_mm[k, a] + tangents[a]
            both = rates[1, a] + rates[2, a]
            seen[a] = h / 6.0 * (rates[0, a] + 2.0 * both + rates[3, a])
        _turned(q, seen[0], seen[1], seen[2], qs)
        norm = np.sqrt(qs[0] * qs[0] + qs[1] * qs[1] + qs[2] * qs[2] + qs[3] * qs[3])
        for a in range(4):
            q[a] = out.quaternion[k + 1, a] = qs[a] / norm
    for a in range(count + 2):
        residual[a] = state[count + a]
        for b in range(columns):
            by_base[a, b] = change[b, count + a]


@_kernel
def _solve(a: FloatArray, x: FloatArray) -> float:
    """Solve a y = x by elimination, y in place of x; a is used up. Returns the determinant."""
    size, determinant = x.shape[0], 1.0
    for c in range(size):
        pivot = c
        for i in range(c + 1, size):
            if abs(a[i, c]) > abs(a[pivot, c]):
                pivot = i
        if pivot != c:
            determinant = -determinant
            x[c], x[pivot] = x[pivot], x[c]
            for j in range(size):
                a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
        determinant *= a[c, c]
        for i in range(c + 1, size):
            factor = a[i, c] / a[c, c]
            x[i] -= factor * x[c]
            for j in range(c + 1, size):
                a[i, j] -= factor * a[c, j]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]
    return determinant


@_kernel
def _room(layout: Layout) -> March:
    nodes, count = layout.node_mm.shape[0], layout.twist_length_mm.shape[0]
    return March(
        np.empty((nodes, 3)),
        np.empty((nodes, 4)),
        np.empty((nodes, count)),
        np.empty((nodes, count)),
        np.empty((nodes, 2)),
    )


@_kernel
def _step_free(layout: Layout, rotation: FloatArray, base: FloatArray, step: FloatArray) -> float:
    """Newton's step (n+2,) without loads. Returns the determinant."""
    count = rotation.shape[0]
    left, by_twist = np.empty(count - 1), np.empty((count - 1, count - 1))
    _twist_free(layout, rotation, base[:count], left, by_twist)
    determinant = _solve(by_twist, left)
    moment = 0.0
    for b in range(count - 1):
        free = b if b < layout.last else b + 1
        step[free] = -left[b]
        moment -= layout.torsion_n_mm2[0, free] * left[b]
    step[layout.last] = -moment / layout.torsion_n_mm2[0, layout.last]
    step[count] = step[count + 1] = 0.0
    return determinant


@_kernel
def settle(
    layout: Layout,
    tubes: TubeSet,
    rotation: FloatArray,
    start: FloatArray,
    friction: Friction,
    drag: Drag,
    free: bool,
    patience: int,
    iterations: int,
) -> Settled:
    """Newton's method from `start` (n+2,).

    free: no force, friction or drag acts. patience: steps that may be longer than half of the one
    before. With none, and no step longer than half a radian, it arrives where a smooth path leads
    to, or not at all.
    """
    count, length = rotation.shape[0], layout.node_mm[-1]
    base, step, room = start.copy(), np.empty(count + 2), _room(layout)
    residual, by_base = np.empty(count + 2), np.empty((count + 2, count + 2))
    if free:
        moment = 0.0
        for i in range(count):
            if i != layout.last:
                moment += layout.torsion_n_mm2[0, i] * base[i]
        base[layout.last] = -moment / layout.torsion_n_mm2[0, layout.last]
        base[count] = base[count + 1] = 0.0
    before, stiffness = np.inf, tubes.bending_n_mm2[0]
    for _ in range(iterations):
        if free:
            determinant = _step_free(layout, rotation, base, step)
        else:
            march(
                layout,
                tubes,
                rotation,
                base,
                friction,
                drag,
                count + 2,
                room,
                residual,
                by_base,
            )
            determinant = _solve(by_base, residual)
            for a in range(count + 2):
                step[a] = -residual[a]
        size = 0.0
        for a in range(count + 2):
            part = abs(step[a]) * length
            if a >= count:
                part /= stiffness
            if not part < np.inf:
                return Settled(False, base, 0.0, room)
            size = max(size, part)
        if size > _CLOSE_RAD and size > min(_CONTRACTION * before, _LONGEST_STEP_RAD):
            patience -= 1
            if patience < 0:
                break
        before = size
        share = 1.0 if size <= _LONGEST_STEP_RAD else _LONGEST_STEP_RAD / size
        for a in range(count + 2):
            base[a] += share * step[a]
        if size <= _CLOSE_RAD:
            none = 0 * count  # no columns; why it is no constant, see `sweep`
            march(layout, tubes, rotation, base, friction, drag, none, room, residual, by_base)
            return Settled(True, base, determinant, room)
    return Settled(False, base, 0.0, room)


@_kernel
def _stored(
    layout: Layout, tubes: TubeSet, out: March, node: int, tube: int, own: int, others: int
) -> float:
    """What it costs per length, N, that a node is passed by a tube as it is in interval `own` and
    by the others as in interval `others`: their energy, minus what moment and twist do."""
    intervals = layout.bending_n_mm2.shape[0]
    along, across = out.moment_nmm[node, 0], out.moment_nmm[node, 1]
    bending, stored = 0.0, 0.0
    for i in range(tubes.bending_n_mm2.shape[0]):
        k = own if i == tube else others
        if k >= intervals or layout.torsion_n_mm2[k, i] == 0.0:
            continue
        curved = layout.curved_nmm[k, i]
        bending += tubes.bending_n_mm2[i]
        along += curved * np.cos(out.angle_rad[node, i])
        across += curved * np.sin(out.angle_rad[node, i])
        stored += 0.5 * curved * curved / tubes.bending_n_mm2[i]
        stored -= 0.5 * tubes.torsion_n_mm2[i] * out.twist_rad_mm[node, i] ** 2
    if bending == 0.0:
        return 0.0
    return float(stored - 0.5 * (along * along + across * across) / bending)


@_kernel
def section_pushes(
    layout: Layout, tubes: TubeSet, base: FloatArray, out: March, down: FloatArray
) -> FloatArray:
    """(n,) N that push each tube's collar back, friction aside: what energy its changes of section
    gain when it goes forward by 1 mm, the shorter way to the mouth, its weight and its load.

    Where several tubes end at one place, each is the mean of going forward and going back.
    """
    count, sections = tubes.end_mm.shape
    pushes = np.zeros(count)
    for i in range(count):
        if layout.twist_length_mm[i] > 0.0:
            pushes[i] += 0.5 * tubes.torsion_n_mm2[i] * base[i] ** 2
        for j in range(sections):
            k = layout.contact[i, j]
            if k <= 0 or (j > 0 and tubes.end_mm[i, j] <= tubes.end_mm[i, j - 1]):
                continue
            for others in (k - 1, k):
                behind = _stored(layout, tubes, out, k, i, k - 1, others)
                pushes[i] += 0.5 * (behind - _stored(layout, tubes, out, k, i, k, others))
        end = layout.contact[i, sections - 1]
        for a in range(3):
            if end > 0:
                pushes[i] -= tubes.weight_n_mm[i] * down[a] * out.position_mm[end, a]
    tip = layout.tip_node
    if tip > 0:
        w, x, y, z = out.quaternion[tip]
        tangent = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
        for a in range(3):
            load = layout.force_n[tip - 1, 1, a]
            if tip < layout.bending_n_mm2.shape[0]:
                load -= layout.force_n[tip, 0, a]
            pushes[count - 1] -= load * tangent[a]
    return pushes


@_kernel
def sweep(
    tubes: TubeSet,
    rotation_rad: FloatArray,
    collar_mm: FloatArray,
    twisting: bool,
    interval_mm: float,
    tip_mm: FloatArray,
    direction: FloatArray,
) -> None:
    """Where the innermost tube ends, without loads and friction, for rows of (K, n) settings.

    Each row begins with the equilibrium of the one before, so neighbours should be near; in a
    motion of small steps it begins as much further as the last one came. Filled: tip_mm and
    direction (K, 3); not a number where no stable equilibrium was found.
    """
    count = rotation_rad.shape[1]
    none, down = np.zeros(3), np.array([0.0, 0.0, -1.0])
    friction = Friction(np.zeros(tubes.end_mm.shape), 0.0, 0.0)
    drag = Drag(np.zeros((1, 3, 1)), 0.0)
    base, cold, came = np.zeros(count + 2), np.zeros(count + 2), np.zeros(count + 2)
    # For a constant a kernel would be compiled once more: these are what any call has.
    free, none_left = count > 0, 0 * count
    few = none_left + _SWEPT
    for row in range(rotation_rad.shape[0]):
        angles = rotation_rad[row]
        layout = lay_out(tubes, collar_mm[row], twisting, none, down, interval_mm)
        found = settle(layout, tubes, angles, base + came, friction, drag, free, none_left, few)
        if not (found.converged and found.determinant > 0.0) and came.any():
            found = settle(layout, tubes, angles, base, friction, drag, free, none_left, few)
        if not (found.converged and found.determinant > 0.0):
            found = settle(layout, tubes, angles, cold, friction, drag, free, few, 3 * few)
        if not (found.converged and found.determinant > 0.0):
            came[:] = 0.0
            for a in range(3):
                tip_mm[row, a] = direction[row, a] = np.nan
            continue
        far = 0.0
        for i in range(count):
            came[i] = found.base[i] - base[i]
            far = max(far, abs(came[i]) * layout.node_mm[-1])
        if far > _GENTLY_RAD or row == 0:
            came[:] = 0.0
        base = found.base
        tip = layout.tip_node
        w, x, y, z = found.march.quaternion[tip]
        direction[row, 0], direction[row, 1] = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
        direction[row, 2] = 1.0 - 2.0 * (x * x + y * y)
        for a in range(3):
            tip_mm[row, a] = found.march.position_mm[tip, a]
