"""Whether the tip was taken off at once, by something that nobody told it.

A load that is hung on, or a push, takes the tip off at once. Most of its way back is then to be
told before much of it is seen; the body answers otherwise from there on; and nothing of it is the
path's.

A body that goes twice as far as told, as one does that a load has made soft, is off by more and
more all the time. That is no jump, however fast: it went on before. Who takes it for one forgets
each time how the body answers, and never learns it.

Nor is it one that the tip is off to and fro, as where axes turn back and their play keeps it: what
it was off by then comes back, and neither way is as long as the difference between them.
"""

from bisect import bisect_left
from collections import deque
from operator import itemgetter
from typing import Final, NamedTuple

from drivers.pose import Vector, length

_JUMP_S: Final = 0.3
_JUMP_MM: Final = 4.0
_JUMP_SHARE: Final = 0.6
"""A tip that within this time goes so far, and so much of what it was told to go, otherwise than
told, and otherwise than it did in as long a time before, has been pushed or loaded. Its way back is
not the path's."""
_AFTER_JUMP_S: Final = 1.3
_JUST_S: Final = 0.7
_AFTER_JUMP_LAGS: Final = 2.0
"""For so long, and so many lags, it is on its way: until what was told at first has arrived, which
takes most of it back; and until it follows the path again."""
_UNDONE: Final = 0.7
"""Cosine of the angle between a jump and the one that would undo the last."""
_UNDONE_TIMES: Final = 1.7
"""... and so many times as long, or as short, it is at most: another load is another one."""
_ALIKE: Final = 0.05
"""Nearer to one than this a ratio of gains tells nothing."""


class Jump(NamedTuple):
    """How the tip was taken off at once."""

    from_mm: Vector
    """(3,) where it was before."""
    by_mm: Vector
    """(3,) how far it was taken off within `_JUMP_S`: most of it, where the body is slow."""

    def undoes(self, last: "Jump", ratio: float) -> bool:
        """Whether what this one took off is what the last one hung on, or the other way round.

        A load changes how far the body goes for what it is told, and so how far the tip is from its
        place of rest p0: k times as far. At p it takes the tip off by (k - 1)(p - p0); and whoever
        takes it away at p' does so by (1 / k - 1)(p' - p0). A force that is as large everywhere
        takes the tip off the one way and the other. ratio: k, by which gains have grown since.
        """
        expected = -last.by_mm
        if abs(ratio - 1.0) > _ALIKE:
            from_rest = last.by_mm / (ratio - 1.0) + self.from_mm - last.from_mm
            expected = (1.0 / ratio - 1.0) * from_rest
        expected_mm, by_mm = length(expected), length(self.by_mm)
        if not expected_mm / _UNDONE_TIMES <= by_mm <= expected_mm * _UNDONE_TIMES:
            return False
        return float(expected @ self.by_mm) >= _UNDONE * expected_mm * by_mm


class Disturbance:
    """Takes where the tip was beyond what was told, step by step."""

    def __init__(self) -> None:
        self._lately: deque[tuple[float, Vector, Vector]] = deque()
        """Times, (3,) mm beyond what was told, and (3,) mm that was told and had arrived."""
        self._just_until_s = self._on_its_way_s = -1.0

    def begin(self) -> None:
        """Motion begins."""
        self._lately.clear()
        self._just_until_s = self._on_its_way_s = -1.0

    def add(self, t_s: float, off_mm: Vector, arrived_mm: Vector, lag_s: float) -> Jump | None:
        """(3,) that the tip is beyond what has arrived of what was told, and (3,) that. None: it
        was not taken off at once."""
        lately = self._lately
        lately.append((t_s, off_mm, arrived_mm))
        while len(lately) > 1 and lately[1][0] <= t_s - 2.0 * _JUMP_S:
            lately.popleft()
        first_s, first_mm, _ = lately[0]
        if t_s - first_s < 2.0 * _JUMP_S:
            return None  # nobody knows what it did before
        _, before_mm, arrived_before_mm = lately[
            bisect_left(lately, t_s - _JUMP_S, key=itemgetter(0))
        ]
        told, went_off = arrived_mm - arrived_before_mm, off_mm - before_mm
        jumped = went_off - (before_mm - first_mm)
        least = max(_JUMP_MM**2, _JUMP_SHARE**2 * float(told @ told))
        if min(float(jumped @ jumped), float(went_off @ went_off)) <= least:
            return None
        lags_s = _AFTER_JUMP_LAGS * lag_s
        self._just_until_s = t_s + _JUST_S + lags_s
        self._on_its_way_s = t_s + _AFTER_JUMP_S + lags_s
        lately.clear()  # what was before has been told, and tells of no other jump
        lately.append((t_s, off_mm, arrived_mm))
        return Jump(before_mm + arrived_before_mm, went_off)

    def just_jumped(self, t_s: float) -> bool:
        """Whether the tip was taken off at once, and most of its way back is to be told."""
        return t_s < self._just_until_s

    def jumped(self, t_s: float) -> bool:
        """Whether the tip was taken off at once, and may still be on its way back."""
        return t_s < self._on_its_way_s
