"""Orientation and angular velocity of the tip: an error-state filter on unit quaternions.

The orientation itself is a quaternion beside the filter. What is filtered is the small rotation
between it and the truth, in the tip's own frame; after every correction this is turned into the
quaternion and is zero again. So there is neither a norm to keep nor a direction that cannot be
told.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt

from daemon.estimation.constant_velocity import ConstantVelocity, Triple
from drivers.pose import Quaternion, product

_NO_ERROR: Triple = (0.0, 0.0, 0.0)


class OrientationFilter:
    """State: the error as a rotation vector, then the angular velocity, in the tip's frame."""

    def __init__(self, noise_rad: float, acceleration_rad_s2: float, rate_rad_s: float) -> None:
        """rate_rad_s: standard deviation of the angular velocity when the filter begins."""
        self._rate_variance = rate_rad_s**2
        self._filter = ConstantVelocity(noise_rad**2, acceleration_rad_s2**2)
        self._quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
        self._began = False

    def begin(self, quaternion: Sequence[float]) -> None:
        """At this measured orientation, with a rate that is not known."""
        self._filter.begin(_NO_ERROR, self._rate_variance)
        w, x, y, z = _unit(quaternion)
        v = self._quaternion
        same = not self._began or v[0] * w + v[1] * x + v[2] * y + v[3] * z >= 0.0
        self._quaternion = (w, x, y, z) if same else (-w, -x, -y, -z)
        self._began = True

    def surprise(self, innovation: Triple, ahead_s: float) -> float:
        """Squared Mahalanobis distance of a measurement, this long after the state."""
        return self._filter.surprise(innovation, ahead_s)

    def update(self, predicted: Quaternion, innovation: Triple, ahead_s: float) -> None:
        """Move the state ahead, to where it was predicted, and correct it."""
        error = self._filter
        error.advance(ahead_s)
        error.values = _NO_ERROR  # the prediction has taken the turn into the quaternion
        error.correct(innovation)
        self._quaternion = _unit(product(predicted, from_rotation_vector(error.values)))
        error.values = _NO_ERROR

    def quaternion(self, ahead_s: float) -> Quaternion:
        """Extrapolated."""
        x, y, z = self._filter.rates
        turn = from_rotation_vector((ahead_s * x, ahead_s * y, ahead_s * z))
        return product(self._quaternion, turn)


def turn_between(one: Quaternion, other: Sequence[float]) -> Triple:
    """The rotation vector that leads from one orientation to the other: the innovation, if one was
    predicted and the other measured."""
    w, x, y, z = one
    return rotation_vector(product((w, -x, -y, -z), other))


def _unit(quaternion: Sequence[float]) -> Quaternion:
    norm = hypot(*quaternion)
    w, x, y, z = quaternion
    return w / norm, x / norm, y / norm, z / norm


def rotation_vector(quaternion: Sequence[float]) -> Triple:
    """Axis times angle of the shorter way, |angle| ≤ π. The norm of `quaternion` is free."""
    q0, q1, q2, q3 = quaternion
    if q0 < 0.0:
        q0, q1, q2, q3 = -q0, -q1, -q2, -q3
    sine = sqrt(q1 * q1 + q2 * q2 + q3 * q3)
    scale = 2.0 * atan2(sine, q0) / sine if sine > 1e-12 else 2.0
    return scale * q1, scale * q2, scale * q3


def from_rotation_vector(vector: Sequence[float]) -> Quaternion:
    """Of unit length."""
    x, y, z = vector
    angle = sqrt(x * x + y * y + z * z)
    scale = sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    return cos(0.5 * angle), scale * x, scale * y, scale * z
