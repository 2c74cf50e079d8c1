"""What several axes may not do together: bounds on sums of their counts.

A sum is Σ factor · counts, in mm or rad. A limit without conditions is a slab that every straight
way between two places inside keeps to. With conditions it counts only while all of them are met, so
what is allowed is several slabs: that of the limit itself, and beside each condition's band those
on either side. A way is allowed that keeps to one of the slabs in which it begins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import floor, inf, isfinite
from typing import Final, NamedTuple

ROUNDING_COUNTS: Final = 4.0
"""Targets between the ends of a way are whole counts: each axis up to 2 beside the line, and where
the next way begins as much again."""
_SAME: Final = 1e-6
"""Of the rounding: a sum that stays as it is may come out so different."""


@dataclass(frozen=True)
class AxisSum:
    """A sum of axes, in mm or rad."""

    terms: tuple[tuple[int, float], ...]
    """Each axis in it, and mm or rad per count."""
    constant: float = 0.0
    rounding: float = field(init=False, compare=False)
    """By how much whole counts may make it another."""

    def __post_init__(self) -> None:
        rounding = ROUNDING_COUNTS * sum([abs(factor) for _, factor in self.terms])
        object.__setattr__(self, "rounding", rounding)

    def at(self, counts: Sequence[int]) -> float:
        """Its value where the axes are at these counts."""
        value = self.constant
        for axis, factor in self.terms:
            value += factor * counts[axis]
        return value

    def span(self, start: Sequence[int], rest: Sequence[int]) -> tuple[float, float]:
        """Its lowest and highest value where each axis is anywhere between two places."""
        low = high = self.at(start)
        for axis, factor in self.terms:
            way = factor * (rest[axis] - start[axis])
            if way > 0.0:
                high += way
            else:
                low += way
        return low, high

    def stands(self, start: Sequence[int], end: Sequence[int]) -> bool:
        """Whether none of its axes moves."""
        return all(start[axis] == end[axis] for axis, _ in self.terms)


class Condition(NamedTuple):
    """A sum is nearer than `within` to a value, or to one that is whole periods away."""

    sum: AxisSum
    near: float
    within: float
    period: float | None

    def middle(self, value: float) -> float:
        """That of the band which is nearest."""
        if self.period is None:
            return self.near
        return self.near + self.period * floor((value - self.near) / self.period + 0.5)

    def beside(self, value: float) -> tuple[float, float] | None:
        """The range beside the bands in which a value is; None where it is in a band."""
        middle, gap = self.middle(value), inf if self.period is None else self.period
        if value >= middle + self.within:
            return middle + self.within, middle + gap - self.within
        if value <= middle - self.within:
            return middle - gap + self.within, middle - self.within
        return None


class CoupledLimit(NamedTuple):
    """Bounds of a sum; they count while all conditions are met."""

    name: str
    sum: AxisSum
    lowest: float
    highest: float
    only_while: tuple[Condition, ...] = ()

    def check(self, axes: int) -> None:
        """Raises ValueError where this is no limit for so many axes."""
        for one in (self.sum, *[condition.sum for condition in self.only_while]):
            if not one.terms or not all(0 <= axis < axes for axis, _ in one.terms):
                raise ValueError(f"{self.name}: a sum is made of axes that there are")
            if not all(isfinite(factor) and factor for _, factor in one.terms):
                raise ValueError(f"{self.name}: a factor is finite and not zero")
            if not isfinite(one.constant):
                raise ValueError(f"{self.name}: a sum is finite")
        if not self.highest - self.lowest > 2 * self.sum.rounding:
            raise ValueError(f"{self.name}: between its bounds there is no room for whole counts")
        for condition in self.only_while:
            gap = inf if condition.period is None else condition.period - 2 * condition.within
            if not (condition.within > 0.0 and gap > 2 * condition.sum.rounding):
                raise ValueError(f"{self.name}: beside a condition's bands there is no room")


class Range(NamedTuple):
    """Where a way must end: a sum between two values."""

    sum: AxisSum
    start: float
    """Its value where the way begins."""
    bottom: float
    top: float

    def keeps(self, counts: Sequence[int]) -> bool:
        """Whether a place of the axes is within."""
        return self.bottom <= self.sum.at(counts) <= self.top

    def spans(self, start: Sequence[int], rest: Sequence[int]) -> bool:
        """Whether all is within where each axis is anywhere between two places."""
        low, high = self.sum.span(start, rest)
        return self.bottom <= low and high <= self.top


def ranges(limit: CoupledLimit, start: Sequence[int]) -> list[tuple[Range, ...]]:
    """What a way that begins at `start` may keep to: all ranges of any one element.

    Who is outside may not go further out, of whatever makes it outside.
    """
    value = limit.sum.at(start)
    own = _range(limit.sum, value, limit.lowest, limit.highest)
    allowed: list[tuple[Range, ...]] = [(own,)] if limit.lowest <= value <= limit.highest else []
    outside = [own]
    for condition in limit.only_while:
        there = condition.sum.at(start)
        beside = condition.beside(there)
        if beside is not None:
            allowed.append((_range(condition.sum, there, *beside),))
        elif there >= condition.middle(there):
            outside.append(_range(condition.sum, there, inf, inf))
        else:
            outside.append(_range(condition.sum, there, -inf, -inf))
    return allowed or [tuple(outside)]


def kept(
    allowed: Sequence[tuple[Range, ...]],
    start: Sequence[int],
    end: Sequence[int],
    rest: Sequence[int],
) -> bool:
    """Whether a way from `start` to `end`, and braking to `rest` on the same line, is allowed."""
    return any(
        all(
            (one.keeps(end) and one.keeps(rest))
            or (one.sum.stands(start, end) and one.sum.stands(start, rest))
            for one in together
        )
        for together in allowed
    )


def kept_apart(
    allowed: Sequence[tuple[Range, ...]], start: Sequence[int], rest: Sequence[int]
) -> bool:
    """Whether every place is allowed where each axis is anywhere between `start` and `rest`."""
    for together in allowed:
        for one in together:
            if not (one.spans(start, rest) or one.sum.stands(start, rest)):
                break
        else:
            return True
    return False


def broken(
    limits: Sequence[CoupledLimit],
    start: Sequence[int],
    end: Sequence[int],
    rest: Sequence[int],
) -> Iterator[CoupledLimit]:
    """The limits that a way does not keep to."""
    for limit in limits:
        if not kept(ranges(limit, start), start, end, rest):
            yield limit


def room_alone(
    limits: Sequence[CoupledLimit], axis: int, counts: Sequence[int | None]
) -> tuple[float, float]:
    """Between which counts one axis may be while all others stand.

    counts: None of an axis that does not know its zero: limits of which it is a part say nothing.
    Where the axis is already, is always between them.
    """
    lowest, highest = -inf, inf
    known = [0 if one is None else one for one in counts]
    at = known[axis]
    for limit in limits:
        sums = [limit.sum, *[condition.sum for condition in limit.only_while]]
        parts = {part for one in sums for part, _ in one.terms}
        if axis not in parts or any(counts[part] is None for part in parts):
            continue
        rooms = [_room_alone(together, axis, at) for together in ranges(limit, known)]
        low, high = max(rooms, key=lambda room: (room[1] - room[0], -room[0], room[1]))
        lowest, highest = max(lowest, min(low, at)), min(highest, max(high, at))
    return lowest, highest


def _room_alone(together: Sequence[Range], axis: int, at: int) -> tuple[float, float]:
    """What ranges leave to one axis, which is at `at` where they begin."""
    lowest, highest = -inf, inf
    for one in together:
        factor = dict(one.sum.terms).get(axis, 0.0)
        if factor:
            ends = (one.bottom - one.start) / factor, (one.top - one.start) / factor
            lowest, highest = max(lowest, at + min(ends)), min(highest, at + max(ends))
    return lowest, highest


def _range(one: AxisSum, start: float, lowest: float, highest: float) -> Range:
    """Inside the bounds by what rounding may do; from outside no further out."""
    same = one.rounding * _SAME
    bottom = lowest + one.rounding if start >= lowest else start - same
    top = highest - one.rounding if start <= highest else start + same
    return Range(one, start, bottom, top)
