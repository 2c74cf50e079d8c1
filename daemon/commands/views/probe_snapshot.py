"""The state of all devices at one moment, as plain values for JSON and for the live table."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from daemon.loop.frame_statistics import FrameStatistics
from daemon.robot.capture import CanCapture
from daemon.robot.checked_robot import CheckedRobot
from daemon.robot.connections import RealConnections
from daemon.robot.hardware import Hardware, Listeners
from daemon.robot.runtime_directory import with_lab_ports
from daemon.service.telemetry.flapping import Changes, Key, Words
from drivers.aurora.frame import ToolSample, TrackerFrame
from drivers.aurora.tools import Tool
from drivers.aurora.tracker import TrackerState
from drivers.bounded import end_tasks
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.drive_bus import DriveBus
from drivers.clock import Clock, WallClock
from drivers.conditions import ActiveCondition, ConditionChange

# Watches the devices: keeps the last frame, counts rates.


class Observer:
    """Hears of every frame."""

    def __init__(self, clock: Clock) -> None:
        self.frame: TrackerFrame | None = None
        self.frames = 0
        self._clock = clock
        self._bits: dict[str, tuple[int, int]] = {}
        self._statistics = FrameStatistics()

    def on_frame(self, frame: TrackerFrame) -> None:
        self.frame = frame
        self.frames += 1
        self._statistics.add(frame.t_ns, frame.received_ns)

    def frame_rate_hz(self) -> float:
        """Frames per second over the last two seconds."""
        return self._statistics.rate_hz(self._clock.now_ns())

    def age_s(self) -> float | None:
        """Age of the newest frame."""
        return None if self.frame is None else (self._clock.now_ns() - self.frame.t_ns) * 1e-9

    def latency_s(self) -> float | None:
        """From measurement to the driver, the median of the last frames."""
        return self._statistics.latency_s()

    def bus_load(self, bus: str, bitrate_bit_s: int, bits: int) -> float:
        """Share of `bus` that was used since this was last asked, from its bits so far."""
        now_ns = self._clock.now_ns()
        then_ns, before = self._bits.get(bus, (now_ns, bits))
        self._bits[bus] = (now_ns, bits)
        if now_ns == then_ns:
            return 0.0
        return (bits - before) / ((now_ns - then_ns) * 1e-9 * bitrate_bit_s)


Json = Mapping[str, Any]


def snapshot(robot: str, hardware: Hardware, observer: Observer, t_s: float) -> Json:
    """Everything, `t_s` seconds after the start."""
    return {
        "robot": robot,
        "t_s": round(t_s, 3),
        "tracker": _tracker(hardware, observer),
        "axes": [_axis(bus, channel) for bus in hardware.buses for channel in bus.channels],
        "buses": {bus.name: _bus(bus, observer) for bus in hardware.buses},
        "conditions": [_condition(active) for active in conditions_of(hardware)],
    }


def conditions_of(hardware: Hardware) -> list[ActiveCondition]:
    """All that is wrong now, longest first."""
    active = [*hardware.tracker.status.conditions]
    for bus in hardware.buses:
        active += bus.conditions.active()
    return sorted(active, key=lambda one: one.since_ns)


def event(change: ConditionChange, t_s: float) -> Json:
    """One condition that came or went."""
    return {"t_s": round(t_s, 3), "present": change.present, **_condition(change.active)}


def _condition(active: ActiveCondition) -> Json:
    return {
        "name": active.condition.name,
        "subject": active.subject,
        "text": active.condition.text,
        "detail": active.detail,
        "remedy": active.condition.remedy,
    }


def _tracker(hardware: Hardware, observer: Observer) -> Json:
    status = hardware.tracker.status
    device, frame = status.device, observer.frame
    age_s, latency_s = observer.age_s(), observer.latency_s()
    return {
        "state": status.state.value,
        "baud_rate": status.baud_rate,
        "firmware": None if device is None else device.firmware,
        "control_unit": None if device is None else device.control_unit.value("NDI S/N"),
        "rate_hz": round(observer.frame_rate_hz(), 2),
        "age_s": None if age_s is None else round(age_s, 4),
        "latency_s": None if latency_s is None else round(latency_s, 4),
        "tip_mm": None if frame is None or frame.tip is None else _rounded(frame.tip.position_mm),
        "tools": [
            _tool(tool, status.tools.roles.get(tool.handle), frame) for tool in status.tools.plugged
        ],
        "counters": vars(status.counters),
    }


def _tool(tool: Tool, role: str | None, frame: TrackerFrame | None) -> Json:
    sample = frame.tools.get(role) if frame is not None and role is not None else None
    port, channel = tool.port
    return {
        "role": role,
        "serial": tool.serial,
        "port": port,
        "channel": channel,
        "status": _status(sample),
        "position_mm": None
        if sample is None or sample.pose is None
        else _rounded(sample.pose.position_mm),
        "quaternion": None
        if sample is None or sample.pose is None
        else _rounded(sample.pose.quaternion, 5),
        "indicator": None if sample is None else round(sample.indicator, 3),
    }


def _status(sample: ToolSample | None) -> str:
    if sample is None:
        return "not tracked"
    if sample.absence is not None:
        return sample.absence.value
    return "valid" if sample.in_volume else "out of volume"


def _axis(bus: DriveBus, channel: AxisChannel) -> Json:
    drive, scale = channel.axis.drive, channel.scale
    node = bus.nodes[drive.node]
    known = channel.received_ns is not None
    position = scale.position(channel.position_counts)
    volume_ml = scale.volume_ml(channel.position_counts)
    return {
        "name": channel.axis.name,
        "kind": channel.axis.kind,
        "node": f"{drive.bus}/{drive.node}",
        "axis": drive.axis,
        "device": None if node.identity is None else node.identity.name,
        "node_state": node.state.value,
        "drive_state": channel.state.value,
        "statusword": f"0x{channel.statusword:04X}",
        "unit": scale.unit,
        "position": round(position, 4) if known else None,
        "volume_ml": round(volume_ml, 4) if known and volume_ml is not None else None,
        "torque_percent": channel.torque_permille / 10 if known else None,
        "last_emergency": str(node.emergencies.last) if node.emergencies.last else None,
    }


def _bus(bus: DriveBus, observer: Observer) -> Json:
    traffic = bus.traffic
    return {
        "interface": bus.bus.interface,
        "channel": bus.bus.channel,
        "connected": bus.connected,
        "cycle_hz": round(1 / bus.bus.cycle_period_s, 3),
        "load": round(observer.bus_load(bus.name, bus.bus.bitrate_bit_s, traffic.bits), 4),
        "sent": traffic.sent,
        "received": traffic.received,
        "refused": traffic.refused,
        "foreign": traffic.foreign,
    }


def _rounded(values: Any, digits: int = 3) -> list[float]:
    return [round(float(value), digits) for value in values]


# One probing: the hardware with an observer, from connecting to letting go.


_CATCH_UP_EVERY_S: Final = 0.25
_ENDS_WITHIN_S: Final = 8.0
"""Longer than hardware takes at the most."""


class ProbeSession:
    """The devices of a robot while they are probed."""

    def __init__(
        self,
        checked: CheckedRobot,
        lab: Path,
        clock: WallClock,
        on_event: Callable[[Json], None],
        capture: CanCapture | None,
    ) -> None:
        """on_event: hears at once of every condition that comes or goes, and once a second of one
        that flaps. Raises EdsError."""
        robot = with_lab_ports(checked.file.robot, lab)
        self._robot = robot.robot
        self._clock = clock
        self._started_ns = clock.now_ns()
        self._on_event = on_event
        self._changes = Changes(clock, self._tell)
        self._observer = Observer(clock)
        taps = {} if capture is None else {next(iter(robot.buses)): capture}
        listeners = Listeners(self._observer.on_frame, self._changed, can_taps=dict(taps))
        self._hardware = Hardware(checked.file, robot, RealConnections(clock), clock, listeners)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Connected while the context lasts."""
        tasks = [asyncio.create_task(one) for one in (self._hardware.run(), self._catch_up())]
        try:
            yield
        finally:
            await end_tasks(tasks, _ENDS_WITHIN_S)

    def snapshot(self) -> Json:
        """Everything as it is now."""
        return snapshot(self._robot, self._hardware, self._observer, self._since(None))

    @property
    def healthy(self) -> bool:
        """Whether everything is there and well."""
        tracking = self._hardware.tracker.status.state is TrackerState.TRACKING
        operational = all(bus.operational for bus in self._hardware.buses)
        return tracking and operational and not conditions_of(self._hardware)

    def _changed(self, change: ConditionChange) -> None:
        active = change.active
        told = event(change, self._since(change.t_ns))
        self._changes.add((active.condition.name, active.subject), change.present, told)

    def _tell(self, _key: Key, present: bool, words: Words) -> None:
        self._on_event({**words, "present": present})

    async def _catch_up(self) -> None:
        while True:
            await asyncio.sleep(_CATCH_UP_EVERY_S)
            self._changes.catch_up()

    def _since(self, t_ns: int | None) -> float:
        return ((self._clock.now_ns() if t_ns is None else t_ns) - self._started_ns) * 1e-9
