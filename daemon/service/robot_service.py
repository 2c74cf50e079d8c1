"""The robot while the daemon runs: devices, loop, supervisor and gate, wired to each other.

Nothing here knows who is listening. What happens is published to `subscribers` as messages; what
is asked for comes in through `operator.Operator`.
"""

import asyncio
import logging
from collections.abc import Callable
from importlib.metadata import version
from typing import Final

from config.loader import RobotFile
from config.robot import Robot
from daemon.host.periodic_timer import Tick
from daemon.loop.control_step import ControlLoop
from daemon.loop.timekeeping import Timekeeping, TimeSpent
from daemon.messages import (
    LeaseStatus,
    Loop,
    Obstacles,
    ObstaclesTaken,
    Status,
    Verb,
)
from daemon.risk.body_risk_source import BodyRiskSource
from daemon.robot.axes import AxisRanges
from daemon.robot.coupled_axes import count_coupling
from daemon.robot.hardware import Hardware, Listeners
from daemon.service.dependencies import Dependencies
from daemon.service.following import Following
from daemon.service.lease import Lease
from daemon.service.monitors import Monitors
from daemon.service.obstacles import MovingObstacles, Refusals, horizon_s
from daemon.service.telemetry.body_teller import BodyTeller
from daemon.service.telemetry.events import EventHistory
from daemon.service.telemetry.status import StatusReport
from daemon.supervision.supervisor import Supervisor
from drivers.aurora.frame import TrackerFrame
from drivers.axis_scale import axis_scale, count_limits
from drivers.cia402.drive_bus import DriveBus
from drivers.conditions import ConditionChange
from safety.causes import Cause
from safety.gate import Gate
from safety.risk.moving_obstacles import Swept
from safety.states import OperatingState, Request

_log = logging.getLogger(__name__)

_STATUS_EVERY_NS: Final = 100_000_000
_AHEAD_EVERY_NS = 25_000_000
_LOOP_EVERY_NS: Final = 1_000_000_000
AT_REST_WITHIN_S: Final = 3.5
"""More than `power.py` gives the drives to stop and to switch off, one after the other: 2.5 s."""
_LOOK_EVERY_S: Final = 0.002
_NOBODY_COUNTS: Final = "this robot has no model of its body, and nothing counts with obstacles"
_SLOWED_BELOW: Final = 0.95
"""Of a path's own speed: less is told as an event, and all of it again."""
_CHECKS_WITHIN_S: Final = 3.0
"""Some fifteen objects of each drive, all drives at once; the slowest take 0.1 s for each."""


class RobotService:
    """One robot. `run` until cancelled, then `rest` and it has let go of everything."""

    def __init__(self, file: RobotFile, robot: Robot, dependencies: Dependencies) -> None:
        """robot: the file's, with its ports as they are to be opened. Raises EdsError."""
        self.robot = robot
        self.dependencies = dependencies
        self.clock = dependencies.clock
        self.version = version("tentacled")
        self.publish = dependencies.subscribers.publish
        """Tells everybody."""
        self.events = EventHistory(self.clock, self.publish)
        self.holds = 0
        """How often the motion was held, by anything but the operator."""
        self.verbs: Callable[[], list[Verb]] = list
        token = {} if dependencies.new_token is None else {"new_token": dependencies.new_token}
        self.lease = Lease(robot.supervision.lease_s, **token)
        self.hardware = self._make_hardware(file)
        buses = self.hardware.buses
        self.supervisor = Supervisor(robot.supervision, buses, self._state_changed)
        self.gate = self._make_gate()
        self._spent = TimeSpent(self.clock)
        self.timekeeping = Timekeeping(round(buses[0].bus.cycle_period_s * 1e9), self._spent)
        self.loop = ControlLoop(
            robot,
            buses,
            self.gate,
            self.supervisor,
            self.timekeeping,
            self.clock,
            self.publish,
            dependencies.risk,
        )
        self.following = Following(self.loop, AxisRanges.of(robot), robot.workspace)
        self.obstacles = MovingObstacles(horizon_s(robot.axes), self._obstacles_changed)
        self._obstacles_refused = Refusals()
        self.report = StatusReport(
            robot,
            self.hardware.tracker,
            buses,
            self.loop,
            dependencies.risk,
            lambda: self.obstacles.swept.capsules.tolist(),
            self.supervisor,
            self.timekeeping,
            dependencies.real_time,
            dependencies.simulated,
            self.version,
        )
        self.monitors = Monitors(
            self.hardware.tracker,
            self.loop,
            self.supervisor,
            self.timekeeping,
            self.lease,
            self.following,
            self.obstacles,
            dependencies,
            robot.risk,
        )
        self.body = BodyTeller(
            dependencies.risk, self.loop.channels, self.publish, self._body_snapped
        )
        """Tells where the whole body is."""
        self.at_rest: list[Callable[[], None]] = [self.relax]
        """Called whenever the drives have come to rest and are off."""
        self._was_at_rest = True
        self._slowed = False
        self._status_due_ns = self._loop_due_ns = self._ahead_due_ns = 0
        self._synced_ns = 0
        self._healthy = True

    async def run(self) -> None:
        """Keep the devices connected and the loop going, until cancelled."""
        self._spent.watch_collector()
        try:
            await self.hardware.run()
        finally:
            self._spent.close()
            self.relax()

    async def rest(self, request: Request = Request.STOP) -> bool:
        """Bring the drives to rest, from whatever state. Bounded in time; safe to call twice.

        Returns whether all drives have said that they are off.
        """
        power = self.supervisor.power
        self.supervisor.request(request, self.clock.now_ns())
        try:
            async with asyncio.timeout(AT_REST_WITHIN_S):
                while not power.at_rest:
                    await asyncio.sleep(_LOOK_EVERY_S)
        except TimeoutError:
            return False  # at the end of `run` the buses are closed, and the drives' watchdogs act
        return power.confirmed

    async def check_settings(self) -> list[str]:
        """Read back what the drives' own safety depends on; what is wrong with it. Bounded."""
        buses = self.hardware.buses
        found = await asyncio.gather(*(bus.check_settings(_CHECKS_WITHIN_S) for bus in buses))
        return [wrong for of_bus in found for wrong in of_bus]

    def hurry(self) -> None:
        """Ask the operating system for what moving drives need."""
        real_time = self.dependencies.real_time
        if real_time is None:
            return
        real_time.enter()
        self.timekeeping.forgive()
        now_ns = self.clock.now_ns()
        self.supervisor.checks.real_time(now_ns, real_time.refused)

    def relax(self) -> None:
        """Give it back."""
        if self.dependencies.real_time is not None:
            self.dependencies.real_time.leave()

    def status(self) -> Status:
        """The robot at a glance."""
        now_ns = self.clock.now_ns()
        lease = LeaseStatus(
            holder=self.lease.holder(now_ns), expires_in_s=self.lease.expires_in_s(now_ns)
        )
        folder = self.dependencies.recorder.status.folder
        return self.report.status(
            now_ns,
            lease,
            None if folder is None else str(folder),
            self.following.status(),
            self.verbs(),
        )

    def take_obstacles(self, user: str, message: Obstacles | str) -> None:
        """Count with obstacles that move; words: they cannot be read. Why they are dropped is told
        once."""
        now_ns = self.clock.now_ns()
        if isinstance(message, str):
            why = message
        elif isinstance(self.dependencies.risk, BodyRiskSource):
            why = self.obstacles.take(user, message, now_ns)
        else:
            why = _NOBODY_COUNTS
        if why and self._obstacles_refused.is_news(user, why, now_ns):
            self.events.tell("note", "obstacles_refused", why, subject=user)
        if not why and isinstance(message, Obstacles):
            taken = ObstaclesTaken(
                t_ns=now_ns,
                user=user,
                valid_for_s=message.valid_for_s,
                age_s=message.age_s,
                balls=message.balls,
            )
            self.publish(taken)

    def _obstacles_changed(self, swept: Swept, until_ns: int | None) -> None:
        if isinstance(self.dependencies.risk, BodyRiskSource):
            self.dependencies.risk.take_moving(swept, until_ns)

    # What the devices and the timer tell.

    def _on_frame(self, frame: TrackerFrame) -> None:
        try:
            self.loop.step(frame)
        except Exception as error:  # whatever it is, the drives must be stopped and it be told
            self._broken("control step", error)

    def _on_condition(self, change: ConditionChange) -> None:
        self.supervisor.checks.condition_changed(change)
        self.events.condition(change)

    def _on_cycle(self, bus: DriveBus, tick: Tick) -> None:
        now_ns = self.clock.now_ns()
        paces = bus is self.hardware.buses[0]
        if paces:
            self.timekeeping.cycle_begins(tick, now_ns)
            self._healthy = self._supervise(now_ns)
        # Where supervision has failed, the heartbeat is kept back and the drives stop themselves.
        bus.tick(now_ns, self._healthy)
        if paces and self._healthy:
            self.dependencies.good_cycle(now_ns)
        if paces:
            self._after_cycle(now_ns)
            self._use_spare_time()

    def _use_spare_time(self) -> None:
        try:
            self.loop.use_spare_time()
            now_ns = self.clock.now_ns()
            self.body.use_spare_time(now_ns)
            self._look_ahead(now_ns)
        except Exception as error:
            self._broken("learning or looking round", error)

    def _look_ahead(self, now_ns: int) -> None:
        """Along the planned path that is followed, a piece with each frame."""
        source = self.dependencies.risk
        if now_ns >= self._ahead_due_ns and isinstance(source, BodyRiskSource):
            self._ahead_due_ns = now_ns + _AHEAD_EVERY_NS
            self.loop.path_risk = self.following.look_ahead(source.body_risk)

    def _supervise(self, now_ns: int) -> bool:
        """Whether the supervision itself is sound."""
        try:
            self.monitors.look(now_ns)
            timekeeping = self.timekeeping
            gap_s = timekeeping.last_gap_ns * 1e-9
            self.supervisor.cycle(now_ns, gap_s, timekeeping.last_overrun)
            self.events.reasons(self.supervisor.reasons)
        except Exception as error:
            self._broken("supervision", error)
            return False
        return True

    def _after_cycle(self, now_ns: int) -> None:
        channels = self.loop.channels
        if self._synced_ns and all(channel.received_ns is not None for channel in channels):
            # Drives sample their positions at SYNC, and answer within the cycle that it begins.
            u = [channel.scale.position(channel.position_counts) for channel in channels]
            self.loop.history.add(self._synced_ns, u)
        self._synced_ns = now_ns
        self._check_for_rest()
        if now_ns >= self._loop_due_ns:
            self._loop_due_ns = now_ns + _LOOP_EVERY_NS
            self.monitors.look_at_machine()
            self.publish(Loop(t_ns=now_ns, status=self.report.loop_status(now_ns)))
            if self.dependencies.real_time is not None:
                self.dependencies.real_time.collect_young()
        if now_ns >= self._status_due_ns:
            self._status_due_ns = now_ns + _STATUS_EVERY_NS
            self.monitors.look_at_recorder()
            status = self.status()
            self._tell_when_slowed(status)
            self.publish(status)

    def _check_for_rest(self) -> None:
        at_rest = self.supervisor.power.at_rest and not self.supervisor.energised
        if at_rest and not self._was_at_rest:
            for listener in self.at_rest:
                listener()
        self._was_at_rest = at_rest

    def _state_changed(self, before: OperatingState, after: OperatingState, t_ns: int) -> None:
        if after is OperatingState.ARMED and not before.energised:
            self.loop.settle()
        if after is OperatingState.RUNNING:
            self.loop.begin()
        else:
            self.loop.reasons.withdraw_refusals(t_ns)
        worst = self.supervisor.reasons[0] if self.supervisor.reasons else None
        if after is OperatingState.HOLD and worst is not None:
            self.holds += worst.cause is not Cause.OPERATOR_HOLD
        if after in (OperatingState.FAULT, OperatingState.ESTOP):
            self.dependencies.recorder.urgent()
        goes_on = after in (OperatingState.ARMED, OperatingState.RUNNING)
        if goes_on and worst is not None and worst.over:
            worst = None  # what was over before did not bring it here
        self.events.state(before, after, worst)
        self.publish(self.status())

    def _tell_when_slowed(self, status: Status) -> None:
        """That a path begins to be followed more slowly than it says, and that it is over."""
        followed = status.reference
        slower_than = 1.0 if self._slowed else _SLOWED_BELOW
        slowed = followed is not None and followed.pace < slower_than
        if slowed == self._slowed:
            return
        self._slowed = slowed
        text = "the path is not slowed any more"
        if slowed and followed is not None:
            text = f"the {followed.trajectory} is followed more slowly than it says"
        detail = f"{status.expected_mm:.1f} mm off are expected" if status.expected_mm else ""
        self.events.tell("note", "slowed", text, subject="path", present=slowed, detail=detail)

    def _body_snapped(self, times: int) -> None:
        text = f"the emulated body has snapped to another shape, for the {times}. time"
        self.events.tell("note", "snapped", text, subject="body")

    def _broken(self, part: str, error: Exception) -> None:
        """Something that cannot happen has happened: stop, and say what."""
        _log.error(part, exc_info=error)
        detail = f"{part}: {type(error).__name__}: {error}"
        self.supervisor.checks.internal_error(self.clock.now_ns(), detail)

    # Putting it together.

    def _make_hardware(self, file: RobotFile) -> Hardware:
        dependencies, recorder = self.dependencies, self.dependencies.recorder
        listeners = Listeners(
            self._on_frame,
            self._on_condition,
            recorder.tracker_traffic,
            {name: recorder.can_tap(name) for name in self.robot.buses},
            self._on_cycle,
        )
        return Hardware(file, self.robot, dependencies.connections, self.clock, listeners)

    def _make_gate(self) -> Gate:
        axes, risk = self.robot.axes, self.robot.risk
        return Gate(
            [count_limits(axis) for axis in axes],
            [axis_scale(axis).counts_per_unit for axis in axes],
            [axis.tension_range_n for axis in axes],
            self.dependencies.risk,
            risk.threshold,
            risk.latest_after_s,
            count_coupling(self.robot),
        )
