"""Position and velocity of the tip: constant velocity, disturbed by white acceleration."""

from math import sqrt

import numpy as np

from daemon.estimation.constant_velocity import (
    advance,
    begin,
    constant_velocity,
    value_variance,
)
from drivers.pose import Vector


class PositionFilter:
    """State (6,): position in mm, then velocity in mm/s. The coordinates are alike."""

    def __init__(self, noise_mm: float, acceleration_mm_s2: float, speed_mm_s: float) -> None:
        """speed_mm_s: standard deviation of the velocity when the filter begins."""
        self._variance = noise_mm**2
        self._acceleration_variance = acceleration_mm_s2**2
        self._speed_variance = speed_mm_s**2
        self._filter = constant_velocity(self._variance)

    def begin(self, position_mm: Vector) -> None:
        """At this measured position, with a velocity that is not known."""
        begin(self._filter, self._variance, self._speed_variance)
        self._filter.x[:3, 0] = position_mm

    def surprise(self, position_mm: Vector, ahead_s: float) -> float:
        """Squared Mahalanobis distance of a measurement, this long after the state."""
        offset = position_mm - self.position(ahead_s)
        variance = self._position_variance(ahead_s) + self._variance
        return float(offset @ offset) / variance

    def update(self, position_mm: Vector, ahead_s: float) -> None:
        """Move the state ahead and correct it."""
        advance(self._filter, ahead_s, self._acceleration_variance)
        self._filter.predict()
        self._filter.update(position_mm)

    def position(self, ahead_s: float) -> Vector:
        """(3,) extrapolated."""
        x = self._filter.x
        return np.asarray(x[:3, 0] + ahead_s * x[3:, 0])

    def velocity(self) -> Vector:
        """(3,)"""
        return np.asarray(self._filter.x[3:, 0].copy())

    def standard_deviation(self, ahead_s: float) -> float:
        """Of one extrapolated coordinate, mm."""
        return sqrt(self._position_variance(ahead_s))

    def _position_variance(self, ahead_s: float) -> float:
        return value_variance(self._filter, ahead_s, self._acceleration_variance)
