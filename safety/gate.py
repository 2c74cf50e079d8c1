"""The gate: what a controller wants goes through here, and only what comes out may move.

It may only reduce: scale, hold, refuse. Hard limits come first and last, the risk of touching
something in between; braking is always allowed, and leaving what already touches.
"""

from collections.abc import Sequence
from math import isfinite
from typing import Final, NamedTuple

from safety import shaping
from safety.coupled_shaping import CoupledStep
from safety.coupling import CoupledLimit
from safety.limits import CountLimits
from safety.permit import PermittedHoming, PermittedStep, permit, permit_homing
from safety.risk_source import Nearest, RiskAnswer, RiskAnswers, RiskSource, ask
from safety.shaping import AxisMotion

RISK: Final = "risk"
RISK_UNAVAILABLE: Final = "risk unavailable"
_SMALLER_SHARES: Final = (0.5, 0.25)
"""Of the change, tried one after the other where the risk of all of it is too high."""


class Measured(NamedTuple):
    """What the drives say. One element per axis; None where an axis says nothing."""

    position_counts: Sequence[int | None]
    tension_n: Sequence[float | None]
    """Only asked for where an axis has tension limits."""


class Decision(NamedTuple):
    """What the gate made of a proposal."""

    step: PermittedStep | None
    """None: nothing may be sent, and the drives come to rest after the end of their last step."""
    scale: float
    """Share of the proposed change that is let through, of the axis that keeps least of it."""
    limits: tuple[str, ...]
    """What made the step another than proposed, each with its axis: `velocity: axis 2`."""
    risk: float | None
    """What the decision is made on; None: not asked, as in a hold."""
    body_point_risk: float | None
    risk_detail: str
    refused: str
    """Why nothing of the proposal is let through, and the step only brakes; empty if it is."""
    nearest: Nearest | None
    """What the risk is of; None: nobody said."""
    answers: RiskAnswers | None = None
    """Of which the risk is one; None: there is but one."""
    kept: float = 0.0
    """As `scale`, but of axes that still go the other way nothing is kept back: they turn as fast
    as they may, which slow drives take a second for."""


class _Start(NamedTuple):
    """What a step begins with."""

    motions: list[AxisMotion]
    positions: list[int]
    tensions: Sequence[float | None]
    begins_ns: int
    duration_ns: int
    coupled: CoupledStep | None
    """None: there are no coupled limits."""


class Gate:
    """Of one robot. Remembers the last step it permitted: the next one begins where that one is.

    Frames come early and late: a step begins from where the last one has led by then, and from the
    velocity that it has there, which after its end is that of braking.
    """

    def __init__(
        self,
        limits: Sequence[CountLimits],
        counts_per_unit: Sequence[float],
        tension_limits_n: Sequence[tuple[float, float] | None],
        risk: RiskSource,
        threshold: float,
        latest_after_s: float,
        coupled: Sequence[CoupledLimit] = (),
    ) -> None:
        """One element per axis; a positive change of u pulls a tendon, whatever its counts do.

        threshold: the highest risk that may be taken. latest_after_s: what all answers about one
        step may take together. coupled: what axes may not do together. Raises ValueError where
        these do not fit together.
        """
        if not len(limits) == len(counts_per_unit) == len(tension_limits_n):
            raise ValueError("the gate needs limits, a scale and tension limits for each axis")
        if not all(isfinite(scale) and scale for scale in counts_per_unit):
            raise ValueError("a scale is finite and not zero")
        if not 0.0 <= threshold <= 1.0:
            raise ValueError(f"the risk threshold {threshold} is not a probability")
        for limit in coupled:
            limit.check(len(limits))
        self._limits = tuple(limits)
        self._coupled = tuple(coupled)
        self._counts_per_unit = tuple(counts_per_unit)
        self._tension_limits_n = tuple(tension_limits_n)
        self._risk = risk
        self._threshold = threshold
        self._latest_after_s = latest_after_s
        self._settled: tuple[int, ...] | None = None
        self._last: PermittedStep | None = None
        self._before: PermittedStep | None = None
        """The one before the last."""

    def settle(self, position_counts: Sequence[int]) -> None:
        """Begin anew, at rest, from where the axes are: whenever the drives did not follow.

        Raises ValueError where there is not one position per axis.
        """
        if len(position_counts) != len(self._limits):
            raise ValueError(f"{len(position_counts)} positions for {len(self._limits)} axes")
        self._settled, self._last, self._before = tuple(position_counts), None, None

    def take_back(self, step: PermittedStep) -> None:
        """The step, the last one permitted, was not sent: the axes still follow the one before."""
        if step is self._last:
            self._last = self._before

    def decide(
        self, targets: Sequence[float], measured: Measured, begins_ns: int, duration_ns: int
    ) -> Decision:
        """The step towards where a controller wants the axes, in counts, at the step's end."""
        unusable = self._unusable(measured, duration_ns)
        if unusable:
            return _decision(None, 0.0, (), None, unusable)
        start = self._start(measured, begins_ns, duration_ns)
        if len(targets) != len(self._limits):
            return self._brake(start, f"{len(targets)} targets for {len(self._limits)} axes")
        for axis, target in enumerate(targets):
            if not isfinite(target):
                return self._brake(start, f"the target is {target}: axis {axis}")
        limited: list[str] = []
        changes = self._shaped(self._wanted(targets, start, limited), start, limited)
        changes, answer = self._weighed(changes, start, limited)
        if answer.doubt:
            return self._brake(start, RISK_UNAVAILABLE, limited, answer)
        if not answer.bearable(self._threshold):
            return self._brake(start, RISK, limited, answer)
        step = self._permit(changes, start)
        if isinstance(step, str):
            return self._brake(start, step, limited, answer)
        kept, turns = _share_of(targets, changes, start.motions)
        scale = 0.0 if turns else kept
        return _decision(step, scale, limited, answer, "", kept)

    def hold(self, measured: Measured, begins_ns: int, duration_ns: int) -> Decision:
        """Come to rest as fast as the limits allow, or stay there."""
        unusable = self._unusable(measured, duration_ns)
        if unusable:
            return _decision(None, 0.0, (), None, unusable)
        return self._brake(self._start(measured, begins_ns, duration_ns))

    def refuses_rest(self, measured: Measured, t_ns: int) -> str:
        """Why a body at rest where it is measured may not be energised; empty if it may.

        Whatever touches already would be pushed by the next motion, and what cannot be known of
        its risk cannot be driven.
        """
        unusable = self._unmeasured(measured)
        if unusable:
            return unusable
        u = [
            position / scale
            for position, scale in zip(measured.position_counts, self._counts_per_unit, strict=True)
            if position is not None
        ]
        answer = ask(self._risk, u, u, t_ns, self._latest_after_s)
        if answer.doubt:
            return f"the risk of touching something is not known here: {answer.doubt}"
        if answer.risk <= self._threshold:
            return ""
        where = answer.detail or "it is not known where"
        if answer.nearest is not None:
            where = _words_of_place(answer.nearest)
        return (
            f"the body touches something where it stands, or may at any moment: {where}; "
            f"the risk is {answer.risk:.3g}, and {self._threshold:g} is allowed"
        )

    def permit_homing(self, axis: int, known_counts: Sequence[int | None]) -> PermittedHoming:
        """Leave for one drive to look for its zero while the others stand.

        known_counts: where each axis is; None of those that do not know their zero. Where it ends
        is not where the gate left it: `settle` before the next step. Raises ValueError where there
        is no such axis, or not one place for each.
        """
        if not 0 <= axis < len(self._limits):
            raise ValueError(f"there is no axis {axis}")
        if len(known_counts) != len(self._limits):
            raise ValueError(f"{len(known_counts)} places for {len(self._limits)} axes")
        return permit_homing(axis, self._limits[axis], known_counts, self._coupled)

    # Where a step begins.

    def _unusable(self, measured: Measured, duration_ns: int) -> str:
        return self._unmeasured(measured) if duration_ns > 0 else "the step has no duration"

    def _unmeasured(self, measured: Measured) -> str:
        count = len(self._limits)
        if not len(measured.position_counts) == len(measured.tension_n) == count:
            return f"not one measurement for each of {count} axes"
        for axis, position in enumerate(measured.position_counts):
            if position is None:
                return f"not measured: axis {axis}"
        return ""

    def _start(self, measured: Measured, begins_ns: int, duration_ns: int) -> _Start:
        positions = [position for position in measured.position_counts if position is not None]
        last = self._last
        if last is None:
            motions = [
                AxisMotion(at, 0.0, duration_ns, duration_ns) for at in self._settled or positions
            ]
        else:
            motions = [
                AxisMotion(
                    last.target(axis, begins_ns),
                    last.velocity(axis, max(begins_ns, last.begins_ns)),
                    duration_ns,
                    last.unchanged_ns(axis, begins_ns),
                )
                for axis in range(len(positions))
            ]
        coupled = CoupledStep(motions, self._limits, self._coupled) if self._coupled else None
        return _Start(motions, positions, measured.tension_n, begins_ns, duration_ns, coupled)

    # What it may be.

    def _wanted(self, targets: Sequence[float], start: _Start, limited: list[str]) -> list[int]:
        """The changes towards the targets: inside the travel, and all scaled by the same factor."""
        ways, factor, slowed = [], 1.0, ""
        for axis, (target, motion, limits) in enumerate(
            zip(targets, start.motions, self._limits, strict=True)
        ):
            lowest, highest = min(limits.lowest, motion.start), max(limits.highest, motion.start)
            inside = max(lowest, min(highest, target))
            if inside != target:
                limited.append(f"position: axis {axis}")
            way = inside - motion.start
            largest = shaping.largest_change(limits, start.duration_ns)
            if abs(way) * factor > largest:
                factor, slowed = largest / abs(way), f"velocity: axis {axis}"
            ways.append(way)
        if slowed:
            limited.append(slowed)
        return [
            self._allowed_by_sensors(axis, round(way * factor), start, limited)
            for axis, way in enumerate(ways)
        ]

    def _allowed_by_sensors(self, axis: int, change: int, start: _Start, limited: list[str]) -> int:
        """What tension and measured position leave of a change."""
        tension_limits_n = self._tension_limits_n[axis]
        if tension_limits_n is not None:
            up_pulls = self._counts_per_unit[axis] > 0
            tense = shaping.within_tension(change, start.tensions[axis], tension_limits_n, up_pulls)
            if tense != change:
                limited.append(f"tension: axis {axis}")
                change = tense
        near = shaping.within_lag(
            change, start.motions[axis], start.positions[axis], self._limits[axis]
        )
        if near != change:
            limited.append(f"distance from measured: axis {axis}")
        return near

    def _shaped(self, wanted: Sequence[int], start: _Start, limited: list[str]) -> list[int]:
        """The changes that acceleration, braking distance and coupled limits leave."""
        changes = []
        for axis, (change, motion, limits) in enumerate(
            zip(wanted, start.motions, self._limits, strict=True)
        ):
            reached = shaping.within_acceleration(change, motion, limits)
            if reached != change:
                limited.append(f"acceleration: axis {axis}")
            stoppable = shaping.within_travel(reached, motion, limits)
            if stoppable != reached:
                limited.append(f"braking distance: axis {axis}")
            changes.append(stoppable)
        return changes if start.coupled is None else start.coupled.shaped(changes, limited)

    # What it risks.

    def _weighed(
        self, changes: list[int], start: _Start, limited: list[str]
    ) -> tuple[list[int], RiskAnswer]:
        """The largest share of the changes whose risk may be taken; the smallest if none may."""
        tried, left_s = changes, self._latest_after_s
        answer = self._risk_of(tried, start, left_s)
        for share in _SMALLER_SHARES:
            if answer.doubt or answer.bearable(self._threshold):
                break
            left_s -= answer.took_s
            smaller = [round(change * share) for change in changes]
            tried = self._shaped(smaller, start, [])
            answer = self._risk_of(tried, start, left_s)
        if tried is not changes:
            limited.append(RISK)
        return tried, answer

    def _risk_of(self, changes: Sequence[int], start: _Start, latest_after_s: float) -> RiskAnswer:
        """Of the way from where the body is to where it would stop after such a step."""
        u_from = [
            position / scale
            for position, scale in zip(start.positions, self._counts_per_unit, strict=True)
        ]
        u_to = [
            stop / scale
            for stop, scale in zip(self._stops(changes, start), self._counts_per_unit, strict=True)
        ]
        return ask(self._risk, u_from, u_to, start.begins_ns, latest_after_s)

    def _stops(self, changes: Sequence[int], start: _Start) -> Sequence[float]:
        """Where each axis comes to rest if it brakes after such a step."""
        if start.coupled is not None:
            return start.coupled.rest(changes)
        return [
            shaping.stops_at(change, motion, limits)
            for change, motion, limits in zip(changes, start.motions, self._limits, strict=True)
        ]

    # What comes out.

    def _permit(self, changes: Sequence[int], start: _Start) -> PermittedStep | str:
        """The last check; the words of what it finds, if it finds something."""
        from_counts = [motion.start for motion in start.motions]
        result = permit(
            from_counts=from_counts,
            to_counts=[at + change for at, change in zip(from_counts, changes, strict=True)],
            measured_counts=start.positions,
            velocities_before=[motion.velocity for motion in start.motions],
            begins_ns=start.begins_ns,
            duration_ns=start.duration_ns,
            limits=self._limits,
            coupled=self._coupled,
        )
        if not isinstance(result, PermittedStep):
            return "; ".join(str(violation) for violation in result)
        self._before, self._last = self._last, result
        return result

    def _brake(
        self,
        start: _Start,
        refused: str = "",
        limited: Sequence[str] = (),
        answer: RiskAnswer | None = None,
    ) -> Decision:
        step = self._permit(self._shaped(self._braking(start), start, []), start)
        if isinstance(step, str):
            return _decision(None, 0.0, limited, answer, refused or step)
        return _decision(step, 0.0 if refused else 1.0, limited, answer, refused)

    def _braking(self, start: _Start) -> list[int]:
        """The changes of braking: to want none, of each axis or of all the same share."""
        return [0] * len(self._limits) if start.coupled is None else start.coupled.braking()


def _words_of_place(nearest: Nearest) -> str:
    x, y, z = nearest.place_mm
    return (
        f"clearance {nearest.clearance_mm:.1f} mm at {nearest.arc_mm:.0f} mm along the body, "
        f"there ({x:.0f}, {y:.0f}, {z:.0f}) mm"
    )


def _share_of(
    targets: Sequence[float], changes: Sequence[int], motions: Sequence[AxisMotion]
) -> tuple[float, bool]:
    """How much of what was proposed is left, of the axis that keeps least of it, without those that
    still go the other way; and whether there are any."""
    share, turns = 1.0, False
    for target, change, motion in zip(targets, changes, motions, strict=True):
        proposed = target - motion.start
        if not (round(change - proposed) and proposed):
            continue
        if change / proposed < 0.0:
            turns = True
        else:
            share = min(share, change / proposed)
    return share, turns


def _decision(
    step: PermittedStep | None,
    scale: float,
    limited: Sequence[str],
    answer: RiskAnswer | None,
    refused: str,
    kept: float = 0.0,
) -> Decision:
    limits = tuple(limited)
    if answer is None:
        return Decision(step, scale, limits, None, None, "", refused, None)
    risk, beside, detail = answer.risk, answer.body_point_risk, answer.detail
    told = answer.nearest, answer.answers
    return Decision(step, scale, limits, risk, beside, detail, refused, *told, kept)
