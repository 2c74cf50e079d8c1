"""Turns a step aside that would bring the body too near to something: then it goes along it.

The clearance that is left, h, may only get less as fast as it is large: Δh ≥ −γ (h − h₀) (a control
barrier function), for each part of the body that something is near to. Of all steps that keep to it
and to the axes' limits, each by itself and coupled, the one is taken that is nearest to the wanted,
each axis counted by its speed, and the tip's task besides: what it is asked to give up is dearer
than what the axes do where it does not see it. Where that gains the tip nothing, because there is
no other way for the body, the step is the nearest by the axes alone, and by the clearance of the
whole body.

It decides nothing: what comes out is a proposal, which the gate judges as any.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.control.avoidance_kernels import UNSOLVED, Wanted, nearest_step, room_for
from daemon.control.task import POSITION
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from safety.risk_source import Clearance, PartClearance

_RESERVE_MM: Final = 0.5
"""h₀: the gate counts the way there too, and braking."""
_CLOSER_PER_S: Final = 4.0
"""γ."""
_LEAST_SLOPE_MM_S: Final = 1.0
"""With all axes at full speed. Where less clearance is gained by that, there is no way along."""
_MOST_PARTS: Final = 8
_TASK_COUNTS: Final = 30.0
"""How much dearer it is to lead the tip away by what the axes do to it at most, than to have them
do it."""
_GAINS_FROM: Final = 0.5
"""Of what the tip would give up without its task in view; with more than that, nothing is gained.
Chosen: arms that can give way ask for a tenth to a fifth, those that cannot for nine tenths."""
_POINTING_MM_PER_RAD: Final = 25.0
"""What turning the tip counts for, as for controllers."""
_TENSION_KEPT: Final = 0.1
"""Share of a tendon's range of tensions, at either end, that is not gone into to keep the tip where
it is: what leaves the tip alone is, on arms with tendons, all of them together."""


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


@dataclass(frozen=True, slots=True, eq=False)
class _Near:
    """A clearance as the step needs it: whatever does not depend on the step."""

    u: Vector
    """(m,) where it is of."""
    slope: Vector
    """(P, m) of its parts."""
    here_mm: Vector
    """(P,) there."""
    steep: NDArray[np.bool_]
    """(P,) whether there is a way along."""
    all_steep: bool
    place: Vector
    """(3, m) of the tip's place."""
    tasks: tuple[tuple[Vector, Vector], tuple[Vector, Vector]]
    """Of a tip that may point anywhere, and of one that may not: (k, m), and the same as it counts
    beside the axes."""
    nearest: PartClearance

    @classmethod
    def of(cls, clearance: Clearance, speeds: Vector) -> "_Near | None":
        """None: only the whole body is known."""
        if not clearance.parts or not clearance.tip_slope:
            return None
        parts = clearance.parts[:_MOST_PARTS]
        slope = np.array([part.slope for part in parts])
        steep = ((slope * speeds) ** 2).sum(axis=1) >= _LEAST_SLOPE_MM_S**2
        both = np.array(clearance.tip_slope)
        place = both[:POSITION]
        pointing = np.concatenate([place, _POINTING_MM_PER_RAD * both[POSITION:]])
        here = [part.clearance_mm for part in clearance.parts]
        return cls(
            np.array(clearance.u),
            slope,
            np.array(here[:_MOST_PARTS]),
            steep,
            bool(steep.all()),
            place,
            ((place, _counted(place, speeds)), (pointing, _counted(pointing, speeds))),
            clearance.parts[int(np.argmin(here))],
        )


def _counted(task: Vector, speeds: Vector) -> Vector:
    """(k, m) of a task as it counts beside the axes."""
    reach = float(((task * speeds) ** 2).sum() / len(task))
    return np.ascontiguousarray(task * np.sqrt(_TASK_COUNTS / max(reach, 1e-9)))


class Avoidance:
    """Of one robot. Not for several threads."""

    def __init__(
        self, axes: AxisRanges, tensions_n: Sequence[tuple[float, float] | None] = ()
    ) -> None:
        """tensions_n: lowest and highest of each axis; None, or none at all: it has none."""
        self._axes = axes
        ranges = [one or (-np.inf, np.inf) for one in tensions_n or [None] * axes.count]
        low, high = np.array(ranges, np.float64).T
        kept = np.where(np.isfinite(high - low), _TENSION_KEPT * (high - low), 0.0)
        self._slack_n, self._tight_n = low + kept, high - kept
        self._coupled = _CoupledRows(axes)
        self._room = room_for(axes.count, _MOST_PARTS + 2 * len(axes.coupled.limits))
        self._prepared: tuple[Clearance, _Whole, _Near | None] | None = None

    def warm_up(self) -> None:
        """Compile the kernel, or load it from numba's cache."""
        none = np.zeros(self._axes.count)
        rows = np.zeros((1, none.size))
        wanted = Wanted(none, none, none, self._axes.max_velocity, rows, np.zeros(1), rows)
        nearest_step(wanted, self._room, none.copy())

    def prepare(self, clearance: Clearance) -> None:
        """Work out in spare time what `aside` needs of a clearance; it does so itself otherwise."""
        speeds = self._axes.max_velocity
        self._prepared = clearance, _Whole.of(clearance, speeds), _Near.of(clearance, speeds)

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
        if self._prepared is None or self._prepared[0] is not clearance:
            self.prepare(clearance)
        assert self._prepared is not None
        _, whole_body, near = self._prepared
        whole = _avoid(delta_u, targets, whole_body, dt_s)
        if near is None:
            return None if whole is None else Aside(whole, None, clearance.clearance_mm, None)
        task, counted = near.tasks[points]
        limits = self._limits(targets, dt_s, tensions_n)
        parts = self._by_parts(delta_u, targets, near, dt_s, counted, limits)
        if whole is None and parts is None:
            return None
        chosen = self._cheaper(delta_u, whole, parts, task)
        if chosen is None:
            return None
        given_up = near.place @ (chosen - delta_u)
        return Aside(
            chosen,
            near.nearest.arc_mm,
            near.nearest.clearance_mm,
            float(np.sqrt(given_up @ given_up)),
        )

    def _limits(
        self, targets: Vector, dt_s: float, tensions_n: Sequence[float | None]
    ) -> tuple[Vector, Vector]:
        """(m,) lowest and highest step: travel, speed, and no tendon that hardly pulls is let out,
        nor pulled where it pulls nearly as much as it may."""
        lowest, highest = self._axes.step_range(targets)
        most = self._axes.max_velocity * dt_s
        lowest, highest = np.maximum(lowest, -most), np.minimum(highest, most)
        if any(tension is not None for tension in tensions_n):
            pulls = np.array([np.nan if one is None else one for one in tensions_n])
            lowest = np.where(pulls < self._slack_n, 0.0, lowest)
            highest = np.where(pulls > self._tight_n, 0.0, highest)
        return lowest, highest

    def _by_parts(
        self,
        delta_u: Vector,
        targets: Vector,
        near: _Near,
        dt_s: float,
        task: Vector,
        limits: tuple[Vector, Vector],
    ) -> Vector | None:
        """(m,) None: it may stay as it is, or there is none. task: as it counts beside the axes."""
        slope, steep, speeds = near.slope, near.steep, self._axes.max_velocity
        here_mm = near.here_mm + slope @ (targets - near.u)
        allowed_mm = -min(1.0, _CLOSER_PER_S * dt_s) * (here_mm - _RESERVE_MM)
        short = slope @ delta_u < allowed_mm
        if not (short if near.all_steep else short & steep).any():
            return None
        if not near.all_steep:
            slope, allowed_mm = slope[steep], allowed_mm[steep]
        rows, least = self._coupled.near(targets, dt_s)
        if least.size:
            slope, allowed_mm = np.concatenate([slope, rows]), np.concatenate([allowed_mm, least])
        wanted = Wanted(
            np.ascontiguousarray(delta_u, np.float64),
            *limits,
            speeds,
            slope,
            allowed_mm,
            task,
        )
        step = np.empty(speeds.size)
        return None if nearest_step(wanted, self._room, step) == UNSOLVED else step

    def _cheaper(
        self, delta_u: Vector, whole: Vector | None, parts: Vector | None, task: Vector
    ) -> Vector | None:
        """What the tip gives up less for; the one by the whole body where it is about the same."""
        if parts is None or whole is None:
            return whole if parts is None else parts
        by_whole, by_parts = task @ (whole - delta_u), task @ (parts - delta_u)
        return parts if by_parts @ by_parts <= _GAINS_FROM**2 * (by_whole @ by_whole) else whole


class _CoupledRows:
    """The coupled limits that a step could reach, as rows beside those of the parts.

    A limit that counts only sometimes is kept where it counts as the step begins. The gate keeps
    all of them anyway; what it has to cut from a step that ignores them is lost for the tip.
    """

    def __init__(self, axes: AxisRanges) -> None:
        limits = self._limits = axes.coupled.limits
        self._factors = np.array([limit.sum.factors for limit in limits]).reshape(-1, axes.count)
        self._constant = np.array([limit.sum.constant for limit in limits])
        self._lowest = np.array([limit.lowest for limit in limits])
        self._highest = np.array([limit.highest for limit in limits])
        self._fastest = np.abs(self._factors) @ axes.max_velocity

    def near(self, targets: Vector, dt_s: float) -> tuple[Vector, Vector]:
        """(q, m) rows, and (q,) the least that each may be times the step from (m,) targets."""
        if not self._limits:
            return self._factors, self._constant
        sums = self._factors @ targets + self._constant
        counts = np.array(
            [all(bool(one.met(targets)) for one in limit.only_while) for limit in self._limits],
            np.bool_,
        )
        most = self._fastest * dt_s
        low, high = self._lowest - sums, sums - self._highest
        falls, rises = counts & (-low <= most), counts & (-high <= most)
        rows = np.concatenate([self._factors[falls], -self._factors[rises]])
        return rows, np.minimum(np.concatenate([low[falls], high[rises]]), 0.0)


class _Whole(NamedTuple):
    """The clearance of the whole body as the step needs it."""

    clearance_mm: float
    u: Vector
    slope: Vector
    square: float
    """Of the steepest."""
    steepest: Vector
    """(m,) the slope with all axes at full speed."""
    speeds: Vector

    @classmethod
    def of(cls, clearance: Clearance, speeds: Vector) -> "_Whole":
        slope = np.array(clearance.slope)
        steepest = slope * speeds
        square = float(steepest @ steepest)
        u = np.array(clearance.u)
        return cls(clearance.clearance_mm, u, slope, square, steepest, speeds)


def avoid(
    delta_u: Vector, targets: Vector, clearance: Clearance, max_velocity: Vector, dt_s: float
) -> Vector | None:
    """The (m,) step by the clearance of the whole body alone; None: it may stay as it is."""
    return _avoid(delta_u, targets, _Whole.of(clearance, max_velocity), dt_s)


def _avoid(delta_u: Vector, targets: Vector, whole: _Whole, dt_s: float) -> Vector | None:
    here_mm = whole.clearance_mm + float(whole.slope @ (targets - whole.u))
    change_mm = float(whole.slope @ delta_u)
    allowed_mm = -min(1.0, _CLOSER_PER_S * dt_s) * (here_mm - _RESERVE_MM)
    if change_mm >= allowed_mm or whole.square < _LEAST_SLOPE_MM_S**2:
        return None
    share = (allowed_mm - change_mm) / whole.square
    aside: Vector = delta_u + share * whole.steepest * whole.speeds
    return aside
