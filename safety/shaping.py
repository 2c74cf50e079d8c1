"""How far one axis may go in one step, in counts: what the gate makes of a wanted change.

Nothing here permits anything: `safety.permit` checks the outcome once more.
"""

from math import ceil, floor, isfinite, sqrt
from typing import NamedTuple

from safety.limits import CountLimits

_NS2_PER_S2 = 10**18


class AxisMotion(NamedTuple):
    """One axis at the beginning of a step."""

    start: int
    """Where it was last told to be."""
    velocity: float
    """How fast it was last told to move, counts/s."""
    duration_ns: int
    """Of the step that begins."""
    unchanged_ns: float
    """For how long its velocity has not been changed; frames that come in a burst must not add up
    to a jump."""

    @property
    def coasts(self) -> float:
        """The change at an unchanged velocity."""
        return self.velocity * self.duration_ns / 1e9


def largest_change(limits: CountLimits, duration_ns: int) -> int:
    """In a step of that length, at the highest velocity."""
    return limits.max_velocity * duration_ns // 1_000_000_000


def braking(limits: CountLimits, duration_ns: int) -> float:
    """By how much the change of a step of that length may be smaller than that of the last."""
    return limits.max_acceleration * duration_ns * duration_ns / _NS2_PER_S2


def acceleration_range(motion: AxisMotion, limits: CountLimits) -> tuple[int, int]:
    """The lowest and the highest change that the acceleration allows, in the time that has truly
    passed."""
    coasts, most = motion.coasts, braking(limits, motion.duration_ns)
    most *= min(motion.unchanged_ns, motion.duration_ns) / motion.duration_ns
    lowest, highest = ceil(coasts - most), floor(coasts + most)
    if lowest > highest:  # no whole count lies between: the slower neighbour
        lowest = highest = min(lowest, highest, key=abs)
    return lowest, highest


def within_acceleration(change: int, motion: AxisMotion, limits: CountLimits) -> int:
    """The nearest change that the acceleration allows."""
    lowest, highest = acceleration_range(motion, limits)
    return max(lowest, min(highest, change))


def within_travel(change: int, motion: AxisMotion, limits: CountLimits) -> int:
    """The nearest change from which the axis can still stop before the ends of its travel.

    An axis outside its travel may only come back.
    """
    slower = braking(limits, motion.duration_ns)
    goes_on = limits.goes_on_s * 1e9 / motion.duration_ns
    if change > 0:
        return min(change, _stoppable(max(0, limits.highest - motion.start), slower, goes_on))
    return max(change, -_stoppable(max(0, motion.start - limits.lowest), slower, goes_on))


def within_lag(change: int, motion: AxisMotion, measured: int, limits: CountLimits) -> int:
    """The nearest smaller change that leaves the target close enough to where the axis is."""
    if change > 0:
        return min(change, max(0, measured + limits.max_lag - motion.start))
    return max(change, min(0, measured - limits.max_lag - motion.start))


def within_tension(
    change: int, tension_n: float | None, allowed_n: tuple[float, float], up_pulls: bool
) -> int:
    """The change, or none: too tense does not pull, too slack does not release.

    up_pulls: whether counting up pulls. Where the tension is not known, it does neither.
    """
    if tension_n is None or not isfinite(tension_n):
        return 0
    slack, too_much = allowed_n
    blocked = tension_n > too_much if (change > 0) == up_pulls else tension_n < slack
    return 0 if blocked else change


def stops_at(change: int, motion: AxisMotion, limits: CountLimits) -> float:
    """Where the axis comes to rest if it brakes after a step of that change."""
    way = change * abs(change) / (2 * braking(limits, motion.duration_ns))
    return motion.start + change + way


def _stoppable(distance: int, slower: float, goes_on: float) -> int:
    """The largest change that leaves, of `distance`, what is needed to stop.

    With v for the velocity after the step, and g for the time that the axis goes on with it where
    nothing follows, `goes_on` durations T of the step: v·(T + g) + v²/2a ≤ distance. This braking
    distance is that of infinitely short steps, so it is enough for the next steps however long they
    are. One count is always allowed: it stops within the rounding that the permit leaves.
    """
    longer = 1.0 + goes_on
    root = sqrt(slower * (slower * (longer * longer) + 2 * distance))
    return max(int(root - slower * longer), min(1, distance))
