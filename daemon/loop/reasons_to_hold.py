"""What of a step is a reason to hold: a tip that jumps, that is not where the model of the body has
it, or that does not get to its reference; and a gate that leaves nothing of what is asked for.

Each is told to the supervisor's checks, which know how bad it is and how long it may last.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from config.robot import Robot
from daemon.control.controller import Controller
from daemon.control.task import tip_axis
from daemon.estimation.pose_filter import TipEstimate
from daemon.loop.actuation_history import ActuationHistory
from daemon.loop.step_messages import RequestedStep, distance_mm, place_mm
from daemon.reference.reference import Aim
from daemon.supervision.checks import NOTHING_REFUSED, Checks, GateReport
from daemon.supervision.tracking_error import TrackingError
from drivers.clock import Clock
from safety.coupled_shaping import COUPLED
from safety.gate import RISK, RISK_UNAVAILABLE, Decision
from safety.risk_source import RiskSource, TipComparing, TipComparison, compared

_REQUESTED_ABOVE: Final = 1e-3
"""mm or rad: a micrometre is a third of a count of the shipped arms' drives to 33 of them, and less
than any tracker shows."""
_LATELY_NS: Final = (0, 100_000_000, 200_000_000, 300_000_000)
"""Before a frame: a body follows its axes late, one of gas by 0.05 to 0.2 s."""
_STUCK_BELOW: Final = 0.02
"""Share of a proposal under which the gate lets practically nothing through. Chosen: of a tip's 15
to 25 mm/s it is 0.3 to 0.5 mm in the second that its cause waits, as little as a frame's noise."""
_LITTLE_BELOW: Final = 0.5
"""... and under which a tip cannot be expected to get anywhere in time. Chosen: at half the speed
the way to a reference takes twice as long."""
_FROM_OUTSIDE: Final = (RISK, "tension", COUPLED)


class Followed(NamedTuple):
    """Who leads the tip, where it is, and where it should be; None where there is none."""

    controller: Controller | None
    tip: TipEstimate | None
    aim: Aim | None


class ReasonsToHold:
    """Looks at one step after the other."""

    def __init__(
        self,
        robot: Robot,
        risk: RiskSource,
        history: ActuationHistory,
        checks: Checks,
        clock: Clock,
    ) -> None:
        """risk: who may know where the tip should be. history: of the robot's axes."""
        self.refusals = 0
        """How many steps the gate has refused."""
        self.compared: TipComparison | None = None
        """The last word on whether the tip is where the model of the body has it."""
        self._history = history
        self._checks = checks
        self._clock = clock
        self._tip_comparing = risk if isinstance(risk, TipComparing) else None
        most_mm = robot.supervision.tip_jump_mm
        self._tip_jump_mm = math.inf if most_mm is None else most_mm
        self._threshold = robot.risk.threshold
        self._limit_reasons = {COUPLED + one.name: one.reason for one in robot.coupled_limits}
        self._tracking_error = TrackingError.of(robot)

    def begin(self) -> None:
        """A reference is followed from here."""
        self._tracking_error.begin()

    def withdraw_refusals(self, t_ns: int) -> None:
        """Nothing is asked of the gate, and so nothing is refused, even if no more frames come."""
        self._checks.gate(t_ns, NOTHING_REFUSED)

    def jumps(self, jumped_mm: float) -> bool:
        """Whether the tip does, which went so far from one frame to the next and stayed there. The
        controller must not take that for what its axes have done."""
        if not jumped_mm > self._tip_jump_mm:
            return False
        detail = f"{jumped_mm:.0f} mm from one frame to the next"
        self._checks.tip_jumped(self._clock.now_ns(), detail)
        return True

    def compare(self, tip: TipEstimate | None, t_ns: int) -> None:
        """Whether the tip is where the model of the body has it: energised or not."""
        if tip is None or self._tip_comparing is None:
            return
        lately = [self._history.about(t_ns - ago_ns).tolist() for ago_ns in _LATELY_NS]
        at_mm, along = tip.position_mm.tolist(), tip_axis(tip.quaternion).tolist()
        found = compared(self._tip_comparing, lately, at_mm, t_ns, along)
        if found is None:
            return
        self.compared = found
        self._checks.body_not_as_modelled(bool(found.doubt), self._clock.now_ns())

    def judge_gate(
        self, decision: Decision, requested: RequestedStep, followed: Followed, now_ns: int
    ) -> None:
        """A step that was refused, or cut to nothing again and again, is a reason to hold."""
        self.refusals += bool(decision.refused)
        too_high, unknown = decision.refused == RISK, decision.refused == RISK_UNAVAILABLE
        if self.compared is not None and self.compared.doubt:
            unknown = False  # that follows from a cause which is told by itself
        moves = any(abs(change) > _REQUESTED_ABOVE for change in requested.delta_u.tolist())
        stuck = moves and not (too_high or unknown) and decision.kept < _STUCK_BELOW
        limits = decision.refused or self._in_words(decision.limits) if stuck else ""
        risk = 0.0 if decision.risk is None or decision.refused else decision.risk
        leaving = risk > self._threshold
        detail = decision.risk_detail
        kept_away = requested.aside is not None and self._is_off(followed)
        report = GateReport(too_high, unknown, detail, stuck, limits, leaving, kept_away)
        self._checks.gate(now_ns, report)

    def judge_tip(
        self,
        t_ns: int,
        believed: bool,
        followed: Followed,
        requested: RequestedStep | None,
        decision: Decision | None,
    ) -> None:
        """Hold where the tip does not get nearer to its reference although it could. t_ns: of its
        measurement."""
        controller, tip, aim = followed
        if not (controller and controller.ready and requested and decision and tip and aim):
            self._tracking_error.begin()
        elif requested.aside is not None or _hinders(decision):
            self._tracking_error.hinder()
        elif believed:
            detail = self._tracking_error.look(
                t_ns, tip.position_mm.tolist(), aim.position_mm.tolist()
            )
            if detail:
                self._tracking_error.begin()
                detail = f"{detail}; the controller is {controller.name}"
                self._checks.tracking_diverges(self._clock.now_ns(), detail)

    def _is_off(self, followed: Followed) -> bool:
        """Whether the tip is farther from what it follows than it should be."""
        controller, tip, aim = followed
        error_mm = distance_mm(place_mm(tip), place_mm(aim))
        far = error_mm is not None and error_mm > self._tracking_error.allowed_mm
        return far and controller is not None and controller.ready

    def _in_words(self, limits: Sequence[str]) -> str:
        """What made a step another, with the reason where the robot file gives one."""
        reasons = self._limit_reasons
        return ", ".join([f"{one} ({reasons[one]})" if one in reasons else one for one in limits])


def _hinders(decision: Decision) -> bool:
    """Whether what is near, a tendon or a coupled limit leaves little of a step. What the axes' own
    speed and acceleration leave is still the controller's."""
    outside = any(limit.startswith(_FROM_OUTSIDE) for limit in decision.limits)
    return bool(decision.refused) or (outside and decision.scale < _LITTLE_BELOW)
