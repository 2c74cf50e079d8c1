"""How far several axes may go together in one step, so that they can stop inside coupled limits.

Far from all limits each axis brakes by itself: wherever all are on their ways, they are inside.
Near one they brake together, each at such a rate that all come to rest at the same time, on the
straight line that they move on. So whoever is inside where a step begins, where it ends and where
braking from there ends, is inside all the way; and braking along that line, step by step and
whenever a frame comes, stays on it: it is always possible.

Only what leads out is taken away: of the axes that make a sum grow beyond its bound, all the same
share. The others go where they were meant to.

Nothing here permits anything: `safety.permit` checks the outcome once more.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from safety import shaping
from safety.coupling import CoupledLimit, Range, kept, kept_apart, ranges
from safety.limits import CountLimits, at_rest, braking_together_s
from safety.permit import rests_apart
from safety.shaping import AxisMotion

COUPLED: Final = "coupled limit: "
"""Before its name, where one has cut a step."""
_PASSES_PER_LIMIT: Final = 2
"""One for the limit, and one more where another's has changed how long braking takes."""
_HALVINGS: Final = 6
"""Between braking and what is left of a step: at most a 64th of it is given away."""


class Course(NamedTuple):
    """A step as it would be carried out. One element per axis."""

    changes: list[int]
    end: list[int]
    rest: list[int]
    """Where braking after it ends, even if this is the last that the axes hear."""
    stretch: float
    """How far an axis goes until it is at rest, in changes; that which goes on for longest."""


class CoupledStep:
    """One step of axes that are coupled, from where it begins."""

    def __init__(
        self,
        motions: Sequence[AxisMotion],
        limits: Sequence[CountLimits],
        coupled: Sequence[CoupledLimit],
    ) -> None:
        """motions and limits: one per axis; all motions last equally long."""
        self._motions = motions
        self._limits = limits
        self._start = [motion.start for motion in motions]
        self._duration_s = motions[0].duration_ns * 1e-9
        self._goes_on_s = max([one.goes_on_s for one in limits])
        self._coupled = [(limit.name, ranges(limit, self._start)) for limit in coupled]
        self._asked: tuple[list[int], list[int] | None] = [], None
        """The changes whose `_apart` was asked for last, and what it was."""

    def course(self, changes: Sequence[int]) -> Course:
        """What becomes of a step with these changes."""
        duration_s = self._duration_s
        velocities = [change / duration_s for change in changes]
        lasts_s = braking_together_s(velocities, self._limits)
        end = [at + change for at, change in zip(self._start, changes, strict=True)]
        rest = [
            at_rest(at, velocity, lasts_s, one.goes_on_s)
            for at, velocity, one in zip(end, velocities, self._limits, strict=True)
        ]
        stretch = 1.0 + (self._goes_on_s + lasts_s / 2.0) / duration_s
        return Course(list(changes), end, rest, stretch)

    def rest(self, changes: Sequence[int]) -> Sequence[int]:
        """Where the axes come to rest after a step with these changes."""
        apart = self._apart(changes)
        return self.course(changes).rest if apart is None else apart

    def braking(self) -> list[int]:
        """The changes of braking: each axis as hard as it may, or else all on one line."""
        apart = [self._possible(axis, 0.0) for axis in range(len(self._motions))]
        return apart if self._keeps(apart) else self._braking_together()

    def shaped(self, changes: Sequence[int], limited: list[str]) -> list[int]:
        """The nearest changes with which all limits are kept, of those between these and braking.

        Appends to `limited` what was cut, and by what.
        """
        if self._keeps(changes):
            return list(changes)
        cut = self._cut(changes, limited)
        if self._keeps(cut):
            return cut
        safe = self._cut(self.braking(), [])
        share, step = 0.0, 0.5
        for _ in range(_HALVINGS):
            if self._keeps(self._between(safe, cut, share + step)):
                share += step
            step /= 2.0
        return self._between(safe, cut, share)

    def _braking_together(self) -> list[int]:
        """The changes of braking as hard as it goes on a straight line."""
        velocities = [motion.velocity for motion in self._motions]
        lasts_s = braking_together_s(velocities, self._limits)
        if lasts_s == 0.0:
            return [0] * len(velocities)
        brakes_ns = min([motion.unchanged_ns for motion in self._motions if motion.velocity])
        left = max(0.0, 1.0 - min(brakes_ns * 1e-9, self._duration_s) / lasts_s)
        return [
            self._possible(axis, motion.coasts * left) for axis, motion in enumerate(self._motions)
        ]

    def _apart(self, changes: Sequence[int]) -> list[int] | None:
        """Where axes come to rest that brake each by itself; None: that could break a limit."""
        asked, rests = self._asked
        if asked != changes:
            end = [at + change for at, change in zip(self._start, changes, strict=True)]
            rests = rests_apart(self._start, end, self._duration_s, self._limits)
            for _, allowed in self._coupled:
                if not kept_apart(allowed, self._start, rests):
                    rests = None
                    break
            self._asked = list(changes), rests
        return rests

    def _between(self, one: Sequence[int], other: Sequence[int], share: float) -> list[int]:
        return [a + int((b - a) * share) for a, b in zip(one, other, strict=True)]

    def _keeps(self, changes: Sequence[int]) -> bool:
        if self._apart(changes) is not None:
            return True
        course = self.course(changes)
        return not any(self._overrun(axis, course) for axis in range(len(changes))) and all(
            kept(allowed, self._start, course.end, course.rest) for _, allowed in self._coupled
        )

    def _cut(self, changes: Sequence[int], limited: list[str]) -> list[int]:
        """Less and less of what leads out, until nothing does, or nothing more can be taken."""
        course = self.course(changes)
        for _ in range(_PASSES_PER_LIMIT * (len(self._coupled) + 1)):
            less = self._less(course, limited)
            if less is None:
                break
            course = self.course(less)
        return course.changes

    def _less(self, course: Course, limited: list[str]) -> list[int] | None:
        """The changes without what breaks the first limit that is broken; None: none is."""
        for axis in range(len(course.changes)):
            if self._overrun(axis, course):
                _tell(limited, f"braking distance: axis {axis}")
                less = list(course.changes)
                less[axis] = self._possible(axis, self._room(axis, less[axis]) / course.stretch)
                return less
        for name, allowed in self._coupled:
            if not kept(allowed, self._start, course.end, course.rest):
                _tell(limited, COUPLED + name)
                return self._least_cut(allowed, course)
        return None

    def _overrun(self, axis: int, course: Course) -> bool:
        """Whether the axis would come to rest beyond the end of its travel that it moves to."""
        change, rest, limits = course.changes[axis], course.rest[axis], self._limits[axis]
        return (change > 0 and rest > limits.highest) or (change < 0 and rest < limits.lowest)

    def _room(self, axis: int, change: int) -> int:
        """Signed counts to the end of travel, in the direction of a change; none outside."""
        at, limits = self._start[axis], self._limits[axis]
        return max(0, limits.highest - at) if change > 0 else min(0, limits.lowest - at)

    def _least_cut(self, allowed: Sequence[tuple[Range, ...]], course: Course) -> list[int]:
        """Of the ways to keep to a limit the one that takes least away."""
        shares = [min([_share_left(one, course) for one in together]) for together in allowed]
        changes = course.changes
        for one in allowed[shares.index(max(shares))]:
            changes = self._shrunk(changes, one, course)
        return changes

    def _shrunk(self, changes: Sequence[int], one: Range, course: Course) -> list[int]:
        """The changes with less of what leads out of a range; with nothing of its axes where that
        is not enough."""
        share = _share_left(one, course)
        less = list(changes)
        outwards = _direction(one, course)
        for axis, factor in one.sum.terms:
            if share < 0.0:
                less[axis] = self._possible(axis, 0.0)
            elif outwards * factor * less[axis] > 0.0:
                less[axis] = self._possible(axis, less[axis] * share)
        return less

    def _possible(self, axis: int, change: float) -> int:
        """The whole change nearest to zero from there, as far as the acceleration allows it."""
        lowest, highest = shaping.acceleration_range(self._motions[axis], self._limits[axis])
        return max(lowest, min(highest, int(change)))


def _direction(one: Range, course: Course) -> int:
    """1: a course leads out of a range upwards; −1: downwards; 0: not at all."""
    ends = one.sum.at(course.end), one.sum.at(course.rest)
    if max(ends) > one.top:
        return 1
    return -1 if min(ends) < one.bottom else 0


def _share_left(one: Range, course: Course) -> float:
    """How much of what leads out of a range may be left; negative where nothing is too much."""
    outwards = _direction(one, course)
    if outwards == 0:
        return 1.0
    out = back = 0.0
    for axis, factor in one.sum.terms:
        way = outwards * factor * course.changes[axis]
        if way > 0.0:
            out += way
        else:
            back -= way
    room = one.top - one.start if outwards > 0 else one.start - one.bottom
    left = (room / course.stretch if room > 0.0 else room) + back
    return left / out if out > 0.0 else -1.0


def _tell(limited: list[str], what: str) -> None:
    if what not in limited:
        limited.append(what)
