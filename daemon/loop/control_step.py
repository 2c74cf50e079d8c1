"""The control step, paced by tracker frames: from a measurement to targets on the bus."""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from config.robot import Robot
from daemon.control.avoidance import Avoidance
from daemon.control.controller import Controller, ControllerError, Observation, Phase
from daemon.control.task import tip_axis
from daemon.estimation.pose_filter import PoseFilter, TipEstimate
from daemon.loop.actuation_history import ActuationHistory
from daemon.loop.axis_targets import AxisTargets
from daemon.loop.frame_statistics import FrameStatistics, StepPeriod
from daemon.loop.reasons_to_hold import Followed, ReasonsToHold
from daemon.loop.step_messages import (
    RequestedStep,
    RiskAsked,
    Sensed,
    angle_rad,
    axes_message,
    distance_mm,
    place_mm,
    risk_message,
    tip_message,
)
from daemon.loop.timekeeping import Timekeeping
from daemon.messages import Message
from daemon.reference.reference import Aim, Reference
from daemon.robot.axes import AxisRanges
from daemon.supervision.checks import in_order
from daemon.supervision.supervisor import Supervisor
from drivers.aurora.frame import TrackerFrame
from drivers.cia402.drive_bus import DriveBus
from drivers.clock import Clock
from safety.gate import RISK, RISK_UNAVAILABLE, Decision, Gate, Measured
from safety.permit import PermittedStep
from safety.risk_source import (
    Clearance,
    RiskSource,
    WayCounting,
    ask,
    clearance_of,
    count_way,
    minute_risk_of,
    name_of,
)
from safety.states import Request

FRAME_PERIOD_NS: Final = {"normal": 25_000_000, "fast": 15_151_515}
_LONGEST_DT_S: Final = 0.1
"""Four frames of 25 ms, or two of a slow tracker's: after a longer gap the reference goes on as if
there had been so much."""


class ControlLoop:
    """Carries out one step for every frame. Made for one robot; follows one reference at a time."""

    def __init__(
        self,
        robot: Robot,
        buses: Sequence[DriveBus],
        gate: Gate,
        supervisor: Supervisor,
        timekeeping: Timekeeping,
        clock: Clock,
        publish: Callable[[Message], None],
        risk: RiskSource,
    ) -> None:
        """publish: hears of every step. risk: whom the gate asks too."""
        self.filter = PoseFilter(robot.pose_filter)
        self.history = ActuationHistory(len(robot.axes))
        self.reasons = ReasonsToHold(robot, risk, self.history, supervisor.checks, clock)
        self.frames = FrameStatistics()
        self.controller: Controller | None = None
        self.reference: Reference | None = None
        self.steps = 0
        self.tip: TipEstimate | None = None
        self.outside_mm = -math.inf
        """How far the tip is outside the workspace, where no reference may lead it; negative: how
        far it is from its walls."""
        self.near_at_rest = ""
        """Where something is too near to the energised body that stands; empty: nowhere, or it is
        not known."""
        self.aim: Aim | None = None
        self.path_risk: float | None = None
        """Of what is left of a planned path; None: none is followed, or nobody knows."""
        self.note = ""
        """What the controller says that it is doing."""
        self.expected_mm: float | None = None
        """How far off the controller expects the tip to be; None: it does not know."""
        self.part: int | None = None
        """Which motion of an exploration this is; None while it follows."""
        self.decision: Decision | None = None
        self.channels = in_order(buses)
        self._axis_targets = AxisTargets(self.channels)
        self._buses = buses
        self._gate = gate
        self._supervisor = supervisor
        self._timekeeping = timekeeping
        self._clock = clock
        self._publish_message = publish
        self._step_period = StepPeriod(FRAME_PERIOD_NS[robot.tracker.frame_rate])
        self._threshold = robot.risk.threshold
        self._latest_after_s = robot.risk.latest_after_s
        self._slide = robot.risk.slide
        self._looks_round = robot.risk.model is not None
        tensions = [axis.tension_range_n for axis in robot.axes]
        self._avoidance = Avoidance(AxisRanges.of(robot), tensions)
        if self._looks_round:
            self._avoidance.warm_up()
        self._clearance: Clearance | None = None
        self._look_round = False
        box = robot.workspace
        self._workspace = () if box is None else (box.x_mm, box.y_mm, box.z_mm)
        self._tendons = [axis.tension_range_n is not None for axis in robot.axes]
        self._risk = risk
        self._way_counting = risk if isinstance(risk, WayCounting) else None
        self._last_frame_ns: int | None = None
        self._begun = False

    def step(self, frame: TrackerFrame) -> None:
        """Sense, estimate, decide, gate, act, publish."""
        self.frames.add(frame.t_ns, frame.received_ns)
        sensed = self._sense(frame)
        if sensed is None:
            return
        believed = self._estimate(sensed)
        if believed:
            self.reasons.compare(self.tip, frame.t_ns)
        requested = self._turned_aside(self._decide(sensed, believed), sensed)
        decision = self._pass_the_gate(sensed, requested)
        self._act(decision)
        on_bus_ns = self._clock.now_ns()
        # The targets are on their way: what is made of them has to keep none of them waiting.
        self._judge(decision, requested, on_bus_ns)
        self._finish(on_bus_ns)
        self.reasons.judge_tip(frame.t_ns, believed, self._followed, requested, decision)
        self._publish(sensed, believed, requested, decision)
        self._timekeeping.step_ended(frame.received_ns, on_bus_ns, self._clock.now_ns())

    def use_spare_time(self) -> None:
        """A little of what has been put off. For a moment with nothing else to do."""
        if self._look_round:
            self._look_round = False
            self.near_at_rest = self._near_at_rest()
            clearance = self._clearance_now()
            self._clearance = clearance if self._slide else None
            if self._clearance is not None:
                self._avoidance.prepare(self._clearance)
        elif self.controller is not None and self._begun:
            self.controller.learn()

    def settle(self) -> None:
        """The axes stand where they are, newly energised: nothing before counts."""
        self._gate.settle(self._axis_targets.measured)
        self._axis_targets.forget()
        self.begin()

    def refuses_rest(self) -> str:
        """Why the body may not be energised where it is; empty if it may."""
        counts = self._axis_targets.measured
        measured = Measured(counts, [None] * len(counts))
        return self._gate.refuses_rest(measured, self._clock.now_ns())

    def forget_clearance(self) -> None:
        """What was known of the room round the body is of other surroundings."""
        self._clearance = None

    def begin(self) -> None:
        """Follow the reference from here with the next step."""
        self._begun = False
        self.reasons.begin()

    def commanded_counts(self, now_ns: int) -> Sequence[int] | None:
        """Where each axis is told to be; None while they are told nothing."""
        return self.target_counts(now_ns) if self._supervisor.state.follows else None

    @property
    def minute_risk(self) -> float | None:
        """How likely something was touched in the last minute; None: nobody knows."""
        if self._way_counting is None:
            return None
        return minute_risk_of(self._way_counting, self._clock.now_ns())

    @property
    def error_mm(self) -> float | None:
        """Distance of the tip from its reference, at the last step."""
        return distance_mm(place_mm(self.tip), place_mm(self.aim))

    @property
    def error_rad(self) -> float | None:
        """Of the tip's direction from its reference, at the last step; None: it may be any."""
        return angle_rad(self.tip, self.aim)

    @property
    def _followed(self) -> Followed:
        return Followed(self.controller, self.tip, self.aim)

    # The parts of a step, in their order.

    def _sense(self, frame: TrackerFrame) -> Sensed | None:
        """None: before the axes have told where they are, there is no step."""
        last_ns, self._last_frame_ns = self._last_frame_ns, frame.t_ns
        silent = any(channel.received_ns is None for channel in self.channels)
        if last_ns is None or silent or not self.history.known:
            self.filter.update(frame.t_ns, frame.tip)
            self._believe(self.filter.estimate(frame.t_ns))
            return None
        self._step_period.add(frame.t_ns - last_ns)
        longest_s = max(_LONGEST_DT_S, 2e-9 * self._step_period.period_ns)
        dt_s = min((frame.t_ns - last_ns) * 1e-9, longest_s)
        counts = self._axis_targets.measured
        tensions = [
            channel.scale.force(channel.torque_permille) if tendon else None
            for channel, tendon in zip(self.channels, self._tendons, strict=True)
        ]
        targets = self._axis_targets.in_units(self.target_counts(self._clock.now_ns()))
        u = self.history.at_frame(frame.t_ns)
        return Sensed(frame, dt_s, u, targets, Measured(counts, tensions))

    def target_counts(self, now_ns: int) -> Sequence[int]:
        """Where each axis is told to be; where it is, while it is told nothing."""
        targets = self._axis_targets
        return targets.counts(now_ns) if self._supervisor.state.follows else targets.measured

    def _estimate(self, sensed: Sensed) -> bool:
        believed = self.filter.update(sensed.frame.t_ns, sensed.frame.tip)
        self._believe(self.filter.estimate(sensed.frame.t_ns))
        return believed and not self.reasons.jumps(self.filter.jumped_mm)

    def _believe(self, tip: TipEstimate | None) -> None:
        self.tip = tip
        self.outside_mm = -math.inf  # where the file names no workspace, nothing is outside of it
        if tip is not None and self._workspace:
            places = zip(tip.position_mm.tolist(), self._workspace, strict=True)
            beyond = [max(low - place, place - high) for place, (low, high) in places]
            outside_mm = math.hypot(*(max(one, 0.0) for one in beyond))  # of no number, no number
            self.outside_mm = max(beyond) if outside_mm == 0.0 else outside_mm

    def _decide(self, sensed: Sensed, believed: bool) -> RequestedStep | None:
        """What the controller wants; None: to stand still."""
        controller, reference, tip = self.controller, self.reference, self.tip
        self.expected_mm = None
        if controller is None or reference is None or tip is None:
            return None
        running = self._supervisor.running
        direction = tip_axis(tip.quaternion)
        if running and not self._begun:
            reference.begin(tip.position_mm, direction)
        follows = running and controller.ready and self._begun
        if follows:
            aim = reference.advance(sensed.frame.t_ns, sensed.dt_s)
        elif running:
            aim = reference.wait()
        else:
            aim = Aim(tip.position_mm, np.zeros(3), -1)
        observation = Observation(
            sensed.frame.t_ns,
            sensed.dt_s,
            sensed.u,
            sensed.targets,
            tip.position_mm,
            tip.velocity_mm_s,
            aim.position_mm,
            aim.velocity_mm_s,
            believed,
            reference.ahead if follows else None,
            direction,
            aim.direction,
            aim.turn,
            None if aim.in_cycle_s is None else Phase(aim.in_cycle_s, aim.cycle_s, aim.pace),
            sensed.tensions_n,
            reference.own_speed_mm_s if follows else None,
            aim.cycle >= 0,
        )
        self.aim = aim if running else None
        try:
            return self._ask(controller, observation, running)
        except ControllerError as error:
            self._supervisor.checks.controller_failed(sensed.frame.received_ns, str(error))
            return None

    def _ask(
        self, controller: Controller, observation: Observation, running: bool
    ) -> RequestedStep | None:
        if running and not self._begun:
            controller.reset(observation)
            self._begun = True
        controller.observe(observation)
        if not running:
            return None
        proposal = controller.propose(observation)
        if not all(map(math.isfinite, proposal.delta_u.tolist())):
            raise ControllerError("the controller proposed something that is not a number")
        if not 0.0 < proposal.pace <= 1.0:
            raise ControllerError(f"the controller asks for {proposal.pace} of the path's speed")
        self.note, self.part = proposal.note, proposal.part
        self.expected_mm = proposal.expected_mm
        if self.reference is not None:
            self.reference.go_at(proposal.pace)
        return RequestedStep(proposal.delta_u)

    def _turned_aside(
        self, requested: RequestedStep | None, sensed: Sensed
    ) -> RequestedStep | None:
        """Along what is near, where it leads there."""
        if requested is None or self._clearance is None:
            return requested
        aside = self._avoidance.aside(
            requested.delta_u,
            sensed.targets,
            self._clearance,
            sensed.dt_s,
            points=self.aim is not None and self.aim.direction is not None,
            tensions_n=sensed.measured.tension_n,
        )
        return requested if aside is None else RequestedStep(aside.delta_u, aside)

    def _pass_the_gate(self, sensed: Sensed, requested: RequestedStep | None) -> Decision | None:
        """What may be done; None: the drives hold by themselves."""
        if not self._supervisor.state.follows:
            return None
        now_ns = self._clock.now_ns()
        if requested is None:
            self._axis_targets.drop_rest()
            self.reasons.withdraw_refusals(now_ns)
            return self._gate.hold(sensed.measured, now_ns, self._step_period.period_ns)
        asked = self._axis_targets.asked(sensed.targets + requested.delta_u)
        decision = self._gate.decide(asked, sensed.measured, now_ns, self._step_period.period_ns)
        self._axis_targets.keep_rest(asked, None if decision.refused else decision.step)
        return decision

    def _act(self, decision: Decision | None) -> None:
        self.decision = decision
        self.steps += 1
        self._look_round = self._looks_round
        if decision is not None and decision.step is not None:
            self._send(decision.step)

    def _send(self, step: PermittedStep) -> None:
        """To all buses or to none."""
        if not all(bus.following for bus in self._buses):
            self.settle()  # an axis does not follow: what was permitted does not happen
        elif all(bus.takes(step) for bus in self._buses):
            self._axis_targets.take(step)
            for bus in self._buses:
                bus.write(step)
        else:
            self._gate.take_back(step)  # its targets would be a jump: the one before ends by itself

    def _judge(
        self, decision: Decision | None, requested: RequestedStep | None, now_ns: int
    ) -> None:
        """What the gate has made of what was asked for."""
        if decision is None or requested is None:
            return
        self.reasons.judge_gate(decision, requested, self._followed, now_ns)
        if decision.risk is not None and decision.refused != RISK_UNAVAILABLE:
            self._avoidance.take_judgement(decision.risk, self._threshold, RISK in decision.limits)
        if self._way_counting is not None and decision.step is not None and not decision.refused:
            count_way(self._way_counting, now_ns)

    def _finish(self, now_ns: int) -> None:
        """Where the reference has come to its end."""
        reference, running = self.reference, self._supervisor.running
        if running and reference is not None and reference.finished:
            self._supervisor.request(Request.FINISHED, now_ns)

    def _clearance_now(self) -> Clearance | None:
        """How near the body will be to something where it is told to go."""
        step = None if self.decision is None else self.decision.step
        if step is None or not self._supervisor.running:
            return None
        ends = self._axis_targets.in_units(step.to_counts)
        return clearance_of(self._risk, ends.tolist(), self._threshold)

    def _near_at_rest(self) -> str:
        """While nothing is asked of the gate, who else would see what comes onto the body?"""
        supervisor = self._supervisor
        if supervisor.running or not supervisor.state.follows:
            return ""
        u = self._axis_targets.in_units(self._axis_targets.measured).tolist()
        answer = ask(self._risk, u, u, self._clock.now_ns(), self._latest_after_s)
        near = not answer.doubt and answer.risk > self._threshold
        return (answer.detail or "it is not known where") if near else ""

    def _publish(
        self,
        sensed: Sensed,
        believed: bool,
        requested: RequestedStep | None,
        decision: Decision | None,
    ) -> None:
        """Told at once, and in this order: what was measured, what was done, and what it risked."""
        tell, sequence = self._publish_message, self.steps
        state = self._supervisor.state
        frame, expected_mm = sensed.frame, self.expected_mm
        tell(tip_message(sequence, state, frame, self.tip, self.aim, believed, expected_mm))
        tell(axes_message(sequence, sensed, self.channels, requested, decision))
        if decision is not None and requested is not None:
            about = RiskAsked(
                name_of(self._risk),
                self._threshold,
                self.reasons.compared,
                self.minute_risk,
                self.path_risk,
            )
            tell(risk_message(sequence, sensed.frame.t_ns, requested, decision, about))
