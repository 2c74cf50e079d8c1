"""What moves the tip besides what it is told: how that changes, and whether it came at once.

A Jacobian that is a little wrong, a hysteresis that turns and a body that creeps take the tip off
more and more, and go on doing so for a while. A body that answers late shows it only when it is too
late; so what is off is told to be led as it will be when what is told now arrives, along the line
through what was seen lately. Noise makes lines, too: their slope is believed as far as it is larger
than noise would make it (the positive part of James and Stein's estimator, 1961).

A load that is hung on, or a push, takes the tip off at once. No line goes through that, and nothing
of it is the path's.
"""

from collections import deque
from typing import Final

import numpy as np

from drivers.pose import Vector

_LINE_S: Final = 0.5
_FULL: Final = 0.8
"""Of that time must have been seen."""
_NOISE_MM_S: Final = 2.0
"""Slopes that noise of 0.3 mm in each coordinate makes in that time, and hysteresis with it."""

_JUMP_S: Final = 0.3
_JUMP_MM: Final = 4.0
_JUMP_SHARE: Final = 0.6
"""A tip that within this time goes so far, and so much of what it was told to go, otherwise than
told has been pushed or loaded. Its way back is not the path's."""
_AFTER_JUMP_S: Final = 1.0
_JUST_S: Final = 0.4
_AFTER_JUMP_LAGS: Final = 2.0
"""For so long, and so many lags, it is on its way: until what was told at first has arrived, which
takes most of it back; and until it follows the path again."""


class Disturbance:
    """Takes where the tip was beyond what was told, step by step."""

    def __init__(self) -> None:
        self._lately: deque[tuple[float, Vector, Vector]] = deque()
        """Times, (3,) mm beyond what was told, and (3,) mm that was told and had arrived."""
        self._line_from_s = 0.0
        self._just_until_s = self._on_its_way_s = -1.0

    def begin(self) -> None:
        """Motion begins."""
        self._lately.clear()
        self._just_until_s = self._on_its_way_s = -1.0

    def add(self, t_s: float, off_mm: Vector, arrived_mm: Vector, lag_s: float) -> None:
        """(3,) that the tip is beyond what has arrived of what was told, and (3,) that."""
        lately = self._lately
        if not lately:
            self._line_from_s = t_s
        lately.append((t_s, off_mm, arrived_mm))
        while t_s - lately[0][0] > _LINE_S:
            lately.popleft()
        before = next(one for one in lately if t_s - one[0] <= _JUMP_S)
        jumped, told = off_mm - before[1], arrived_mm - before[2]
        if float(jumped @ jumped) > max(_JUMP_MM**2, _JUMP_SHARE**2 * float(told @ told)):
            lags_s = _AFTER_JUMP_LAGS * lag_s
            self._just_until_s = t_s + _JUST_S + lags_s
            self._on_its_way_s = t_s + _AFTER_JUMP_S + lags_s
            self._line_from_s = t_s

    def just_jumped(self, t_s: float) -> bool:
        """Whether the tip was taken off at once, and most of its way back is to be told."""
        return t_s < self._just_until_s

    def jumped(self, t_s: float) -> bool:
        """Whether the tip was taken off at once, and may still be on its way back."""
        return t_s < self._on_its_way_s

    def change_mm(self, horizon_s: float) -> Vector:
        """(3,) by which the tip will be further off after that time, told nothing more."""
        seen = [one for one in self._lately if one[0] >= self._line_from_s]
        if not seen or seen[-1][0] - seen[0][0] < _FULL * _LINE_S:
            return np.zeros(3)
        times = np.array([one[0] for one in seen])
        times -= times.mean()
        slope = times @ np.array([one[1] for one in seen]) / (times @ times)
        squared = float(slope @ slope)
        believed = max(0.0, 1.0 - _NOISE_MM_S**2 / squared) if squared > 0.0 else 0.0
        return np.asarray(horizon_s * believed * slope)
