"""Position and velocity of the tip: constant velocity, disturbed by white acceleration."""

from collections.abc import Sequence
from math import sqrt

from daemon.estimation.constant_velocity import ConstantVelocity, Triple


class PositionFilter:
    """Position in mm and velocity in mm/s. The coordinates are alike."""

    def __init__(self, noise_mm: float, acceleration_mm_s2: float, speed_mm_s: float) -> None:
        """speed_mm_s: standard deviation of the velocity when the filter begins."""
        self._speed_variance = speed_mm_s**2
        self._filter = ConstantVelocity(noise_mm**2, acceleration_mm_s2**2)

    def begin(self, position_mm: Sequence[float]) -> None:
        """At this measured position, with a velocity that is not known."""
        self._filter.begin(position_mm, self._speed_variance)

    def innovation(self, position_mm: Sequence[float], ahead_s: float) -> Triple:
        """By how much a measurement differs from what is extrapolated."""
        (x, y, z), (a, b, c) = position_mm, self._filter.ahead(ahead_s)
        return x - a, y - b, z - c

    def surprise(self, innovation: Triple, ahead_s: float) -> float:
        """Squared Mahalanobis distance of a measurement, this long after the state."""
        return self._filter.surprise(innovation, ahead_s)

    def update(self, innovation: Triple, ahead_s: float) -> None:
        """Move the state ahead and correct it."""
        self._filter.advance(ahead_s)
        self._filter.correct(innovation)

    def position(self, ahead_s: float) -> Triple:
        """Extrapolated."""
        return self._filter.ahead(ahead_s)

    def velocity(self) -> Triple:
        return self._filter.rates

    def standard_deviation(self, ahead_s: float) -> float:
        """Of one extrapolated coordinate, mm."""
        return sqrt(self._filter.variance(ahead_s))
