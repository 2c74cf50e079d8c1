"""When a frame was measured, on the host's clock, told from its number.

A frame's number is the device's own time; its reply comes later by a delay that is never negative
and often near its smallest value. So arrival time minus device time has a lower envelope, a line:
its height is the offset between the two clocks (plus the smallest delay), its slope their drift.
The line is the lower hull's edge over the middle of the last half minute (Moon, Skelly and Towsley,
"Estimation and removal of clock skew from network delay measurements", 1999).
"""

from collections import deque
from itertools import pairwise
from typing import NamedTuple

from drivers.aurora.codec.tracking_data import FRAME_MODULUS

_BUCKET_NS = 500_000_000
_BUCKETS = 64
"""Half a minute: clocks drift apart by 3 ms in it at most, which a line tells."""
_SHORTEST_SPAN_NS = 5_000_000_000
"""Over less time than this the jitter of the delay would be taken for drift."""
_LARGEST_DRIFT = 500e-6
"""Quartz is within 100 ppm on either side; the rest is what a line through delays may be off."""
_EARLY_NS = 50_000_000
"""A frame that is here so long before its time shows that the counter has jumped."""
_LATE_NS = 100_000_000
_LATE_FOR_NS = 1_000_000_000
"""Frames that are all so late for so long show it as well."""


class _Point(NamedTuple):
    """Device time since the anchor, and arrival time minus it."""

    device_ns: float
    excess_ns: float


class FrameClock:
    """Maps frame numbers, which wrap around, to host time."""

    def __init__(self, ticks_per_s: float) -> None:
        self._tick_ns = 1e9 / ticks_per_s
        self._last: tuple[int, int] | None = None
        self._device_ns = 0.0
        self.jumps = 0
        """How often the counter turned out to have jumped."""
        self._anchor(0)

    @property
    def drift(self) -> float:
        """How much slower the device's clock runs than the host's; 1e-6 is 1 ppm."""
        return self._slope

    def observe(self, frame_number: int, arrived_ns: int) -> int:
        """The host time at which this frame was measured: after the last one, not after arrival.

        Frames come in order. arrived_ns: when its reply began to arrive.
        """
        if self._last is None:
            return self._restart(frame_number, arrived_ns)
        ticks = (frame_number - self._last[0]) % FRAME_MODULUS
        point = _Point(
            self._device_ns + ticks * self._tick_ns,
            arrived_ns - self._anchor_ns - self._device_ns - ticks * self._tick_ns,
        )
        if ticks >= FRAME_MODULUS // 2 or self._has_jumped(point, arrived_ns):
            self.jumps += 1
            return self._restart(frame_number, arrived_ns)
        self._device_ns = point.device_ns
        self._learn(point)
        measured_ns = self._anchor_ns + round(point.device_ns + self._line(point.device_ns))
        earliest_ns = self._last[1] + round(0.5 * ticks * self._tick_ns)
        measured_ns = min(max(measured_ns, earliest_ns), arrived_ns)
        self._last = (frame_number, measured_ns)
        return measured_ns

    def _anchor(self, arrived_ns: int) -> None:
        self._anchor_ns = arrived_ns
        self._device_ns = 0.0
        self._height_ns = self._slope = self._middle_ns = 0.0
        self._lowest: deque[_Point] = deque([_Point(0.0, 0.0)], maxlen=_BUCKETS)
        self._bucket_ends_ns = float(_BUCKET_NS)
        self._late_since_ns: int | None = None

    def _restart(self, frame_number: int, arrived_ns: int) -> int:
        self._anchor(arrived_ns)
        self._last = (frame_number, arrived_ns)
        return arrived_ns

    def _line(self, device_ns: float) -> float:
        return self._height_ns + self._slope * (device_ns - self._middle_ns)

    def _has_jumped(self, point: _Point, arrived_ns: int) -> bool:
        late_ns = point.excess_ns - self._line(point.device_ns)
        if late_ns < _LATE_NS:
            self._late_since_ns = None
            return late_ns < -_EARLY_NS
        if self._late_since_ns is None:
            self._late_since_ns = arrived_ns
        return arrived_ns - self._late_since_ns > _LATE_FOR_NS

    def _learn(self, point: _Point) -> None:
        if point.device_ns >= self._bucket_ends_ns:
            self._fit()
            self._lowest.append(point)
            self._bucket_ends_ns = point.device_ns + _BUCKET_NS
        elif point.excess_ns < self._lowest[-1].excess_ns:
            self._lowest[-1] = point
        below_ns = self._line(point.device_ns) - point.excess_ns
        if below_ns > 0.0:
            self._height_ns -= below_ns

    def _fit(self) -> None:
        first, last = self._lowest[0], self._lowest[-1]
        middle_ns = 0.5 * (first.device_ns + last.device_ns)
        if last.device_ns - first.device_ns < _SHORTEST_SPAN_NS:
            left = min(self._lowest, key=lambda point: point.excess_ns)
            self._slope = 0.0
        else:
            left, right = _edge_over(middle_ns, _lower_hull(self._lowest))
            slope = (right.excess_ns - left.excess_ns) / (right.device_ns - left.device_ns)
            self._slope = min(max(slope, -_LARGEST_DRIFT), _LARGEST_DRIFT)
        self._middle_ns = middle_ns
        self._height_ns = left.excess_ns + self._slope * (middle_ns - left.device_ns)


def _lower_hull(points: deque[_Point]) -> list[_Point]:
    """The points' lower convex hull, from left to right."""
    hull: list[_Point] = []
    for point in points:
        x, y = point
        while len(hull) >= 2:
            (x0, y0), (x1, y1) = hull[-2], hull[-1]
            if (x1 - x0) * (y - y0) > (x - x0) * (y1 - y0):
                break  # the hull turns up here, as it should
            hull.pop()
        hull.append(point)
    return hull


def _edge_over(middle_ns: float, hull: list[_Point]) -> tuple[_Point, _Point]:
    for left, right in pairwise(hull):
        if right.device_ns >= middle_ns:
            return left, right
    return hull[-2], hull[-1]
