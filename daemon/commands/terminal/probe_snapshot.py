"""The state of all devices at one moment, as plain values for JSON and for the live table."""

from collections.abc import Mapping
from typing import Any

from daemon.commands.terminal.probe_observer import Observer
from daemon.robot.hardware import Hardware
from drivers.aurora.frame import ToolSample, TrackerFrame
from drivers.aurora.tools import Tool
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.drive_bus import DriveBus
from drivers.conditions import ActiveCondition, ConditionChange

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
        "last_emergency": str(node.last_emergency) if node.last_emergency else None,
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
