"""The tip between the tracker and the controller: smoothed, checked for outliers, extrapolated.

A measurement that does not fit the prediction is not believed. Several in a row that fit each
other are: the tip has moved, and the filter begins again from them. So it does at the start, when
there is nothing to compare with, and after a gap too long to bridge.
"""

from collections import deque
from math import hypot, sqrt
from typing import Final, NamedTuple

import numpy as np

from config.control import PoseFilterSettings
from daemon.estimation.constant_velocity import (
    ZERO,
    OrientationFilter,
    PositionFilter,
    Triple,
    turn_between,
)
from drivers.pose import Pose, Quaternion, Vector, conjugate, multiply

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
"""How fast a tip may turn before anything is known of it: bent round by 180 degrees in 3 s."""
_GOES_ON = 0.5
"""Of a jump: a tip that goes so much further in the frames that follow did not go at once."""


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
        self._gate = settings.outlier_sigma**2
        """A squared Mahalanobis distance beyond it is not believed."""
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
        self._left_mm = ZERO
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
            return self._begin(t_ns, pose, self._settings.outliers_in_a_row)
        innovation = self._compare(t_ns, pose)
        if not (
            self._position.surprise(innovation.position_mm, innovation.ahead_s) <= self._gate
            and self._orientation.surprise(innovation.turn_rad, innovation.ahead_s) <= self._gate
        ):
            return self._begin_elsewhere(t_ns, pose, innovation, self._settings.outliers_in_a_row)
        if self._goes_on_elsewhere(t_ns, pose, innovation):
            return self._begin_elsewhere(t_ns, pose, innovation, 2)
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

    def _goes_on_elsewhere(self, t_ns: int, pose: Pose, innovation: _Innovation) -> bool:
        """Whether a measurement that may be believed belongs to those that were not. It may, for
        the longer none is believed the less is known of the tip; but corrected by it a filter takes
        a jump for speed, and loses the tip that goes no further. A tip that did take up speed is
        off by more, the longer it goes."""
        if not self._candidates or not self._agree(self._candidates[-1], (t_ns, pose)):
            return False
        first_s = (self._candidates[0][0] - self._state_ns) / _NS_PER_S
        if self._position.surprise(innovation.position_mm, first_s) <= self._gate:
            return False
        went_on_mm = hypot(*_minus(innovation.position_mm, self._left_mm))
        with_speed_mm = hypot(*self._left_mm) * (innovation.ahead_s / first_s - 1.0)
        return went_on_mm < _GOES_ON * with_speed_mm

    def _begin_elsewhere(
        self, t_ns: int, pose: Pose, innovation: _Innovation, in_a_row: int
    ) -> bool:
        """Begin again while it is still known where the tip was, and how it moved. It has jumped if
        it went there at once, and not over all the frames since."""
        first_ns, first = self._candidates[0] if self._candidates else (t_ns, pose)
        moved_mm = np.array(self._position.velocity()) * ((t_ns - first_ns) / _NS_PER_S)
        begun = self._begin(t_ns, pose, in_a_row)
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

    def _begin(self, t_ns: int, pose: Pose, in_a_row: int) -> bool:
        """Collect measurements that agree with each other; begin again when they are so many."""
        if self._candidates and not self._agree(self._candidates[-1], (t_ns, pose)):
            self._candidates.clear()
        self._candidates.append((t_ns, pose))
        if len(self._candidates) < in_a_row:
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


def _minus(one: Triple, other: Triple) -> Triple:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


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
