"""Kalman filters of a place and of a direction that go on at constant velocity.

What is measured disturbs them as noise, what the body does as white acceleration. They say how much
a measurement surprises them; who uses them decides whether to believe it.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt

from drivers.pose import Quaternion, product

# A Kalman filter of three values and their rates: constant velocity, white acceleration.
#
# The three are alike and know nothing of each other, so one covariance of value and rate, two by
# two, speaks for all of them. In plain floats: on matrices this small, an array library would spend
# most of a control step on its own overhead.


Triple = tuple[float, float, float]

ZERO: Triple = (0.0, 0.0, 0.0)


class ConstantVelocity:
    """The values are measured, the rates follow from them. Time passes in `advance`."""

    def __init__(self, noise_variance: float, acceleration_variance: float) -> None:
        """noise_variance: of a measured value. acceleration_variance: constant over a step."""
        self.values = ZERO
        self.rates = ZERO
        self._noise = noise_variance
        self._acceleration = self._calm = acceleration_variance
        # Covariance of each value and its rate.
        self._of_value, self._of_both, self._of_rate = noise_variance, 0.0, 0.0

    def begin(self, values: Sequence[float], rate_variance: float) -> None:
        """Forget the past: values that were just measured, with rates that are not known."""
        x, y, z = values
        self.values, self.rates = (x, y, z), ZERO
        self._of_value, self._of_both, self._of_rate = self._noise, 0.0, rate_variance

    def hurry(self, times: float) -> None:
        """From now on the rates change so many times as fast as they do usually."""
        self._acceleration = times * times * self._calm

    def ahead(self, ahead_s: float) -> Triple:
        """The values, extrapolated."""
        (x, y, z), (u, v, w) = self.values, self.rates
        return x + ahead_s * u, y + ahead_s * v, z + ahead_s * w

    def variance(self, ahead_s: float) -> float:
        """Of one value, extrapolated."""
        known = self._of_value + 2.0 * ahead_s * self._of_both + ahead_s**2 * self._of_rate
        return known + 0.25 * ahead_s**4 * self._acceleration

    def surprise(self, innovation: Triple, ahead_s: float) -> float:
        """Squared Mahalanobis distance of measured values, this long after the state.

        innovation: by how much they differ from what was extrapolated.
        """
        x, y, z = innovation
        return (x * x + y * y + z * z) / (self.variance(ahead_s) + self._noise)

    def advance(self, dt_s: float) -> None:
        """Predict `dt_s` ahead: P becomes F P Fᵀ + σ² g gᵀ, with g = (dt²/2, dt)."""
        self.values = self.ahead(dt_s)
        self._of_value = self.variance(dt_s)
        self._of_both += dt_s * self._of_rate + 0.5 * dt_s**3 * self._acceleration
        self._of_rate += dt_s**2 * self._acceleration

    def correct(self, innovation: Triple) -> None:
        """Take measured values of this moment. innovation: by how much they differ from ours."""
        all_in_all = self._of_value + self._noise
        gain, rate_gain = self._of_value / all_in_all, self._of_both / all_in_all
        (x, y, z), (u, v, w), (a, b, c) = self.values, self.rates, innovation
        self.values = (x + gain * a, y + gain * b, z + gain * c)
        self.rates = (u + rate_gain * a, v + rate_gain * b, w + rate_gain * c)
        self._of_rate -= rate_gain * self._of_both
        self._of_both *= self._noise / all_in_all
        self._of_value = gain * self._noise


# Position and velocity of the tip: constant velocity, disturbed by white acceleration.


class PositionFilter:
    """Position in mm and velocity in mm/s. The coordinates are alike."""

    def __init__(self, noise_mm: float, acceleration_mm_s2: float, speed_mm_s: float) -> None:
        """speed_mm_s: standard deviation of the velocity when the filter begins."""
        self._speed_variance = speed_mm_s**2
        self._filter = ConstantVelocity(noise_mm**2, acceleration_mm_s2**2)

    def begin(self, position_mm: Sequence[float]) -> None:
        """At this measured position, with a velocity that is not known."""
        self._filter.begin(position_mm, self._speed_variance)

    def hurry(self, times: float) -> None:
        """The tip speeds up and slows down so many times as fast as it does usually."""
        self._filter.hurry(times)

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


# Orientation and angular velocity of the tip: an error-state filter on unit quaternions.
#
# The orientation itself is a quaternion beside the filter. What is filtered is the small rotation
# between it and the truth, in the tip's own frame; after every correction this is turned into the
# quaternion and is zero again. So there is neither a norm to keep nor a direction that cannot be
# told.


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
        self._filter.begin(ZERO, self._rate_variance)
        w, x, y, z = _unit(quaternion)
        v = self._quaternion
        same = not self._began or v[0] * w + v[1] * x + v[2] * y + v[3] * z >= 0.0
        self._quaternion = (w, x, y, z) if same else (-w, -x, -y, -z)
        self._began = True

    def hurry(self, times: float) -> None:
        """The tip begins and ends to turn so many times as fast as it does usually."""
        self._filter.hurry(times)

    def surprise(self, innovation: Triple, ahead_s: float) -> float:
        """Squared Mahalanobis distance of a measurement, this long after the state."""
        return self._filter.surprise(innovation, ahead_s)

    def update(self, predicted: Quaternion, innovation: Triple, ahead_s: float) -> None:
        """Move the state ahead, to where it was predicted, and correct it."""
        error = self._filter
        error.advance(ahead_s)
        error.values = ZERO  # the prediction has taken the turn into the quaternion
        error.correct(innovation)
        self._quaternion = _unit(product(predicted, from_rotation_vector(error.values)))
        error.values = ZERO

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
