"""Whether the tip was taken off at once, by something that nobody told it; and what a load makes of
the body that does so.

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
from math import atan2, cos, sin, sqrt
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np

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
_ALONG: Final = 0.8
"""Cosine of the angle between a jump and the way from straight, from which on it is along that."""
_ONE: Final = np.eye(3)
_Z: Final = np.array([0.0, 0.0, 1.0])
_TIMES: Final = 0.25, 4.0
"""Least and most k: beyond these a body is another one, whatever hangs on it."""
_AT_REST_MM: Final = 5.0
"""A way from rest has a direction where it is some times as long as this."""
_COMES: Final = 0.8
"""Of what a rod on a hinge would do: with 45 g on the arm's circle 0.9 to 1.2 of what is foretold
so comes, on the whole way back from 74 to 30 mm."""
_MOST_SHARE: Final = 0.8
"""Of the load that fells it: then it goes as far as with the most k."""
_TURNED: Final = 0.05
"""rad; a tip that is turned less shows nothing of a load."""


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

    def times_as_far(self, rest_mm: Vector) -> float:
        """k, as this one alone tells it of a body whose place of rest, (3,), is known.

        A load that pulls along a straight body bends it k times as far: it takes the tip off,
        across the body, by k - 1 times the way from where it would be straight. That is where it
        rests; or, where chambers that differ bend it as it rests, on the base frame's z axis. Which
        of them, the jump shows by where it points. 1: along neither, and it tells nothing of k.
        """
        along, times = _ALONG, 1.0
        lines = (rest_mm, rest_mm / max(length(rest_mm), 1.0)), (np.zeros(3), _Z)
        for straight_mm, axis in lines:
            bent, by = _across(self.from_mm - straight_mm, axis), _across(self.by_mm, axis)
            bent_mm, by_mm, both = length(bent), length(by), float(bent @ by)
            if abs(both) > along * bent_mm * by_mm:
                along, times = abs(both) / (bent_mm * by_mm), 1.0 + by_mm * by_mm / both
        return times


class Hung(NamedTuple):
    """What hangs on a body, by what the body makes of it."""

    times: float = 1.0
    """k: so many times as far it goes as without. A body that nothing hangs on has 1."""
    share: float = 0.0
    """p, of the load under which it would fall over."""


class Load:
    """What hangs on the body: it makes the tip go K times as far as it is told.

    A load that makes a body soft takes its tip from p to p0 + k (p - p0), where p0 is its place of
    rest. So across that way the tip goes k times as far as it did. Along it a body that is bent far
    goes less than one that is nearly straight, where most of the load pulls along it: with the tip
    turned by α, and α0 without the load, a rod on a hinge with a spring has

        α - p sin α = α0

    and so goes 1 / (1 - p cos α) times as far. Soft arms go about 0.8 times that, for friction
    holds some of it, and under light loads about √k. With the way's direction n

        K = k I + (max(√k, 0.8 / (1 - p cos α)) - k) n nᵀ
    """

    def __init__(self) -> None:
        self.hung = Hung()
        self.rest_mm: Vector | None = None
        """(3,) p0, where the tip is with all axes at zero; None: nobody has seen it there."""

    def hang(self, jump: Jump) -> None:
        """Something was hung on, or taken off, that took the tip off so."""
        if self.rest_mm is None:
            return
        times_as_far = jump.times_as_far(self.rest_mm)
        if times_as_far == 1.0:
            return
        before = _turned_rad(jump.from_mm, self.rest_mm)
        after = _turned_rad(jump.from_mm + jump.by_mm, self.rest_mm)
        pulls = after - before + self.hung.share * sin(before)
        share = min(pulls / max(sin(after), _TURNED), _MOST_SHARE)
        times = min(max(self.hung.times * times_as_far, _TIMES[0]), _TIMES[1])
        self.hung = Hung(times, share)

    def matrix_at(self, tip_mm: Vector) -> Vector:
        """(3, 3) K of a tip at (3,)."""
        times, share = self.hung
        if times == 1.0 or self.rest_mm is None:
            return _ONE
        along = sqrt(times)
        if share > 0.0:
            upright = cos(_turned_rad(tip_mm, self.rest_mm))
            along = max(along, _COMES / (1.0 - share * upright))
        way = tip_mm - self.rest_mm
        less = (along - times) / (float(way @ way) + _AT_REST_MM**2)
        return np.asarray(times * _ONE + less * np.outer(way, way))


def _turned_rad(tip_mm: Vector, rest_mm: Vector) -> float:
    """α of a tip at (3,), of a body that bends evenly: twice the angle that its base sees."""
    axis = rest_mm / max(length(rest_mm), 1.0)
    return 2.0 * atan2(length(_across(tip_mm, axis)), float(axis @ tip_mm))


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


def _across(vector: Vector, axis: Vector) -> Vector:
    """(3,) without what is along (3,) of unit length."""
    return np.asarray(vector - float(axis @ vector) * axis)
