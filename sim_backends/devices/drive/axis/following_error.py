"""Following error (0x6065, 0x6066): how far the shaft may stay behind its demand, and how long."""

from math import inf
from typing import Final

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis.mode import AxisParts

_WINDOW_OFF: Final = 0xFFFFFFFF


class FollowingErrorWatch:
    """Watches the shaft of one axis."""

    def __init__(self, parts: AxisParts, *, no_encoder: bool) -> None:
        self._parts = parts
        self._shaft = parts.shaft
        self._no_encoder = no_encoder
        self.entry = parts.own(0x6065, 0, DataType.UNSIGNED32, 2000)
        self._time_ms = parts.own(0x6066, 0, DataType.UNSIGNED16, 10)
        self.window = inf
        """How large the error may be, in increments."""
        self.since_ns: int | None = None
        """Since when the error has been too large."""

    def configure(self) -> None:
        """Take over the window as it is now."""
        self.window = inf
        if self.entry.number != _WINDOW_OFF and not self._no_encoder:
            self.window = self._parts.units.length(self.entry.number)

    def forget(self) -> None:
        """As if nothing had been."""
        self.since_ns = None

    def too_long(self, t_ns: int) -> bool:
        """Whether the error has been too large for too long."""
        shaft = self._shaft
        if -self.window <= shaft.demand - shaft.position <= self.window:
            self.since_ns = None
            return False
        if self.since_ns is None:
            self.since_ns = t_ns
        return t_ns - self.since_ns >= self._parts.timers.host_ns(self._time_ms.number * 1e-3)
