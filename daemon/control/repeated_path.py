"""A path that is repeated: its places along a cycle, and what they taught.

Along one cycle there are places, evenly in time. What learns from cycle to cycle keeps something
for each of them, and tells by where the reference passed whether it is still the same path.
"""

from math import ceil, sqrt
from typing import Final

import numpy as np

from daemon.control.controller import Phase
from daemon.control.task import within
from drivers.pose import Vector

_SPACING_S: Final = 0.05
"""Some two steps of the tracker's: a tip is not moved to and fro faster."""
_MOST_PLACES: Final = 4000
_SAME_MM: Final = 1.0
"""Beyond what the reference goes between two places: where it passed in the last cycle."""


class RepeatedPath:
    """The places along one cycle, and where the reference passed."""

    def __init__(self, cycle_s: float) -> None:
        self.count = max(2, min(_MOST_PLACES, ceil(cycle_s / _SPACING_S)))
        self.spacing_s = cycle_s / self.count
        self.cycle_s = cycle_s
        self._passed_mm = np.full((self.count, 3), np.nan)

    def place(self, phase_s: float) -> int:
        """The nearest one, so long after the cycle began."""
        return round(phase_s / self.spacing_s) % self.count

    def passes(self, phase: Phase, reference_mm: Vector) -> int:
        """The reference is at (3,) now: the place."""
        place = self.place(phase.seconds)
        self._passed_mm[place] = reference_mm
        return place

    def fits(self, phase: Phase, reference_mm: Vector) -> bool:
        """Whether this is the path: as long, and along the same places."""
        if phase.cycle_s != self.cycle_s:
            return False
        place = self.place(phase.seconds)
        known = self._passed_mm[place]
        if np.isnan(known[0]):
            return True
        ways = [self._passed_mm[k % self.count] - known for k in (place - 1, place + 1)]
        between_mm = max((sqrt(way @ way) for way in ways if not np.isnan(way[0])), default=0.0)
        away = reference_mm - known
        return float(away @ away) <= (_SAME_MM + 2.0 * between_mm) ** 2

    def at(self, values: Vector, phase_s: float) -> tuple[Vector, Vector]:
        """(3,) of (n, 3) values of the places, and (3,) per second by which that changes."""
        where = phase_s / self.spacing_s
        left = int(np.floor(where))
        here, there = values[left % self.count], values[(left + 1) % self.count]
        return here + (where - left) * (there - here), (there - here) / self.spacing_s


# What the places taught.
#
# Each has a correction c of the reference, which is led like the reference itself: so the tip shows
# c without delay, and an error e that is seen at a place belongs to that place. c becomes
# Q(0.98 c + 0.8 e), a step of iterative learning control (Bristow, Tharayil and Alleyne, IEEE
# Control Systems 26, 2006). Q, a triangle, keeps noise out of it, and what the body is too slow
# for. Every place is renewed once in a cycle, shortly after the tip has shown what became of it and
# long before the path comes there again: nothing jumps where one cycle goes over into the next.


_HALF_WIDTH_S: Final = 0.2
_HALF_WIDTH_BY_LAG: Final = 0.7
"""... of the lag, where that is more: what a body is late for is led with an error of its own."""
_KEPT: Final = 0.98
_TAKEN, _TAKEN_LATER = 0.4, 0.8
"""Of the first cycle's errors, and of later ones'. The first one's are those of a body that is
still being found, too."""
_MOST_TAKEN_MM: Final = 5.0
"""No error counts as more: whatever made it was hardly the path."""
_FARTHEST_MM: Final = 15.0
_SET_OUT_S: Final = 0.5
"""... and a lag after the path begins, the tip still comes from rest, which no cycle repeats."""


class CycleCorrection:
    """Takes errors by phase, gives corrections by phase. For one path."""

    def __init__(self, cycle_s: float, lag_s: float = 0.0) -> None:
        """lag_s: of the body, as it is known when the path begins."""
        self.path = RepeatedPath(cycle_s)
        half_width_s = max(_HALF_WIDTH_S, _HALF_WIDTH_BY_LAG * lag_s)
        self._half = max(1, round(half_width_s / self.path.spacing_s))
        weights = self._half - np.abs(np.arange(1 - self._half, self._half))
        self._weights = weights / weights.sum()
        self._corrections = np.zeros((self.path.count, 3))
        self._next = np.zeros((self.path.count, 3))
        """0.98 c + 0.8 e of each place, when e was seen last."""
        self._place: int | None = None
        self._errors: list[Vector] = []
        self._along_s = 0.0

    def at(self, phase_s: float) -> tuple[Vector, Vector]:
        """(3,) mm to add to the reference, and (3,) mm/s by which that changes."""
        return self.path.at(self._corrections, phase_s)

    def break_off(self) -> None:
        """What comes next does not go on from here. What was learnt stays."""
        self._place, self._along_s = None, 0.0
        self._errors.clear()

    def add(
        self, phase: Phase, dt_s: float, lag_s: float, error_mm: Vector, reference_mm: Vector
    ) -> None:
        """(3,) from the tip to its reference."""
        self._along_s += phase.pace * dt_s
        place = self.path.passes(phase, reference_mm)
        if self._along_s < _SET_OUT_S + lag_s:
            return
        if place != self._place:
            if self._place is not None:
                self._take_up_to(place, self._place, np.mean(self._errors, axis=0))
            self._place = place
            self._errors.clear()
        self._errors.append(within(error_mm, _MOST_TAKEN_MM))

    def _take_up_to(self, end: int, place: int, error_mm: Vector) -> None:
        """What was seen at a place is true up to the next one that was passed: where the tip is
        seen less often than there are places, all of them learn."""
        passed = min((end - place) % self.path.count, self._half)
        for further in range(passed):
            self._take((place + further) % self.path.count, error_mm)

    def _take(self, place: int, error_mm: Vector) -> None:
        """The error at a place is known; so is all that the one half a width before needs."""
        count = self.path.count
        taken = _TAKEN if self._along_s < self.path.cycle_s else _TAKEN_LATER
        self._next[place] = _KEPT * self._corrections[place] + taken * error_mm
        middle = place - self._half + 1
        around = np.arange(middle - self._half + 1, middle + self._half) % count
        self._corrections[middle % count] = within(self._weights @ self._next[around], _FARTHEST_MM)
