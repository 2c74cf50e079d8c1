"""Tendons through holes, compiled: how tension is handed on from the motor to the tip.

Arrays of spans and holes are (n, m): n spans between plates, base first, of m tendons; hole k is
where span k begins. The routes of the rod are these spans, in the order of the arrays.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_kernel = njit(cache=True, error_model="numpy")


class Strung(NamedTuple):
    """Tendons as they are strung. All arrays C-contiguous.

    plate: (n+1,) int64, the rod's node at each plate, base first. hole_mm: (n+1, m, 2) places in
    the plates. rest_mm: (m,) as much unstretched tendon from base plate to tip, and the tendon is
    just taut with its motor at zero. give_mm_n: (m,) what a newton lengthens a span by. friction:
    coefficient. presliding_mm: slip from no friction to all of it. stiffness_n_mm: of the motor's
    side. corner_mm: how round the corner is where a tendon goes slack.
    """

    plate: NDArray[np.int64]
    hole_mm: FloatArray
    rest_mm: FloatArray
    give_mm_n: FloatArray
    friction: float
    presliding_mm: float
    stiffness_n_mm: float
    corner_mm: float


@_kernel
def _chord(
    strung: Strung, k: int, i: int, position: FloatArray, quaternion: FloatArray, out: FloatArray
) -> None:
    """(3,) place of tendon i in plate k."""
    node = strung.plate[k]
    x, y = strung.hole_mm[k, i, 0], strung.hole_mm[k, i, 1]
    w, a, b, c = quaternion[node, 0], quaternion[node, 1], quaternion[node, 2], quaternion[node, 3]
    out[0] = position[node, 0] + (1.0 - 2.0 * (b * b + c * c)) * x + 2.0 * (a * b - w * c) * y
    out[1] = position[node, 1] + 2.0 * (a * b + w * c) * x + (1.0 - 2.0 * (a * a + c * c)) * y
    out[2] = position[node, 2] + 2.0 * (a * c - w * b) * x + 2.0 * (b * c + w * a) * y


@_kernel
def _wrap(strung: Strung, position: FloatArray, quaternion: FloatArray, out: FloatArray) -> None:
    """(n, m) angles by which the tendons turn at their holes, from one straight span to the next.

    Behind the base plate they run along its normal.
    """
    here, there = np.empty(3), np.empty(3)
    for i in range(strung.hole_mm.shape[1]):
        before0, before1, before2 = 0.0, 0.0, 1.0
        _chord(strung, 0, i, position, quaternion, here)
        for k in range(strung.plate.shape[0] - 1):
            _chord(strung, k + 1, i, position, quaternion, there)
            after0, after1, after2 = there[0] - here[0], there[1] - here[1], there[2] - here[2]
            cross0 = before1 * after2 - before2 * after1
            cross1 = before2 * after0 - before0 * after2
            cross2 = before0 * after1 - before1 * after0
            along = before0 * after0 + before1 * after1 + before2 * after2
            across = np.sqrt(cross0 * cross0 + cross1 * cross1 + cross2 * cross2)
            out[k, i] = np.arctan2(across, along)
            before0, before1, before2 = after0, after1, after2
            here, there = there, here


@_kernel
def _beyond(strung: Strung, length: FloatArray, tension: FloatArray, out: FloatArray) -> None:
    """(n, m) unstretched tendon between each hole and the tip."""
    for i in range(length.shape[1]):
        sum_mm = 0.0
        for k in range(length.shape[0] - 1, -1, -1):
            sum_mm += length[k, i] - tension[k, i] * strung.give_mm_n[i]
            out[k, i] = sum_mm


@_kernel
def _at_motor(strung: Strung, stretch_mm: float) -> tuple[float, float]:
    """Tension N of the motor's side at this stretch, never negative, and its derivative."""
    root = np.sqrt(stretch_mm * stretch_mm + strung.corner_mm * strung.corner_mm)
    half = 0.5 * strung.stiffness_n_mm
    return half * (stretch_mm + root), half * (1.0 + stretch_mm / root)


@_kernel
def _grip(strung: Strung, before: float, slipped_mm: float) -> tuple[float, float]:
    """Share of the friction that holds against the motor, and its derivative by the slip to it."""
    grip = before + slipped_mm / strung.presliding_mm
    if grip > 1.0:
        return 1.0, 0.0
    if grip < -1.0:
        return -1.0, 0.0
    return grip, 1.0 / strung.presliding_mm


@_kernel
def imbalance(
    strung: Strung,
    position: FloatArray,
    quaternion: FloatArray,
    length: FloatArray,
    tension: FloatArray,
    grip: FloatArray,
    beyond: FloatArray,
    wound: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the tensions of the spans exceed those by that the motors and the holes hand on, N.

    position (N+1, 3) and quaternion (N+1, 4) of the rod's nodes; length and tension (n, m) of the
    spans; grip and beyond (n, m) as they were before; wound (m,) mm on the spools. Returns it as
    (n m,), and its derivatives by lengths and by tensions, (n m, n m). The angles at the holes
    change little with these, and their derivatives are left out.
    """
    spans, tendons = length.shape
    size = spans * tendons
    residual = np.empty(size)
    by_length, by_tension = np.zeros((size, size)), np.zeros((size, size))
    wrap, now = np.empty((spans, tendons)), np.empty((spans, tendons))
    _wrap(strung, position, quaternion, wrap)
    _beyond(strung, length, tension, now)
    for i in range(tendons):
        stretch_mm = wound[i] + now[0, i] - strung.rest_mm[i]
        before, stiffness = _at_motor(strung, stretch_mm)
        for k in range(spans):
            row = k * tendons + i
            share, by_slip = _grip(strung, grip[k, i], beyond[k, i] - now[k, i])
            kept = np.exp(-strung.friction * wrap[k, i] * share)
            residual[row] = tension[k, i] - before * kept
            by_tension[row, row] += 1.0
            if k > 0:
                by_tension[row, row - tendons] -= kept
            slope = before * kept * strung.friction * wrap[k, i] * -by_slip
            if k == 0:
                slope -= kept * stiffness
            for column in range(row, size, tendons):
                by_length[row, column] += slope
                by_tension[row, column] -= slope * strung.give_mm_n[i]
            before = tension[k, i]
    return residual, by_length, by_tension


@_kernel
def memory(
    strung: Strung,
    length: FloatArray,
    tension: FloatArray,
    grip: FloatArray,
    beyond: FloatArray,
    wound: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the holes will remember, grip and beyond (n, m), and the tension at the motors (m,)."""
    spans, tendons = length.shape
    grip_now, now = np.empty((spans, tendons)), np.empty((spans, tendons))
    at_motor = np.empty(tendons)
    _beyond(strung, length, tension, now)
    for i in range(tendons):
        at_motor[i] = _at_motor(strung, wound[i] + now[0, i] - strung.rest_mm[i])[0]
        for k in range(spans):
            grip_now[k, i] = _grip(strung, grip[k, i], beyond[k, i] - now[k, i])[0]
    return grip_now, now, at_motor
