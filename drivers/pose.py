"""Poses as the tracker gives them."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A rigid placement of one frame in another.

    position_mm: (3,). quaternion: (4,), scalar first, unit length, Hamilton.
    """

    position_mm: Vector
    quaternion: Vector

    def __matmul__(self, other: Self) -> Self:
        """The placement of `other`'s frame, given in this one's frame, in this one's parent."""
        return type(self)(
            self.position_mm + rotate(self.quaternion, other.position_mm),
            multiply(self.quaternion, other.quaternion),
        )

    def inverse(self) -> Self:
        """The placement of the parent in this frame."""
        back = conjugate(self.quaternion)
        return type(self)(-rotate(back, self.position_mm), back)


# Written out in scalars: on vectors of three, numpy's own products take twenty times as long.


def conjugate(q: Vector) -> Vector:
    """The opposite rotation of unit quaternion q."""
    q0, q1, q2, q3 = q.tolist()
    return np.array([q0, -q1, -q2, -q3])


def multiply(p: Vector, q: Vector) -> Vector:
    """Hamilton product p q: first q's rotation, then p's."""
    p0, p1, p2, p3 = p.tolist()
    q0, q1, q2, q3 = q.tolist()
    return np.array(
        [
            p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
            p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
            p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
        ]
    )


def rotate(q: Vector, v: Vector) -> Vector:
    """Vector v turned by unit quaternion q: v + 2 q0 (a x v) + 2 a x (a x v), a = (q1, q2, q3)."""
    q0, a, b, c = q.tolist()
    x, y, z = v.tolist()
    u, w, t = b * z - c * y, c * x - a * z, a * y - b * x
    return np.array(
        [
            x + 2.0 * (q0 * u + b * t - c * w),
            y + 2.0 * (q0 * w + c * u - a * t),
            z + 2.0 * (q0 * t + a * w - b * u),
        ]
    )
