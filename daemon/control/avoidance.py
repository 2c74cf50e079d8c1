"""Turns a step aside that would bring the body too near to something: then it goes along it.

The clearance that is left, h, may only get less as fast as it is large: Δh ≥ −γ (h − h₀) (a control
barrier function), for each part of the body that something is near to. Of all steps that keep to it
and to the axes' limits, each by itself and coupled, the one is taken that is nearest to the wanted,
each axis counted by its speed, and the tip's task besides: what it is asked to give up is dearer
than what the axes do where it does not see it. Where that gains the tip nothing, because there is
no other way for the body, the step is the nearest by the axes alone, and by the clearance of the
whole body.

Limits that couple axes are kept in the same way where nothing is near: a controller's step goes
along them.

It decides nothing: what comes out is a proposal, which the gate judges as any. What the gate finds
comes back: where a step's risk is high, or nothing of it is let through, more clearance is kept for
a while. The clearance is that of a body at rest, to first order; the gate counts the way there, and
in a slot, where one side's clearance is what the other one takes, that is too little now and then.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from daemon.control.avoidance_kernels import (
    STAYS,
    TASK_ROWS,
    Bounds,
    Near,
    keep_coupled,
    room_for,
    turn_aside,
)
from daemon.control.jacobian_kernels import in_rows
from daemon.control.task import POSITION
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from safety.risk_source import Clearance, PartClearance

_MOST_PARTS: Final = 8
_TASK_COUNTS: Final = 30.0
"""How much dearer it is to lead the tip away by what the axes do to it at most, than to have them
do it."""
_POINTING_MM_PER_RAD: Final = 25.0
"""What turning the tip counts for, as for controllers."""
_TENSION_KEPT: Final = 0.1
"""Share of a tendon's range of tensions, at either end, that is not gone into to keep the tip where
it is: what leaves the tip alone is, on arms with tendons, all of them together."""
_HIGH_RISK: Final = 0.5
"""Share of the threshold, above which more clearance is kept ..."""
_MORE_MM: Final = 0.1
"""... by so much with each step, ..."""
_REFUSED_MM: Final = 0.5
"""... or so much, if the gate has let through less of the step, ..."""
_MOST_RESERVE_MM: Final = 1.5
"""... up to this. All of them were chosen, on slots and balls beside a tendon arm: there a step is
refused now and then with the reserve for refused ones alone, and hardly ever with both."""
_RESERVE_KEPT: Final = 0.97
"""Of that, with each step whose risk is low: half of it is gone after 0.6 s at 40 Hz."""


class Aside(NamedTuple):
    """A step that was turned aside."""

    delta_u: Vector
    """(m,)."""
    arc_mm: float | None
    """Where along the body its nearest part is; None: only the whole is known."""
    clearance_mm: float
    """That this part has left."""
    given_up_mm: float | None
    """How far it leads the tip from where it was to go in this step; None: not known."""


class _Prepared(NamedTuple):
    """A clearance, with whatever does not depend on the step."""

    clearance: Clearance
    near: Near
    nearest: PartClearance | None
    """None: only the whole body is known."""


class Avoidance:
    """Of one robot. Not for several threads."""

    def __init__(
        self, axes: AxisRanges, tensions_n: Sequence[tuple[float, float] | None] = ()
    ) -> None:
        """tensions_n: lowest and highest of each axis; None, or none at all: it has none."""
        self._speeds = axes.max_velocity
        self._bounds = _bounds(axes, tensions_n or [None] * axes.count)
        self._room = room_for(axes.count, _MOST_PARTS + 2 * len(axes.coupled.limits))
        self._asked = np.full((3, axes.count), np.nan)
        self._prepared: _Prepared | None = None
        self._reserve_mm = 0.0
        """Of clearance, that is kept besides."""

    def warm_up(self) -> None:
        """Compile the kernel, or load it from numba's cache."""
        none = (0.0,) * self._speeds.size
        self.aside(np.zeros(len(none)), np.zeros(len(none)), Clearance(none, 0.0, none), 0.0)
        self._prepared = None

    def prepare(self, clearance: Clearance) -> None:
        """Work out in spare time what `aside` needs of a clearance; it does so itself otherwise."""
        parts = clearance.parts[:_MOST_PARTS] if clearance.tip_slope else ()
        near = _near(clearance, parts, self._speeds, self._reserve_mm)
        nearest = min(clearance.parts, key=lambda part: part.clearance_mm) if parts else None
        self._prepared = _Prepared(clearance, near, nearest)

    def take_judgement(self, risk: float, threshold: float, reduced: bool) -> None:
        """What the gate found of a step: its risk, and whether it let through less for that."""
        reserve_mm = self._reserve_mm
        if reduced or risk > _HIGH_RISK * threshold:
            reserve_mm += _REFUSED_MM if reduced else _MORE_MM
        else:
            reserve_mm *= _RESERVE_KEPT
        self._reserve_mm = min(reserve_mm, _MOST_RESERVE_MM)

    def aside(
        self,
        delta_u: Vector,
        targets: Vector,
        clearance: Clearance,
        dt_s: float,
        points: bool = False,
        tensions_n: Sequence[float | None] = (),
    ) -> Aside | None:
        """What to take in place of (m,) delta_u from (m,) targets; None: it may stay as it is.

        points: whether the tip's direction is part of its task. tensions_n: as measured.
        """
        if self._prepared is None or self._prepared.clearance is not clearance:
            self.prepare(clearance)
        assert self._prepared is not None
        _, near, nearest = self._prepared
        asked = self._asked
        asked[0], asked[1] = delta_u, targets
        asked[2] = [np.nan if one is None else one for one in tensions_n] or np.nan
        found = np.empty(delta_u.size + 1)
        if turn_aside(self._bounds, near, self._room, asked, dt_s, points, found) == STAYS:
            return None
        if nearest is None:
            return Aside(found[:-1], None, clearance.clearance_mm, None)
        return Aside(found[:-1], nearest.arc_mm, nearest.clearance_mm, float(found[-1]))


class CoupledKeeping:
    """Has a step keep the robot's coupled limits: the axes do otherwise what is left for the tip.

    The gate would take away what leads beyond them, and where a controller went on to ask for that
    nothing would be left. Not for several threads.
    """

    def __init__(self, axes: AxisRanges) -> None:
        self._speeds = axes.max_velocity
        self._bounds = _bounds(axes, [None] * axes.count)
        self._room = room_for(axes.count, 2 * len(axes.coupled.limits))
        self._asked = np.full((3, axes.count), np.nan)

    def kept(self, delta_u: Vector, targets: Vector, task: Vector, dt_s: float) -> Vector:
        """What to take in place of (m,) delta_u from (m,) targets; itself where it may stay.

        task: (r, m) what the axes do to the tip's task.
        """
        self._asked[0], self._asked[1] = delta_u, targets
        counted, found = in_rows(_counted(task, self._speeds)), np.empty(delta_u.size)
        turned = keep_coupled(self._bounds, self._room, self._asked, counted, dt_s, found)
        return delta_u if turned == STAYS else found


def _bounds(axes: AxisRanges, tensions_n: Sequence[tuple[float, float] | None]) -> Bounds:
    low, high = np.array([one or (-np.inf, np.inf) for one in tensions_n], np.float64).T
    kept = np.where(np.isfinite(high - low), _TENSION_KEPT * (high - low), 0.0)
    alone = [axes.lowest, axes.highest, axes.max_velocity, low + kept, high - kept]
    limits = axes.coupled.limits
    conditions: list[list[float]] = []
    for number, limit in enumerate(limits):
        for one in limit.only_while:
            period = one.period or 0.0
            told = [number, one.sum.constant, one.near, one.within, period, *one.sum.factors]
            conditions.append(told)
    together = [
        [
            *(limit.sum.constant, limit.lowest, limit.highest),
            *(np.abs(limit.sum.factors) @ axes.max_velocity, *limit.sum.factors),
        ]
        for limit in limits
    ]
    return Bounds(
        np.array(alone, np.float64),
        np.array(together, np.float64).reshape(-1, 4 + axes.count),
        np.array(conditions, np.float64).reshape(-1, 5 + axes.count),
    )


def _near(
    clearance: Clearance, parts: Sequence[PartClearance], speeds: Vector, reserve_mm: float
) -> Near:
    """parts: none where only the whole body is known."""
    whole_and_parts: list[Clearance | PartClearance] = [clearance, *parts]
    rows = np.empty((len(whole_and_parts), speeds.size + 2))
    rows[:, :-2] = [one.slope for one in whole_and_parts]
    rows[:, -2] = [one.clearance_mm - reserve_mm for one in whole_and_parts]
    rows[:, -1] = ((rows[:, :-2] * speeds) ** 2).sum(axis=1)
    tip = np.zeros((POSITION + 2 * TASK_ROWS, speeds.size))
    if parts:
        pointing = np.array(clearance.tip_slope, np.float64)
        pointing[POSITION:] *= _POINTING_MM_PER_RAD
        place = tip[:POSITION] = pointing[:POSITION]
        tip[POSITION : 2 * POSITION] = _counted(place, speeds)
        tip[POSITION + TASK_ROWS :] = _counted(pointing, speeds)
    return Near(np.array(clearance.u, np.float64), rows, tip)


def _counted(task: Vector, speeds: Vector) -> Vector:
    """(k, m) of a task as it counts beside the axes."""
    reach = float(((task * speeds) ** 2).sum() / len(task))
    return np.asarray(task * np.sqrt(_TASK_COUNTS / max(reach, 1e-9)))
