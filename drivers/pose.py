"""Poses as the tracker gives them."""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Position = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Scalar first."""


class Pose(NamedTuple):
    """A rigid placement of one frame in another.

    position_mm: (3,). quaternion: (4,), scalar first, unit length, Hamilton.
    """

    position_mm: Vector
    quaternion: Vector

    def plain(self) -> "PlainPose":
        """The same in plain numbers."""
        x, y, z = self.position_mm.tolist()
        q0, q1, q2, q3 = self.quaternion.tolist()
        return PlainPose((x, y, z), (q0, q1, q2, q3))


class PlainPose(NamedTuple):
    """The same in plain numbers, for arithmetic with one pose at a time: to make an array takes as
    long as to turn a vector."""

    position_mm: Position
    quaternion: Quaternion

    def vectors(self) -> Pose:
        """The same in vectors."""
        return Pose(np.array(self.position_mm), np.array(self.quaternion))

    def __matmul__(self, other: "PlainPose") -> "PlainPose":
        """The placement of `other`'s frame, given in this one's frame, in this one's parent."""
        x, y, z = self.position_mm
        u, v, w = turned(self.quaternion, other.position_mm)
        return PlainPose((x + u, y + v, z + w), product(self.quaternion, other.quaternion))

    def seen_from(self, other: "PlainPose") -> "PlainPose":
        """The placement of this frame in that of `other`, which has the same parent."""
        w, x, y, z = other.quaternion
        back = (w, -x, -y, -z)
        a, b, c = turned(back, other.position_mm)
        u, v, t = turned(back, self.position_mm)
        return PlainPose((-a + u, -b + v, -c + t), product(back, self.quaternion))


# Written out in scalars: on vectors of three, numpy's own products take twenty times as long.


def length(vector: Vector) -> float:
    """How long (n,) is. Of three numbers numpy's own norm takes far longer."""
    return sqrt(vector @ vector)


def conjugate(q: Vector) -> Vector:
    """The opposite rotation of unit quaternion q."""
    q0, q1, q2, q3 = q.tolist()
    return np.array([q0, -q1, -q2, -q3])


def multiply(p: Vector, q: Vector) -> Vector:
    """Hamilton product p q: first q's rotation, then p's."""
    return np.array(product(p.tolist(), q.tolist()))


def product(p: Sequence[float], q: Sequence[float]) -> Quaternion:
    """The same of plain numbers."""
    p0, p1, p2, p3 = p
    q0, q1, q2, q3 = q
    return (
        p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
        p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
        p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
        p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
    )


def rotate(q: Vector, v: Vector) -> Vector:
    """Vector v turned by unit quaternion q."""
    return np.array(turned(q.tolist(), v.tolist()))


def turned(q: Sequence[float], v: Sequence[float]) -> tuple[float, float, float]:
    """The same of plain numbers: v + 2 q0 (a x v) + 2 a x (a x v), a = (q1, q2, q3)."""
    q0, a, b, c = q
    x, y, z = v
    u, w, t = b * z - c * y, c * x - a * z, a * y - b * x
    return (
        x + 2.0 * (q0 * u + b * t - c * w),
        y + 2.0 * (q0 * w + c * u - a * t),
        z + 2.0 * (q0 * t + a * w - b * u),
    )
