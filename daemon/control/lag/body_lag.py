"""How late the body answers, found while it is followed, and what of the told motion is under way.

What the controller tells the axes moves the tip after a dead time T and with a lag τ. For control
their sum h counts: a tip on a smooth path is where it was told to be h ago. A path tells the sum
well and its parts badly, so they are taken as fixed shares of it. Steps tell the parts, too.

The told motion x is the sum of J Δu, in mm of the tip. For many delays at once the tip's motions
over a short span are compared with those of x so much earlier, axis by axis of space with a gain of
its own, because J is never exact. The delay whose gains leave least unexplained is the lag. Gains
across the axes of space would explain a circle with any delay, as a turn.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from math import exp, inf
from typing import Final, NamedTuple

import numpy as np

from daemon.control.lag import lag_kernels as kernels
from daemon.learning.samples.motion import DEAD_SHARE
from drivers.pose import Vector

KNOWN_LAG: Final = "body_lag"
"""In a file: the lag in s, and its share of dead time."""
LONGEST_S = 1.6
"""No lag beyond this is looked for."""
DEAD_SHARES: Final = (DEAD_SHARE, 0.05, 0.15, 0.25, 0.6, 0.85)
"""That steps can tell from each other: a prediction with the next one is off by an eighth of a lag
at most. With none below the usual one a body that is late by a first-order lag of 0.7 s and a dead
time of 0.2 s looks a fifth more prompt than it is; with none below 0.25 one without a dead time,
but its drives' and the tracker's of 0.05 s, half as late as it is; and without 0.15 one of 0.1 s is
off by up to a half. With all of these the sum is known to a tenth."""
_LATE_S = 0.25
"""No dead time below the usual one is believed of a lag that is shorter: a prompt body's is mostly
its drives' and the tracker's, and taken for less a load is made up for 0.07 s later. A body of
this lag is prompt still to `probing`; with 0.4 arms of 0.3 s are up to a fifth farther off."""
_SPACING_S = 0.05
_SPAN_S = 0.4
"""Of the motions that are compared: longer than noise and shorter than a turn."""
_KEPT_S = max(DEAD_SHARES) * LONGEST_S + _SPAN_S
_ROWS = 256
"""To begin with: some seconds, and room to go on."""
_MEMORY_S = 12.0
"""Of motion. Then a third is left of what was seen."""
_GAIN_MEMORY_S = 6.0
_USUAL_STEP_S = 0.025
"""From one span to the next, of which each counts as one: spans of a slower tracker count as more.
"""
_MOVED_MM = 0.3
"""A span in which the tip was neither told to move so far nor did tells nothing but noise."""
_SEEN_AT_LEAST_S = 3.0
"""Of motion on a path, before it tells anything ..."""
_STEPS_AT_LEAST_S = 1.2
"""... and of steps."""
_EXPLAINED = 0.5
"""Of the tip's motion on a path, by the best delay. A load or a push moves it untold."""
_STEPS_EXPLAINED = 0.2
"""... and of steps, of which a body with a lag of a second makes little, and late, while hysteresis
and noise are as large as ever."""
_CLEARER, _AT_LEAST = 0.05, 2e-3
"""Share of what the best delay leaves unexplained, and of all motion, by which it must be better.
So a slow circle does not tell a tenth of a second, which there makes no difference either."""
_GAINS: Final = 0.5, 2.0
"""Beyond these the Jacobian is wrong otherwise than by a gain."""
_ONE_MM2 = 50.0
"""As much motion with a gain of 1 as is taken for seen before anything is: 0.3 mm of noise and
hysteresis in a span, against gains that differ by a quarter, and sixteen spans that overlap."""
_FREE_MM2 = 1.0
"""... where gains are free: of steps, which tell a lag whatever comes of them."""
_GAIN_PRICE = 0.2
"""Share of all motion as which a gain of 2 or 0 counts where delays are compared. A straight way
that begins slowly is explained as well by any lag with a gain to it."""
_ALIKE = 0.1
"""... and this share of all motion with the gain of all of it: a coordinate in which the tip hardly
goes shows little but noise, which would make its gain too small."""
_APPROACH_S = 1.0
"""Time constant of the way to what was found: nothing jumps."""


class _Found(NamedTuple):
    """A delay, and shares of all motion."""

    delay_s: float
    left: float
    """That it leaves unexplained."""
    today_s: float
    """... and that today's does."""


class BodyLag:
    """Takes what was told and what was seen, step by step; gives the lag as it is known."""

    def __init__(self, lag_s: float = 0.0, dead_shares: Sequence[float] = DEAD_SHARES[:1]) -> None:
        """lag_s: as it is known before anything moves. dead_shares: of a lag, to be told from each
        other until `settle`, as steps can (`DEAD_SHARES`); the first is the usual one."""
        self.lag_s = lag_s
        """The sum of dead time and lag."""
        self.dead_share = dead_shares[0]
        """... and how much of it is dead time."""
        self._delays = np.arange(0.0, LONGEST_S + 1e-9, _SPACING_S)
        self._shares = np.array(dead_shares)
        self._dead_s = np.outer(self._shares, self._delays).ravel()
        self._first_order_s = np.maximum(np.outer(1.0 - self._shares, self._delays).ravel(), 1e-9)
        self._track = _Track(len(self._dead_s))
        self._sums = np.zeros((3, len(self._dead_s), 3))
        """xx, xy and yy by share, delay and coordinate, mm²."""
        self._gain_sums = np.zeros((2, len(self._dead_s), 3))
        """xx and xy, which forget faster: a gain differs from place to place, and a lag hardly."""
        self._seen_s = 0.0
        self._settled = False

    def take_for(self, lag_s: float, dead_share: float) -> None:
        """So late the body is, as other motions have told. It is looked for further on."""
        self.lag_s, self.dead_share = lag_s, dead_share
        if len(self._shares) == 1:
            self._shares = np.array([dead_share])
            self._dead_s = dead_share * self._delays
            self._first_order_s = np.maximum(self._delays - self._dead_s, 1e-9)

    def to_arrays(self) -> dict[str, Vector]:
        """What `known_lag` reads again."""
        return {KNOWN_LAG: np.array([self.lag_s, self.dead_share])}

    def break_off(self) -> None:
        """What comes next does not go on from here. What was found stays."""
        self._track.clear()

    def add(self, t_s: float, dt_s: float, told_mm: Vector, tip_mm: Vector) -> None:
        """At `t_s` all that was told so far came to (3,) x, and the tip is at (3,)."""
        track = self._track
        last_s = track.add(t_s, told_mm, tip_mm)
        if last_s is None:
            return
        kernels.arrive(
            track.times, track.told_mm, track.arrived_mm, self._dead_s, self._first_order_s
        )
        track.drop_before(t_s - _KEPT_S)
        if t_s - track.times[0] < _SPAN_S:
            return
        first = int(np.searchsorted(track.times, t_s - _SPAN_S))
        kept = np.array([exp(-dt_s / _MEMORY_S), exp(-dt_s / _GAIN_MEMORY_S)])
        weight = dt_s / _USUAL_STEP_S
        sums, gain_sums = self._sums, self._gain_sums
        arrived, tips = track.arrived_mm, track.tip_mm
        if not kernels.add_span(first, arrived, tips, sums, gain_sums, kept, weight, _MOVED_MM):
            return
        self._seen_s = kept[0] * self._seen_s + dt_s
        self._approach(dt_s)

    @property
    def by_steps_s(self) -> float | None:
        """As the steps that were made so far tell it; None: they tell nothing yet."""
        found = self._found(free=True)
        return None if found is None else found.delay_s

    def settle(self) -> bool:
        """Go by what explains best what was seen so far, and by a path only where that has it
        shorter.

        For motions that tell a lag well. Hysteresis and creep, which a path shows more of, look
        like more lag than there is; play, of which small motions show more, does so as well. False:
        they told nothing, and the lag is looked for further on.
        """
        count, best = len(self._delays), 0
        found = [self._found(True, row) for row in range(len(self._shares))]
        told = [row for row, one in enumerate(found) if one is not None and self._may_be(row, one)]
        if told:
            best = self._best_share(told, [_least(one) for one in found])
            one = found[best]
            assert one is not None
            self.lag_s, self.dead_share = one.delay_s, float(self._shares[best])
        self._settled = bool(told)
        here = slice(best * count, (best + 1) * count)
        self._shares = self._shares[best : best + 1]
        self._dead_s, self._first_order_s = self._dead_s[here], self._first_order_s[here]
        self._sums, self._gain_sums = np.zeros((3, count, 3)), np.zeros((2, count, 3))
        self._seen_s = 0.0
        self._track = _Track(count)
        return self._settled

    def _best_share(self, told: Sequence[int], left: Sequence[float]) -> int:
        """The row of the share that leaves least. Where the usual one leaves hardly more it is that
        one, and of shares below it the largest of those that leave hardly more: hysteresis and
        creep, which come late, look like more lag and less of a dead time."""
        shares = self._shares
        best = min(told, key=lambda row: left[row])
        most = (1.0 + _CLEARER) * left[best]
        alike = [row for row in told if row == best or left[row] < most]
        if 0 in alike:
            return 0
        if shares[best] > shares[0]:
            return best
        return max((row for row in alike if shares[row] < shares[0]), key=lambda row: shares[row])

    def _may_be(self, row: int, found: _Found) -> bool:
        return bool(self._shares[row] >= self._shares[0]) or found.delay_s >= _LATE_S

    @property
    def gains(self) -> Vector:
        """(3,) how much more the tip goes along x, y and z than it is told; 1 where that is not
        clear."""
        if self._seen_s < _SEEN_AT_LEAST_S:
            return np.ones(3)
        gains = kernels.gains(self._delays, self.lag_s, self._gain_sums, _ONE_MM2, _ALIKE)
        return np.asarray(np.clip(gains, *_GAINS))

    def gain_memory(self) -> Vector:
        """What the gains are told from, for `recall_gains`."""
        return self._gain_sums.copy()

    def recall_gains(self, memory: Vector) -> None:
        """The body is again as it was when `gain_memory` gave that."""
        self._gain_sums = memory.copy()

    def _found(self, free: bool, row: int = 0) -> _Found | None:
        """What leaves least unexplained with that share of dead time. None: what was seen tells
        nothing. free: whether any gain is as good."""
        count = len(self._delays)
        xx, xy, yy = self._sums[:, row * count : (row + 1) * count]
        whole = float(yy[0].sum())
        if self._seen_s < (_STEPS_AT_LEAST_S if free else _SEEN_AT_LEAST_S) or not whole > 0.0:
            return None
        left = _unexplained(xx, xy, yy, free).sum(axis=1) / whole
        best = int(np.argmin(left))
        if best == len(left) - 1 or left[best] > 1.0 - (_STEPS_EXPLAINED if free else _EXPLAINED):
            return None
        here = float(np.interp(self.lag_s, self._delays, left))
        return _Found(_lowest(self._delays, left, best), float(left[best]), here)

    def _approach(self, dt_s: float) -> None:
        found = self._found(free=False)
        if found is None:
            return
        lag_s, least, here = found
        if self._settled and lag_s > self.lag_s:
            return
        if here - least >= _CLEARER * least + _AT_LEAST:
            self.lag_s += (1.0 - exp(-dt_s / _APPROACH_S)) * (lag_s - self.lag_s)


def known_lag(arrays: Mapping[str, Vector]) -> tuple[float, float] | None:
    """The lag and its share of dead time that `BodyLag.to_arrays` gave; None: nobody knew them.

    Raises ValueError for what cannot be.
    """
    if KNOWN_LAG not in arrays:
        return None
    known = arrays[KNOWN_LAG]
    if known.shape != (2,) or not ((known >= 0.0) & (known <= (2.0 * LONGEST_S, 1.0))).all():
        raise ValueError(f"how late the body is, is {known.tolist()}")
    return float(known[0]), float(known[1])


class _Track:
    """The last seconds, row by row: times, what was told, what of it had arrived by each delay, and
    where the tip was. In arrays of which a part is looked at: to make them anew from their rows in
    every step would cost more than all that is done with them."""

    def __init__(self, delays: int) -> None:
        self._begin = self._end = 0
        self._times = np.zeros(_ROWS)
        self._told_mm, self._tip_mm = np.zeros((_ROWS, 3)), np.zeros((_ROWS, 3))
        self._arrived_mm = np.zeros((_ROWS, delays, 3))

    @property
    def times(self) -> Vector:
        """(n,) s"""
        return self._times[self._begin : self._end]

    @property
    def told_mm(self) -> Vector:
        """(n, 3)"""
        return self._told_mm[self._begin : self._end]

    @property
    def tip_mm(self) -> Vector:
        """(n, 3)"""
        return self._tip_mm[self._begin : self._end]

    @property
    def arrived_mm(self) -> Vector:
        """(n, k, 3) by delay."""
        return self._arrived_mm[self._begin : self._end]

    def clear(self) -> None:
        """Nothing was seen yet."""
        self._begin = self._end = 0

    def add(self, t_s: float, told_mm: Vector, tip_mm: Vector) -> float | None:
        """A row more, as if all that was told had arrived. The time of the one before, if any."""
        if self._end == len(self._times):
            self._move_up()
        row, last = self._end, self._end - 1
        self._times[row], self._told_mm[row], self._tip_mm[row] = t_s, told_mm, tip_mm
        self._arrived_mm[row] = told_mm
        self._end += 1
        return float(self._times[last]) if last >= self._begin else None

    def drop_before(self, t_s: float) -> None:
        """Rows from before that are not needed any more."""
        self._begin += int(np.searchsorted(self.times, t_s))

    def _move_up(self) -> None:
        """To the beginning; into arrays twice as long where they are half full."""
        rows = self._end - self._begin
        longer = 2 if 2 * rows > len(self._times) else 1
        arrays = self._times, self._told_mm, self._tip_mm, self._arrived_mm
        self._times, self._told_mm, self._tip_mm, self._arrived_mm = (
            _moved_up(array, self._begin, longer) for array in arrays
        )
        self._begin, self._end = 0, rows


def _moved_up(array: Vector, begin: int, longer: int) -> Vector:
    """The rows from `begin` on, first, in an array so many times as long."""
    moved = np.zeros((longer * len(array), *array.shape[1:]))
    moved[: len(array) - begin] = array[begin:]
    return moved


def _unexplained(xx: Vector, xy: Vector, yy: Vector, free: bool) -> Vector:
    """(k, 3) mm² of motion that each delay leaves, with its best gains d + 1, and what these cost.

    d is xz / (xx + λ) where z is what the tip went more than it was told.
    """
    xz = xy - xx
    zz = yy - 2.0 * xy + xx
    dear = _FREE_MM2 if free else _ONE_MM2 + _GAIN_PRICE * xx.sum(axis=1, keepdims=True)
    return np.asarray(zz - xz**2 / (xx + dear))


def _least(found: _Found | None) -> float:
    return inf if found is None else found.left


def _lowest(delays: Vector, left: Vector, best: int) -> float:
    """Where the parabola through the lowest value and its neighbours has its lowest point."""
    if best == 0:
        return 0.0
    before, here, after = left[best - 1 : best + 2].tolist()
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(delays[best] + shift * (delays[1] - delays[0]))


class Underway:
    """What was told and has not arrived: the tip will be there without being told more. Of one tip,
    (3,), or of several that are told differently, (k, 3)."""

    def __init__(self) -> None:
        self.told_mm = np.zeros(3)
        """All that was told."""
        self._arrived_mm = np.zeros(3)
        self._coming_mm = np.zeros(3)
        """What will have arrived when the dead time is over: a lag is the same before it."""
        self._waiting: deque[tuple[float, Vector]] = deque()

    def begin(self) -> None:
        """Everything has arrived."""
        self._arrived_mm = self._coming_mm = self.told_mm
        self._waiting.clear()

    def tell(
        self,
        t_s: float,
        dt_s: float,
        moved_mm: Vector,
        lag_s: float,
        dead_share: float = DEAD_SHARE,
    ) -> None:
        """By `t_s` (3,) more was told, evenly since the last time. lag_s: of the body, as a sum."""
        dead_s, first_order_s = parts(lag_s, dead_share)
        told_then, waiting = self.told_mm, self._waiting
        self.told_mm = told_then + moved_mm
        if not waiting:
            waiting.append((t_s - dt_s, told_then))
        waiting.append((t_s, self.told_mm))
        while len(waiting) > 2 and waiting[1][0] <= t_s - dt_s - dead_s:
            waiting.popleft()
        then, now = self._told_by(t_s - dt_s - dead_s), self._told_by(t_s - dead_s)
        self._arrived_mm = _through_lag(self._arrived_mm, then, now, dt_s, first_order_s)
        then, now = told_then, self.told_mm
        self._coming_mm = _through_lag(self._coming_mm, then, now, dt_s, first_order_s)

    def _told_by(self, t_s: float) -> Vector:
        """(3,) what was told by then, of what is waiting still."""
        before_s, before = self._waiting[0]
        for after_s, after in self._waiting:
            if after_s >= t_s:
                break
            before_s, before = after_s, after
        if not before_s < t_s <= after_s:
            return before if t_s <= before_s else after
        return np.asarray(before + (t_s - before_s) / (after_s - before_s) * (after - before))

    @property
    def coming_mm(self) -> Vector:
        """(3,) of what is left that the tip will go within the dead time."""
        return self._coming_mm - self._arrived_mm

    @property
    def left_mm(self) -> Vector:
        """(3,)"""
        return self.told_mm - self._arrived_mm


def parts(lag_s: float, dead_share: float = DEAD_SHARE) -> tuple[float, float]:
    """Dead time and first-order lag of a lag that is known as a sum."""
    dead_s = dead_share * lag_s
    return dead_s, lag_s - dead_s


def _through_lag(
    out: Vector, then: Vector, now: Vector, dt_s: float, first_order_s: float
) -> Vector:
    """(3,) what has come out of a first-order lag, of which (3,) had before what went in evenly
    went from (3,) to (3,). Of even motion it is behind by its time."""
    if not (dt_s > 0.0 and first_order_s > 0.0):
        return now if dt_s > 0.0 else out
    behind = first_order_s / dt_s * (now - then)
    return np.asarray(now - behind + exp(-dt_s / first_order_s) * (out - then + behind))


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: a second once, then hundredths."""
    lag = BodyLag()
    for k in range(4):
        lag.add(0.5 * _SPAN_S * k, 0.5 * _SPAN_S, np.array([float(k), 0.0, 0.0]), np.zeros(3))
    kernels.gains(np.zeros(1), 0.0, np.zeros((2, 1, 3)), _ONE_MM2, _ALIKE)
