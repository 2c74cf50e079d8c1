"""The tip between the tracker and the controller: smoothed, checked for outliers, extrapolated.

A measurement that does not fit the prediction is not believed. Several in a row that fit each
other are: the tip has moved, and the filter begins again from them. So it does at the start, when
there is nothing to compare with, and after a gap too long to bridge.
"""

from collections import deque
from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from config.control import PoseFilterSettings
from drivers.pose import Pose, Quaternion, Vector, conjugate, multiply, product

# A Kalman filter of three values and their rates: constant velocity, white acceleration.
#
# The three are alike and know nothing of each other, so one covariance of value and rate, two by
# two, speaks for all of them. In plain floats: on matrices this small, an array library would spend
# most of a control step on its own overhead.


Triple = tuple[float, float, float]

_ZERO: Triple = (0.0, 0.0, 0.0)


class ConstantVelocity:
    """The values are measured, the rates follow from them. Time passes in `advance`."""

    def __init__(self, noise_variance: float, acceleration_variance: float) -> None:
        """noise_variance: of a measured value. acceleration_variance: constant over a step."""
        self.values = _ZERO
        self.rates = _ZERO
        self._noise = noise_variance
        self._acceleration = self._calm = acceleration_variance
        # Covariance of each value and its rate.
        self._of_value, self._of_both, self._of_rate = noise_variance, 0.0, 0.0

    def begin(self, values: Sequence[float], rate_variance: float) -> None:
        """Forget the past: values that were just measured, with rates that are not known."""
        x, y, z = values
        self.values, self.rates = (x, y, z), _ZERO
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
        self._filter.begin(_ZERO, self._rate_variance)
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
        error.values = _ZERO  # the prediction has taken the turn into the quaternion
        error.correct(innovation)
        self._quaternion = _unit(product(predicted, from_rotation_vector(error.values)))
        error.values = _ZERO

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


FRAMES_FOR_QUALITY = 40
"""A second of them."""
_NS_PER_S = 1e9
_UNIT_WITHIN = 0.05
"""Of a quaternion's length; beyond, it is no rotation. A driver lets less through."""
_FARTHEST_MM = 1e5
"""Beyond, squares of what a filter works with mean nothing. No tracker sees so far."""
_HURRY_S: Final = 0.6
"""A tip that was elsewhere at once was pushed or loaded, and is led back for about so long ..."""
_HURRY: Final = 4.0
"""... by axes that start and stop as fast as they can: at 100 mm/s², some ten times of which the
tip goes, that is 1000 mm/s², which a filter that expects 150 mm/s² loses."""
_TURN_RAD_S = 1.0
_GOES_ON = 0.5
"""Of a jump: a tip that goes so much further in the frames that follow did not go at once."""
"""How fast a tip may turn before anything is known of it: bent round by 180 degrees in 3 s."""


class TipEstimate(NamedTuple):
    """The tip at one time, in the base sensor's frame."""

    t_ns: int
    position_mm: Vector
    """(3,)"""
    velocity_mm_s: Vector
    """(3,)"""
    quaternion: Vector
    """(4,) unit, scalar first; its sign never flips from one estimate to the next."""
    position_std_mm: float
    """Standard deviation of one coordinate, as the filter sees it."""
    age_s: float
    """Since the newest measurement that was believed."""
    quality: float
    """Share of the last frames that were there and believed, 0 to 1."""


class _Innovation(NamedTuple):
    """By how much a measurement differs from what was predicted."""

    ahead_s: float
    """From the state to the measurement."""
    position_mm: Triple
    predicted: Quaternion
    turn_rad: Triple
    """From the predicted orientation to the measured one."""


class PoseFilter:
    """Two Kalman filters, position and orientation, that live and die together."""

    def __init__(self, settings: PoseFilterSettings) -> None:
        self._settings = settings
        self._position = PositionFilter(
            settings.position_noise_mm, settings.acceleration_mm_s2, self._restart_speed
        )
        self._orientation = OrientationFilter(
            settings.orientation_noise_rad, settings.angular_acceleration_rad_s2, _TURN_RAD_S
        )
        self._frames: deque[bool] = deque(maxlen=FRAMES_FOR_QUALITY)
        self.quality = 0.0
        """Share of the last frames that were there and believed; 0 before the first."""
        self._candidates: list[tuple[int, Pose]] = []
        self._left_mm = _ZERO
        """By how much the first candidate differs from what was predicted."""
        self.jumped_mm = 0.0
        """How far the tip went at once, where the newest measurement shows that it did; else 0."""
        self._predict_for_ns = round(settings.predict_for_s * _NS_PER_S)
        self._newest_ns: int | None = None
        self._hurry_until_ns: int | None = None
        self._state_ns = 0
        self._believed_ns: int | None = None
        """None while the filter has not begun."""
        self._last_believed_ns: int | None = None

    def reset(self) -> None:
        """Forget everything."""
        self._frames.clear()
        self.quality = 0.0
        self._candidates.clear()
        self._calm_down()
        self._newest_ns = None
        self._believed_ns = self._last_believed_ns = None

    def update(self, t_ns: int, pose: Pose | None) -> bool:
        """Take one frame, with or without a measurement. True if its measurement was believed.

        A frame that is not newer than the last one is ignored.
        """
        if self._newest_ns is not None and t_ns <= self._newest_ns:
            return False
        self._newest_ns = t_ns
        if self._hurry_until_ns is not None and t_ns > self._hurry_until_ns:
            self._calm_down()
        self.jumped_mm = 0.0
        believed = pose is not None and _sound(pose) and self._take(t_ns, pose)
        self._frames.append(believed)
        self.quality = sum(self._frames) / len(self._frames)
        return believed

    def estimate(self, t_ns: int) -> TipEstimate | None:
        """The tip at `t_ns`, extrapolated at constant velocity; None if that is too long ago."""
        if self._believed_ns is None or t_ns - self._believed_ns > self._predict_for_ns:
            return None
        t_ns = max(t_ns, self._state_ns)
        ahead_s = (t_ns - self._state_ns) / _NS_PER_S
        return TipEstimate(
            t_ns,
            np.array(self._position.position(ahead_s)),
            np.array(self._position.velocity()),
            np.array(self._orientation.quaternion(ahead_s)),
            self._position.standard_deviation(ahead_s),
            (t_ns - self._believed_ns) / _NS_PER_S,
            self.quality,
        )

    def age_s(self, t_ns: int) -> float | None:
        """Since the newest measurement that was believed; None before the first."""
        last_ns = self._last_believed_ns
        return None if last_ns is None else (t_ns - last_ns) / _NS_PER_S

    @property
    def _restart_speed(self) -> float:
        """mm/s that the tip may have when the filter begins: what it could gain in a gap."""
        return self._settings.acceleration_mm_s2 * self._settings.predict_for_s

    def _take(self, t_ns: int, pose: Pose) -> bool:
        if self._believed_ns is None or t_ns - self._believed_ns > self._predict_for_ns:
            self._believed_ns = None
            return self._begin(t_ns, pose)
        innovation = self._compare(t_ns, pose)
        gate = self._settings.outlier_sigma**2
        if not (
            self._position.surprise(innovation.position_mm, innovation.ahead_s) <= gate
            and self._orientation.surprise(innovation.turn_rad, innovation.ahead_s) <= gate
        ):
            return self._begin_elsewhere(t_ns, pose, innovation)
        self._correct(t_ns, innovation)
        self._candidates.clear()
        return True

    def _compare(self, t_ns: int, pose: Pose) -> _Innovation:
        ahead_s = (t_ns - self._state_ns) / _NS_PER_S
        moved_mm = self._position.innovation(pose.position_mm.tolist(), ahead_s)
        predicted = self._orientation.quaternion(ahead_s)
        turn_rad = turn_between(predicted, pose.quaternion.tolist())
        return _Innovation(ahead_s, moved_mm, predicted, turn_rad)

    def _correct(self, t_ns: int, innovation: _Innovation) -> None:
        ahead_s, moved_mm, predicted, turn_rad = innovation
        self._position.update(moved_mm, ahead_s)
        self._orientation.update(predicted, turn_rad, ahead_s)
        self._state_ns = self._believed_ns = self._last_believed_ns = t_ns

    def _begin_elsewhere(self, t_ns: int, pose: Pose, innovation: _Innovation) -> bool:
        """Begin again while it is still known where the tip was, and how it moved. It has jumped if
        it went there at once, and not over all the frames since."""
        first_ns, first = self._candidates[0] if self._candidates else (t_ns, pose)
        moved_mm = np.array(self._position.velocity()) * ((t_ns - first_ns) / _NS_PER_S)
        begun = self._begin(t_ns, pose)
        if len(self._candidates) == 1:
            self._left_mm = innovation.position_mm
        if begun:
            self._hurry_until_ns = t_ns + round(_HURRY_S * _NS_PER_S)
            self._position.hurry(_HURRY)
            self._orientation.hurry(_HURRY)
            went_on_mm = float(np.linalg.norm(pose.position_mm - first.position_mm - moved_mm))
            jumped_mm = hypot(*self._left_mm)
            self.jumped_mm = jumped_mm if went_on_mm < jumped_mm * _GOES_ON else 0.0
        return begun

    def _calm_down(self) -> None:
        self._hurry_until_ns = None
        self._position.hurry(1.0)
        self._orientation.hurry(1.0)

    def _begin(self, t_ns: int, pose: Pose) -> bool:
        """Collect measurements that agree with each other; begin again when they are enough."""
        if self._candidates and not self._agree(self._candidates[-1], (t_ns, pose)):
            self._candidates.clear()
        self._candidates.append((t_ns, pose))
        if len(self._candidates) < self._settings.outliers_in_a_row:
            return False
        self._state_ns, first = self._candidates[0]
        self._position.begin(first.position_mm.tolist())
        self._orientation.begin(first.quaternion.tolist())
        for then_ns, candidate in self._candidates[1:]:
            self._correct(then_ns, self._compare(then_ns, candidate))
        self._candidates.clear()
        return True

    def _agree(self, before: tuple[int, Pose], after: tuple[int, Pose]) -> bool:
        """Whether one tip could have been measured at both."""
        (t0, one), (t1, other) = before, after
        if t1 - t0 > self._predict_for_ns:
            return False
        settings, dt_s = self._settings, (t1 - t0) / _NS_PER_S
        moved = other.position_mm - one.position_mm
        may_move = hypot(sqrt(2) * settings.position_noise_mm, self._restart_speed * dt_s)
        turned = _angle(one.quaternion, other.quaternion)
        may_turn = hypot(sqrt(2) * settings.orientation_noise_rad, _TURN_RAD_S * dt_s)
        near = settings.outlier_sigma
        return float(np.linalg.norm(moved)) <= near * may_move and turned <= near * may_turn


def _sound(pose: Pose) -> bool:
    """A place in this room, and a rotation. NaN is neither."""
    x, y, z = pose.position_mm.tolist()
    if not (abs(x) <= _FARTHEST_MM and abs(y) <= _FARTHEST_MM and abs(z) <= _FARTHEST_MM):
        return False
    q0, q1, q2, q3 = pose.quaternion.tolist()
    if not (abs(q0) <= 2.0 and abs(q1) <= 2.0 and abs(q2) <= 2.0 and abs(q3) <= 2.0):
        return False
    return abs(hypot(q0, q1, q2, q3) - 1.0) <= _UNIT_WITHIN


def _angle(one: Vector, other: Vector) -> float:
    q0, q1, q2, q3 = multiply(conjugate(one), other).tolist()
    return 2.0 * float(np.arctan2(sqrt(q1 * q1 + q2 * q2 + q3 * q3), abs(q0)))
