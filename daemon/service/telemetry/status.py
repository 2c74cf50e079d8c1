"""The robot at a glance, put together from what the loop already knows."""

from collections.abc import Callable, Sequence
from typing import Final

from config.robot import Robot
from daemon.host.real_time import RealTime
from daemon.loop.control_step import ControlLoop
from daemon.loop.timekeeping import Timekeeping
from daemon.messages import (
    AxisStatus,
    BusStatus,
    LeaseStatus,
    LoopStatus,
    ReferenceStatus,
    RiskStatus,
    Status,
    TrackerStatus,
    Verb,
)
from daemon.risk.body_risk_source import identity_of
from daemon.supervision.explained import explained
from daemon.supervision.supervisor import Supervisor
from drivers.aurora.tracker import AuroraTracker
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.drive_bus import DriveBus
from drivers.cia402.node import Node
from safety.risk_source import RiskSource, name_of

_FORCE_UNIT: Final = {"mm": "N", "rad": "N mm"}


class StatusReport:
    """Makes `Status` messages."""

    def __init__(
        self,
        robot: Robot,
        tracker: AuroraTracker,
        buses: Sequence[DriveBus],
        loop: ControlLoop,
        risk: RiskSource,
        moving_mm: Callable[[], list[list[float]]],
        supervisor: Supervisor,
        timekeeping: Timekeeping,
        real_time: RealTime | None,
        simulated: bool,
        version: str,
    ) -> None:
        self._robot = robot
        self._tracker = tracker
        self._buses = buses
        self._loop = loop
        self._risk = risk
        self._moving_mm = moving_mm
        self._supervisor = supervisor
        self._timekeeping = timekeeping
        self._real_time = real_time
        self._simulated = simulated
        self._version = version
        node_of = {
            channel.index: node
            for bus in buses
            for node in bus.nodes.values()
            for channel in node.channels
        }
        self._axes = [_Axis(channel, node_of[channel.index]) for channel in loop.channels]
        self._sequence = 0
        self._loop_status: LoopStatus | None = None
        self._loads = [_Load(bus) for bus in buses]

    def status(
        self,
        t_ns: int,
        lease: LeaseStatus,
        recording: str | None,
        reference: ReferenceStatus | None,
        verbs: list[Verb],
    ) -> Status:
        """Everything, as of now."""
        self._sequence += 1
        tip, aim = self._loop.tip, self._loop.aim
        return Status(
            robot=self._robot.robot,
            state=self._supervisor.state.value,
            reasons=[explained(reason, t_ns) for reason in self._supervisor.reasons],
            t_ns=t_ns,
            sequence=self._sequence,
            tip_mm=None if tip is None else tip.position_mm.tolist(),
            reference_mm=None if aim is None else aim.position_mm.tolist(),
            error_mm=self._loop.error_mm,
            expected_mm=self._loop.expected_mm,
            error_rad=self._loop.error_rad,
            tracker=self._tracker_status(t_ns),
            axes=self._axes_status(t_ns),
            risk=self._risk_status(),
            loop=self._loop_status or self.loop_status(t_ns),
            lease=lease,
            recording=recording,
            simulated=self._simulated,
            reference=reference,
            version=self._version,
            stopped_by=[explained(reason, t_ns) for reason in self._supervisor.stopped_by],
            verbs=verbs,
        )

    def loop_status(self, t_ns: int) -> LoopStatus:
        """How the loop keeps its time. Costs more than the rest: once a second is enough."""
        timekeeping = self._timekeeping
        median, high, highest = timekeeping.lateness_s()
        step_median, step_high, _ = timekeeping.step_s()
        self._loop_status = LoopStatus(
            rate_hz=timekeeping.step_rate_hz(t_ns),
            cycle_rate_hz=timekeeping.cycle_rate_hz(t_ns),
            lateness_p50_s=median,
            lateness_p99_s=high,
            lateness_max_s=highest,
            missed=timekeeping.missed,
            step_p50_s=step_median,
            step_p99_s=step_high,
            last_overrun=timekeeping.last_overrun,
            real_time="" if self._real_time is None else str(self._real_time),
            buses=[load.status(t_ns) for load in self._loads],
        )
        return self._loop_status

    def _tracker_status(self, t_ns: int) -> TrackerStatus:
        loop = self._loop
        return TrackerStatus(
            state=self._tracker.state.value,
            rate_hz=loop.frames.rate_hz(t_ns),
            age_s=loop.filter.age_s(t_ns),
            quality=loop.filter.quality,
            latency_s=loop.frames.latency_s(),
        )

    def _axes_status(self, t_ns: int) -> list[AxisStatus]:
        commanded = self._loop.commanded_counts(t_ns)
        if commanded is None:
            return [axis.status(None) for axis in self._axes]
        return [axis.status(target) for axis, target in zip(self._axes, commanded, strict=True)]

    def _risk_status(self) -> RiskStatus:
        decision, identity = self._loop.decision, identity_of(self._risk)
        moving_mm = self._moving_mm()
        return RiskStatus(
            source=name_of(self._risk),
            contact_risk=None if decision is None else decision.risk,
            body_point_risk=None if decision is None else decision.body_point_risk,
            threshold=self._robot.risk.threshold,
            scale=1.0 if decision is None else decision.scale,
            detail="" if decision is None else decision.risk_detail,
            minute_risk=self._loop.minute_risk,
            path_risk=self._loop.path_risk,
            surroundings_sha256="" if identity is None else identity.surroundings_sha256,
            moving_obstacles=len(moving_mm),
            moving_mm=moving_mm,
        )


class _Load:
    """How much of one bus is used, from one question for it to the next."""

    def __init__(self, bus: DriveBus) -> None:
        self._bus = bus
        self._t_ns: int | None = None
        self._bits = 0

    def status(self, t_ns: int) -> BusStatus:
        bits, before_ns = self._bus.traffic.bits, self._t_ns
        load = 0.0
        if before_ns is not None and t_ns > before_ns:
            seconds = (t_ns - before_ns) * 1e-9
            load = (bits - self._bits) / (seconds * self._bus.bus.bitrate_bit_s)
        self._t_ns, self._bits = t_ns, bits
        return BusStatus(name=self._bus.name, load=load)


class _Axis:
    """One axis, with what is the same in all its statuses."""

    __slots__ = ("_channel", "_force_range", "_force_unit", "_name", "_node", "_scale")

    def __init__(self, channel: AxisChannel, node: Node) -> None:
        self._channel = channel
        self._node = node
        self._scale = channel.scale
        self._name = channel.axis.name
        self._force_unit = _FORCE_UNIT[channel.scale.unit]
        limits = channel.axis.tension_range_n
        self._force_range = None if limits is None else list(limits)

    def status(self, target_counts: int | None) -> AxisStatus:
        """target_counts: None while it is told nothing."""
        channel, scale = self._channel, self._scale
        actual = target = force = volume_ml = None
        if channel.received_ns is not None:
            actual = scale.position(channel.position_counts)
            force = scale.force(channel.torque_permille)
            volume_ml = scale.volume_ml(channel.position_counts)
            if target_counts is not None:
                target = scale.position(target_counts)
        return AxisStatus(
            name=self._name,
            unit=scale.unit,
            actual=actual,
            target=target,
            drive_state=channel.state.value,
            node_state=self._node.state.value,
            force=force,
            force_unit=self._force_unit,
            volume_ml=volume_ml,
            force_range=self._force_range,
        )
