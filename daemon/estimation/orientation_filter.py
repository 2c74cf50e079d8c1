"""Orientation and angular velocity of the tip: an error-state filter on unit quaternions.

The orientation itself is a quaternion beside the filter. What is filtered is the small rotation
between it and the truth, in the tip's own frame; after every correction this is turned into the
quaternion and is zero again. So there is neither a norm to keep nor a direction that cannot be
told.
"""

from math import atan2, cos, sin, sqrt

import numpy as np

from daemon.estimation.constant_velocity import (
    advance,
    begin,
    constant_velocity,
    value_variance,
)
from drivers.pose import Vector, conjugate, multiply


class OrientationFilter:
    """Filter state (6,): error as a rotation vector, then angular velocity, in the tip's frame."""

    def __init__(self, noise_rad: float, acceleration_rad_s2: float, rate_rad_s: float) -> None:
        """rate_rad_s: standard deviation of the angular velocity when the filter begins."""
        self._variance = noise_rad**2
        self._acceleration_variance = acceleration_rad_s2**2
        self._rate_variance = rate_rad_s**2
        self._filter = constant_velocity(self._variance)
        self._quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        self._began = False

    def begin(self, quaternion: Vector) -> None:
        """At this measured orientation, with a rate that is not known."""
        begin(self._filter, self._variance, self._rate_variance)
        unit = quaternion / sqrt(float(quaternion @ quaternion))
        self._quaternion = -unit if self._began and self._quaternion @ unit < 0.0 else unit
        self._began = True

    def surprise(self, quaternion: Vector, ahead_s: float) -> float:
        """Squared Mahalanobis distance of a measurement, this long after the state."""
        offset = rotation_vector(multiply(conjugate(self.quaternion(ahead_s)), quaternion))
        known = value_variance(self._filter, ahead_s, self._acceleration_variance)
        return float(offset @ offset) / (known + self._variance)

    def update(self, quaternion: Vector, ahead_s: float) -> None:
        """Move the state ahead and correct it."""
        predicted = self.quaternion(ahead_s)
        advance(self._filter, ahead_s, self._acceleration_variance)
        self._filter.predict()
        self._filter.x[:3, 0] = 0.0  # the prediction has taken the turn into the quaternion
        self._filter.update(rotation_vector(multiply(conjugate(predicted), quaternion)))
        turned = multiply(predicted, from_rotation_vector(self._filter.x[:3, 0]))
        self._quaternion = turned / sqrt(float(turned @ turned))
        self._filter.x[:3, 0] = 0.0

    def quaternion(self, ahead_s: float) -> Vector:
        """(4,) extrapolated."""
        return multiply(self._quaternion, from_rotation_vector(ahead_s * self._filter.x[3:, 0]))


def rotation_vector(quaternion: Vector) -> Vector:
    """(3,) axis times angle of the shorter way, |angle| ≤ π. The norm of `quaternion` is free."""
    q0, q1, q2, q3 = quaternion.tolist()
    if q0 < 0.0:
        q0, q1, q2, q3 = -q0, -q1, -q2, -q3
    sine = sqrt(q1 * q1 + q2 * q2 + q3 * q3)
    scale = 2.0 * atan2(sine, q0) / sine if sine > 1e-12 else 2.0
    return np.array([scale * q1, scale * q2, scale * q3])


def from_rotation_vector(vector: Vector) -> Vector:
    """(4,) unit quaternion."""
    x, y, z = vector.tolist()
    angle = sqrt(x * x + y * y + z * z)
    scale = sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    return np.array([cos(0.5 * angle), scale * x, scale * y, scale * z])
