"""What a load makes of the body that it is hung on, as the jump of the tip tells it."""

from math import atan2, cos, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from daemon.control.lag.disturbance import Jump
from drivers.pose import Vector, length

_ALONG: Final = 0.8
"""Cosine of the angle between a jump and the way from straight, from which on it is along that."""
_ONE: Final = np.eye(3)
_Z: Final = np.array([0.0, 0.0, 1.0])
_TIMES: Final = 0.25, 4.0
"""Least and most k: beyond these a body is another one, whatever hangs on it."""
_AT_REST_MM: Final = 5.0
"""A way from rest has a direction where it is some times as long as this."""
_COMES: Final = 0.8
"""Of what a rod on a hinge would do: with 45 g on the arm's circle 0.85 to 1.06 of what is
foretold so comes on the way back from 74 mm, until the last 3 mm before 30."""
_MOST_SHARE: Final = 0.8
"""Of the load that fells it: then it goes as far as with the most k."""
_TURNED: Final = 0.05
"""rad; a tip that is turned less shows nothing of a load."""


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
        grown = times_as_far(jump, self.rest_mm)
        if grown == 1.0:
            return
        before = _turned_rad(jump.from_mm, self.rest_mm)
        after = _turned_rad(jump.from_mm + jump.by_mm, self.rest_mm)
        pulls = after - before + self.hung.share * sin(before)
        share = min(pulls / max(sin(after), _TURNED), _MOST_SHARE)
        times = min(max(self.hung.times * grown, _TIMES[0]), _TIMES[1])
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


def times_as_far(jump: Jump, rest_mm: Vector) -> float:
    """k, as a jump alone tells it of a body whose place of rest, (3,), is known.

    A load that pulls along a straight body bends it k times as far: it takes the tip off,
    across the body, by k - 1 times the way from where it would be straight. That is where it
    rests; or, where chambers that differ bend it as it rests, on the base frame's z axis. Which
    of them, the jump shows by where it points. 1: along neither, and it tells nothing of k.
    """
    along, times = _ALONG, 1.0
    lines = (rest_mm, rest_mm / max(length(rest_mm), 1.0)), (np.zeros(3), _Z)
    for straight_mm, axis in lines:
        bent, by = _across(jump.from_mm - straight_mm, axis), _across(jump.by_mm, axis)
        bent_mm, by_mm, both = length(bent), length(by), float(bent @ by)
        if abs(both) > along * bent_mm * by_mm:
            along, times = abs(both) / (bent_mm * by_mm), 1.0 + by_mm * by_mm / both
    return times


def _turned_rad(tip_mm: Vector, rest_mm: Vector) -> float:
    """α of a tip at (3,), of a body that bends evenly: twice the angle that its base sees."""
    axis = rest_mm / max(length(rest_mm), 1.0)
    return 2.0 * atan2(length(_across(tip_mm, axis)), float(axis @ tip_mm))


def _across(vector: Vector, axis: Vector) -> Vector:
    """(3,) without what is along (3,) of unit length."""
    return np.asarray(vector - float(axis @ vector) * axis)
