"""Obstacles that move: balls with a velocity, counted wherever they may be while they are believed.

A ball that was seen at a place may be anywhere between there and where its velocity leads it until
its measurement is no longer believed, and the step that is begun before then has come to its end.
So it counts as the capsule that it sweeps: the same all that time, and never less than it is.

The body is compared with the capsules shape by shape. What is far away is sorted out for all shapes
at once, since between two frames nothing comes near from there; where nothing is left, nothing is
looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf, isfinite, sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray
from safety.risk.shape_kernels import Skin

NEAR_MM: Final = 12.0
"""What is farther from the body's skin than this needs not be known: steps are turned aside at 10.
"""
_STRETCHED: Final = 1.5
"""No two nodes are farther apart than so many times what they are along the body: silicone goes to
a fifth more of its length at most."""
_FARTHEST_MM: Final = 1e4
_FASTEST_MM_S: Final = 1e3
_HALF, _ZERO, _ONE = np.float32(0.5), np.float32(0.0), np.float32(1.0)
_TINY = np.float32(1e-6)

SingleArray = NDArray[np.float32]

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
_placing = njit(
    cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc", "nnan", "nsz"}
)
"""Here loops run in parallel lanes. Places that are no numbers are solid for the grid already."""


class MovingBall(NamedTuple):
    """As it was seen."""

    centre_mm: tuple[float, ...]
    """(3,)."""
    radius_mm: float
    velocity_mm_s: tuple[float, ...] = (0.0, 0.0, 0.0)

    def fault(self) -> str:
        """Why it cannot be believed; empty if it can."""
        if len(self.centre_mm) != 3 or len(self.velocity_mm_s) != 3:
            return "a place and a velocity have three numbers"
        numbers = (*self.centre_mm, self.radius_mm, *self.velocity_mm_s)
        if not all(map(isfinite, numbers)):
            return "its numbers must be finite"
        if max(map(abs, (*self.centre_mm, self.radius_mm))) > _FARTHEST_MM:
            return f"nothing here is {_FARTHEST_MM:g} mm away, or as large"
        if not self.radius_mm > 0.0:
            return "its radius must be positive"
        if hypot(*self.velocity_mm_s) > _FASTEST_MM_S:
            return f"nothing is followed that is faster than {_FASTEST_MM_S:g} mm/s"
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class Swept:
    """Where balls may be, as capsules: (k, 7) start, way to its end, radius. float32, mm."""

    capsules: SingleArray

    @classmethod
    def of(cls, balls: Sequence[tuple[MovingBall, float]]) -> "Swept":
        """Of balls, each with the time for which it is to be led on, s."""
        rows = [
            [*ball.centre_mm, *(speed * for_s for speed in ball.velocity_mm_s), ball.radius_mm]
            for ball, for_s in balls
        ]
        return cls(np.array(rows, np.float32).reshape(-1, 7))

    def nearest(self, place_mm: FloatArray) -> tuple[float, FloatArray]:
        """How far a (3,) place is from the nearest of them, and (3,) the place of its surface."""
        best, at = inf, np.full(3, np.nan)
        for row in self.capsules.astype(np.float64):
            start, way, radius = row[:3], row[3:6], row[6]
            square = float(way @ way)
            share = float(np.clip((place_mm - start) @ way / square, 0.0, 1.0)) if square else 0.0
            off = place_mm - start - share * way
            away = sqrt(float(off @ off))
            if away - radius < best:
                best = away - radius
                at = place_mm - off * (best / away) if away > 0.0 else place_mm
        return best, at


class Limits(NamedTuple):
    """Which nodes are looked at, how far, and how far apart two of them may be."""

    first: int
    last: int
    far: np.float32
    apart: np.float32


NOTHING_MOVES: Final = Swept(np.empty((0, 7), np.float32))


class MovingClearance:
    """Of many shapes of one body. Not for several threads."""

    def __init__(self, skin: Skin, arc_mm: FloatArray, samples: int) -> None:
        """arc_mm: (n,) where along the body its nodes are."""
        self._skin = skin
        self._apart = np.float32(_STRETCHED * np.diff(arc_mm).max())
        self._far = np.float32(NEAR_MM)
        self._box = np.empty((2, 3 * skin.radius.size), np.float32)
        self._near = np.empty(samples, np.float32)
        self._safe = np.empty(samples, np.float32)
        self._node = np.empty(samples, np.int64)

    @property
    def far_mm(self) -> float:
        """What is farther from the body's skin than this is told to be as far as this."""
        return float(self._far)

    def look_as_far_as(self, far_mm: float) -> None:
        """NEAR_MM, or more: where a body that is shifted counts as well."""
        self._far = np.float32(max(far_mm, NEAR_MM))

    def look(
        self, swept: Swept, positions: SingleArray
    ) -> tuple[SingleArray, NDArray[np.int64], SingleArray] | None:
        """(S,) clearances of (S, 3n) shapes from what moves, with (S,) the node that is nearest,
        and (S,) what the clearance of no part of a body is below whose centreline may be off.
        `far_mm` where it is more. None: it is more for all of them.

        What is answered is overwritten by the next question.
        """
        if not swept.capsules.size:
            return None
        count = len(positions)
        enclose(positions, self._box)
        first, last = near_nodes(swept.capsules, self._box, self._skin.safe, self._far)
        if last < first:
            return None
        near, node, safe = self._near[:count], self._node[:count], self._safe[:count]
        limits = Limits(first, last, self._far, self._apart)
        clearances_of(swept.capsules, self._skin, positions, limits, near, node, safe)
        return near, node, safe


@_placing
def enclose(positions, box):  # type: ignore[no-untyped-def]
    """Write the (2, 3n) lowest and highest of each coordinate over all shapes."""
    lowest, highest = box[0], box[1]
    lowest[:], highest[:] = positions[0], positions[0]
    for s in range(1, positions.shape[0]):
        row = positions[s]
        for c in range(row.size):
            lowest[c] = min(lowest[c], row[c])
            highest[c] = max(highest[c], row[c])


@_kernel
def near_nodes(capsules, box, radius, far):  # type: ignore[no-untyped-def]
    """The first and the last node that may be nearer than that in any shape, and the node beside
    each: what is between them is then nearer, too."""
    first, last = radius.size, -1
    for k in range(capsules.shape[0]):
        for i in range(radius.size):
            square = _ZERO
            for axis in range(3):
                begin = capsules[k, axis]
                end = begin + capsules[k, 3 + axis]
                low, high = min(begin, end), max(begin, end)
                gap = max(box[0, 3 * i + axis] - high, low - box[1, 3 * i + axis], _ZERO)
                square += gap * gap
            limit = far + radius[i] + capsules[k, 6]
            if square < limit * limit:
                first, last = min(first, i), max(last, i)
    if last < first:
        return first, last
    return max(first - 1, 0), min(last + 1, radius.size - 1)


@_kernel
def clearances_of(capsules, skin, positions, limits, near, node, safe):  # type: ignore[no-untyped-def]
    """Write them, of the nodes from the first to the last, and what is between."""
    first, last, far, apart = limits
    at_node = np.empty(skin.radius.size, np.float32)
    for s in range(near.size):
        near[s], node[s], safe[s] = far, first, far
        for k in range(capsules.shape[0]):
            _from_nodes(capsules[k], positions[s], first, last, at_node)
            for i in range(first, last + 1):
                if at_node[i] - skin.radius[i] < near[s]:
                    near[s], node[s] = at_node[i] - skin.radius[i], i
                safe[s] = min(safe[s], at_node[i] - skin.safe[i])
            for i in range(first, last):
                thick = max(skin.radius[i], skin.radius[i + 1])
                thicker = max(skin.safe[i], skin.safe[i + 1])
                # No place between two nodes is farther than half of their distance from one.
                least = min(at_node[i], at_node[i + 1]) - _HALF * apart
                if least - thick >= near[s] and least - thicker >= safe[s]:
                    continue
                least = _HALF * (at_node[i] + at_node[i + 1] - _length(positions, s, i))
                if least - thick >= near[s] and least - thicker >= safe[s]:
                    continue
                away = _from_segment(capsules, k, positions, s, i)
                if away - thick < near[s]:
                    near[s], node[s] = away - thick, i
                safe[s] = min(safe[s], away - thicker)


@_placing
def _from_nodes(capsule, shape, first, last, at_node):  # type: ignore[no-untyped-def]
    """Write the distance of nodes of a (3n,) shape from the surface of a (7,) capsule."""
    a, b, c = capsule[0], capsule[1], capsule[2]
    u, v, w, radius = capsule[3], capsule[4], capsule[5], capsule[6]
    square = u * u + v * v + w * w
    scale = _ONE / square if square > _TINY else _ZERO
    for i in range(first, last + 1):
        x, y, z = shape[3 * i] - a, shape[3 * i + 1] - b, shape[3 * i + 2] - c
        share = min(max((x * u + y * v + z * w) * scale, _ZERO), _ONE)
        x, y, z = x - share * u, y - share * v, z - share * w
        at_node[i] = np.sqrt(x * x + y * y + z * z) - radius


@_placing
def longest_ways(before, after):  # type: ignore[no-untyped-def]
    """(S,) how far the node goes that goes farthest, of (S, 3n) shapes."""
    longest = np.empty(before.shape[0], np.float32)
    for s in range(before.shape[0]):
        most = _ZERO
        for i in range(before.shape[1] // 3):
            x, y = after[s, 3 * i] - before[s, 3 * i], after[s, 3 * i + 1] - before[s, 3 * i + 1]
            z = after[s, 3 * i + 2] - before[s, 3 * i + 2]
            most = max(most, x * x + y * y + z * z)
        longest[s] = np.sqrt(most)
    return longest


@_inlined
def _length(positions, s, i):  # type: ignore[no-untyped-def]
    """From node i to the next."""
    x = positions[s, 3 * i + 3] - positions[s, 3 * i]
    y = positions[s, 3 * i + 4] - positions[s, 3 * i + 1]
    z = positions[s, 3 * i + 5] - positions[s, 3 * i + 2]
    return np.float32(sqrt(x * x + y * y + z * z))


@_kernel
def _from_segment(capsules, k, positions, s, i):  # type: ignore[no-untyped-def]
    """From all between node i and the next to the surface of a capsule: the distance of two
    straight pieces (Ericson, Real-Time Collision Detection, 5.1.9)."""
    ax, ay, az = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
    px, py = positions[s, 3 * i + 3] - ax, positions[s, 3 * i + 4] - ay
    pz = positions[s, 3 * i + 5] - az
    qx, qy, qz = capsules[k, 3], capsules[k, 4], capsules[k, 5]
    rx, ry, rz = ax - capsules[k, 0], ay - capsules[k, 1], az - capsules[k, 2]
    a, e = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz
    f, c = qx * rx + qy * ry + qz * rz, px * rx + py * ry + pz * rz
    along, there = _ZERO, _ZERO
    if a <= _TINY:
        there = min(max(f / e, _ZERO), _ONE) if e > _TINY else _ZERO
    elif e <= _TINY:
        along = min(max(-c / a, _ZERO), _ONE)
    else:
        b = px * qx + py * qy + pz * qz
        parallel = a * e - b * b
        if parallel > _TINY * a * e:
            along = min(max((b * f - c * e) / parallel, _ZERO), _ONE)
        there = (b * along + f) / e
        if there < _ZERO:
            there, along = _ZERO, min(max(-c / a, _ZERO), _ONE)
        elif there > _ONE:
            there, along = _ONE, min(max((b - c) / a, _ZERO), _ONE)
    x, y = rx + along * px - there * qx, ry + along * py - there * qy
    z = rz + along * pz - there * qz
    return np.float32(sqrt(x * x + y * y + z * z)) - capsules[k, 6]
