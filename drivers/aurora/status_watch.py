"""From status bits to conditions: what the device itself says is wrong with it or with a tool."""

from collections.abc import Callable, Mapping

from drivers.aurora.codec.status_bits import PortStatus, SystemStatus
from drivers.aurora.conditions import (
    FIELD_GENERATOR_UNPLUGGED,
    IMPLAUSIBLE_POSE,
    OUT_OF_VOLUME,
    PARTIALLY_OUT_OF_VOLUME,
    SENSOR_FAULT,
    TOOL_DISABLED,
    TOOL_MISSING,
)
from drivers.aurora.frame import Absence, ToolSample
from drivers.aurora.health import Health
from drivers.conditions import Condition

_SENSOR_FAULTS: Mapping[PortStatus, str] = {
    PortStatus.SENSOR_BROKEN: "its lead is broken",
    PortStatus.SENSOR_SHORTED: "its lead is shorted",
    PortStatus.SIGNAL_TOO_LARGE: "it is too close to the field generator",
    PortStatus.PROCESSING_EXCEPTION: "its signal cannot be processed",
}


def _sensor_faults(sample: ToolSample) -> str:
    return ", ".join(text for bit, text in _SENSOR_FAULTS.items() if bit & sample.port_status)


_TOOL_CONDITIONS: Mapping[Condition, Callable[[ToolSample], object]] = {
    OUT_OF_VOLUME: lambda s: s.port_status & PortStatus.OUT_OF_VOLUME,
    PARTIALLY_OUT_OF_VOLUME: lambda s: s.port_status & PortStatus.PARTIALLY_OUT_OF_VOLUME,
    SENSOR_FAULT: _sensor_faults,
    TOOL_MISSING: lambda s: s.absence is Absence.MISSING and s.in_volume,
    TOOL_DISABLED: lambda s: s.absence is Absence.DISABLED,
    IMPLAUSIBLE_POSE: lambda s: s.absence is Absence.IMPLAUSIBLE,
}
"""When each of them holds for a sensor."""


class StatusWatch:
    """Keeps the conditions in step with the bits. Costs next to nothing while they stay."""

    def __init__(self, health: Health) -> None:
        self._health = health
        self._system_status = 0
        self._seen: dict[str, tuple[Absence | None, int]] = {}

    def system(self, status: int) -> None:
        """The system status of a reply."""
        if status == self._system_status:
            return
        self._system_status = status
        if status & SystemStatus.FIELD_GENERATOR_UNPLUGGED:
            self._health.set(FIELD_GENERATOR_UNPLUGGED)
        else:
            self._health.clear(FIELD_GENERATOR_UNPLUGGED)

    def tools(self, samples: Mapping[str, ToolSample]) -> None:
        """The sensors of a reply, by role."""
        for role, sample in samples.items():
            seen = (sample.absence, sample.port_status)
            if self._seen.get(role) != seen:
                self._seen[role] = seen
                self._update(role, sample)

    def forget_tools(self) -> None:
        """The tools are set up anew: what held for one of them may not hold for the next."""
        for role in self._seen:
            self._health.clear(*_TOOL_CONDITIONS, part=role)
        self._seen.clear()

    def _update(self, role: str, sample: ToolSample) -> None:
        for condition, holds in _TOOL_CONDITIONS.items():
            held = holds(sample)
            if held:
                self._health.set(condition, role, held if isinstance(held, str) else "")
            else:
                self._health.clear(condition, part=role)
