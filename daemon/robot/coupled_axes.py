"""A robot's coupled limits: in counts for the gate, and in axes for whoever looks for places."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from config.coupling.sums import AxesLimit, AxesSum, TruthArray, axes_limits
from config.robot import Robot
from drivers.axis_scale import axis_scale
from drivers.pose import Vector
from safety.coupling import AxisSum, Condition, CoupledLimit

_ALONG: Final = np.linspace(0.0, 1.0, 33)[:, None]
"""Where a straight way is looked at: what is between is within a 32nd of it."""


def limits_in_axes(robot: Robot) -> list[AxesLimit]:
    """Those of a robot file that has been checked; empty where it has none."""
    if not robot.coupled_limits:
        return []
    names = [axis.name for axis in robot.axes]
    return axes_limits(robot.coupled_limits, names, robot.coordinates)


def count_coupling(robot: Robot) -> tuple[CoupledLimit, ...]:
    """The limits in the drives' counts, as the gate keeps them."""
    scales = [axis_scale(axis).counts_per_unit for axis in robot.axes]

    def counted(one: AxesSum) -> AxisSum:
        factors = zip(one.factors.tolist(), scales, strict=True)
        terms = [(axis, factor / scale) for axis, (factor, scale) in enumerate(factors) if factor]
        return AxisSum(tuple(terms), one.constant)

    return tuple(
        CoupledLimit(
            limit.name,
            counted(limit.sum),
            limit.lowest,
            limit.highest,
            tuple(
                Condition(counted(one.sum), one.near, one.within, one.period)
                for one in limit.only_while
            ),
        )
        for limit in limits_in_axes(robot)
    )


def beyond_alone(robot: Robot) -> list[float]:
    """How far beyond each coupled limit the axes' own travels reach, mm or rad; 0: not at all.

    A drive keeps its travel by itself, host or no host; what is beyond, only the gate keeps.
    """
    low, high = np.array([axis.travel for axis in robot.axes]).T
    found = []
    for limit in limits_in_axes(robot):
        factors, constant = limit.sum.factors, limit.sum.constant
        least = np.minimum(factors * low, factors * high).sum() + constant
        most = np.maximum(factors * low, factors * high).sum() + constant
        found.append(max(0.0, float(limit.lowest - least), float(most - limit.highest)))
    return found


@dataclass(frozen=True)
class CoupledAxes:
    """Where axes may be together."""

    limits: tuple[AxesLimit, ...] = ()

    @classmethod
    def of(cls, robot: Robot) -> "CoupledAxes":
        """Everywhere, for a robot without coupled limits."""
        return cls(tuple(limits_in_axes(robot)))

    def inside(self, u: Vector) -> TruthArray:
        """(...) bool, for (..., m) axes."""
        kept = np.ones(u.shape[:-1], np.bool_)
        for limit in self.limits:
            kept &= limit.kept(u)
        return np.asarray(kept)

    def way_inside(self, start: Vector, end: Vector) -> bool:
        """Whether the straight way between two (m,) places is inside, but perhaps its beginning."""
        if not self.limits:
            return True
        return bool(self.inside(start + _ALONG[1:] * (end - start)).all())

    def way(self, start: Vector, end: Vector) -> list[Vector] | None:
        """(m,) places to go to one after the other on straight lines, the last of them `end`.

        Where the straight way leads out, it is tried by way of where the sums of the limits that
        count only sometimes are as at zero, at the beginning as at the end. None: that leads out.
        """
        if self.way_inside(start, end):
            return [end]
        guarded = [limit.sum.factors != 0.0 for limit in self.limits if limit.only_while]
        moved = np.logical_or.reduce(guarded) if guarded else np.zeros(len(end), np.bool_)
        places = [np.where(moved, 0.0, start), np.where(moved, 0.0, end), end]
        before = [start, *places[:-1]]
        straight = all(self.way_inside(a, b) for a, b in zip(before, places, strict=True))
        return places if straight else None

    def first_broken(self, u: Vector) -> AxesLimit | None:
        """The first limit that (m,) axes do not keep."""
        return next((limit for limit in self.limits if not bool(limit.kept(u))), None)
