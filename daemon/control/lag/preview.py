"""The reference as it was and as it will be, and whether it turns at once.

A late body is told now what it is to do later, and on a smooth path that is known exactly. At a
corner nothing that is late can follow: there it is led with a velocity that turns over some time,
and begins to a step sooner. So it must be known ahead that there is one.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from math import exp
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np

from drivers.pose import Vector, length

_PASSED_S: Final = 1.1
"""So much of where the reference was is kept: as much as the longest lag is averaged over."""
_AT_ONCE_S: Final = 0.1
"""Within this time a velocity that turns does so at once ..."""
_SMOOTH, _CORNER = 0.3, 0.6
"""... by more than this share of itself: below the one it is a bend, from the other on a corner. A
circle of 8 mm that is gone round at 20 mm/s turns by 0.3."""
_KEPT_LAGS: Final = 1.85
"""For so long, in first-order lags, a corner counts that comes into sight a lag ahead: until it is
passed, and no velocity that is averaged has it in it any more."""
_APPROACH: Final = 0.15
"""Of the first-order lag: time constant in which what is told changes from the one to the other."""
_APPROACH_AT_LEAST_S: Final = 1e-3


class Reference(NamedTuple):
    """Where it is now, and who knows where it will be."""

    t_s: float
    place_mm: Vector
    velocity_mm_s: Vector
    ahead: Callable[[float], tuple[Vector, Vector] | None] | None
    """(3,) mm and (3,) mm/s so many seconds later. None: nobody knows."""


class Preview:
    """Takes the reference step by step."""

    def __init__(self) -> None:
        self.corner = 0.0
        """How far a corner is near, 0 to 1."""
        self._now: Reference | None = None
        self._passed: deque[tuple[float, Vector, Vector]] = deque()
        """Times, and the reference's place and velocity then."""
        self._coming: deque[tuple[float, Vector]] = deque()
        """Times, and the velocity that it will have."""
        self._corners: list[tuple[float, float]] = []
        """Until when they count, and how far: the later ones less."""

    def begin(self) -> None:
        """Motion begins."""
        self._passed.clear()
        self._coming.clear()
        self._corners.clear()
        self.corner = 0.0

    def see(self, now: Reference, dt_s: float, dead_s: float, first_order_s: float) -> None:
        """It has gone on for so long, to lead a body with that dead time and first-order lag."""
        self._now = now
        passed, t_s = self._passed, now.t_s
        if now.ahead is None:
            self.begin()
        passed.append((t_s, now.place_mm, now.velocity_mm_s))
        while len(passed) > 1 and passed[1][0] <= t_s - _PASSED_S:
            passed.popleft()
        coming = self.at(dead_s + first_order_s + 2.0 * dt_s)
        if coming is None:
            return
        turned = self._turned(t_s, coming[1])
        self._corners = [one for one in self._corners if one[0] > t_s and one[1] > turned]
        self._corners.append((t_s + _KEPT_LAGS * first_order_s + 2.0 * dt_s, turned))
        share = 1.0 - exp(-dt_s / max(_APPROACH * first_order_s, _APPROACH_AT_LEAST_S))
        self.corner += share * (self._corners[0][1] - self.corner)

    def _turned(self, t_s: float, velocity_mm_s: Vector) -> float:
        """How far the velocity that comes into sight has turned at once, 0 to 1."""
        coming = self._coming
        coming.append((t_s, velocity_mm_s))
        while len(coming) > 2 and coming[1][0] <= t_s - _AT_ONCE_S:
            coming.popleft()
        before_mm_s = coming[0][1]
        fastest_mm_s = max(length(before_mm_s), length(velocity_mm_s), 1e-9)
        share = length(velocity_mm_s - before_mm_s) / fastest_mm_s
        return min(max((share - _SMOOTH) / (_CORNER - _SMOOTH), 0.0), 1.0)

    def at(self, lead_s: float) -> tuple[Vector, Vector] | None:
        """(3,) mm and (3,) mm/s of the reference so much later, or earlier; None: nobody knows."""
        now = self._now
        if now is None or now.ahead is None:
            return None
        if lead_s >= 0.0:
            return now.ahead(lead_s)
        passed, then_s = self._passed, now.t_s + lead_s
        row = max(bisect_right(passed, then_s, key=itemgetter(0)) - 1, 0)
        was_s, place_mm, velocity_mm_s = passed[row]
        further_s = max(then_s - was_s, 0.0)
        return np.asarray(place_mm + further_s * velocity_mm_s), velocity_mm_s
