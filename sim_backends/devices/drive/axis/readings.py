"""What is measured of an axis: the objects in which a master reads it, and the following error."""

from collections.abc import Callable
from math import inf
from typing import Final, Protocol

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis.mechanics import to_int32
from sim_backends.devices.drive.axis.mode import AxisParts

_LOW_SWITCH = 1 << 0
_HIGH_SWITCH = 1 << 1
_TORQUE_OFF = 1 << 31
_WINDOW_OFF: Final = 0xFFFFFFFF


class Advancing(Protocol):
    """What goes on as time does."""

    t_ns: int
    """How far it has got."""

    def advance(self, t_ns: int) -> None:
        """Let time pass until `t_ns`."""
        ...


class Readings:
    """Hooks the measured values of an axis into its object dictionary.

    no_encoder: the drive takes its demand for true.
    """

    def __init__(
        self,
        parts: AxisParts,
        axis: Advancing,
        torque_off: Callable[[], bool],
        *,
        no_encoder: bool,
    ) -> None:
        self._parts = parts
        self._shaft = parts.shaft
        self._units = parts.units
        self._axis = axis
        self._advance = axis.advance
        self._torque_off = torque_off
        self._rated = parts.own(0x6076, 0, DataType.UNSIGNED32, 400)
        self._no_encoder = no_encoder
        for index, data_type, read in (
            (0x6062, DataType.INTEGER32, self.position_demand),
            (0x6063, DataType.INTEGER32, self.internal_position),
            (0x6064, DataType.INTEGER32, self.position),
            (0x606B, DataType.INTEGER32, self.velocity_demand),
            (0x606C, DataType.INTEGER32, self.velocity),
            (0x6077, DataType.INTEGER16, self.torque),
            (0x6078, DataType.INTEGER16, self.torque),  # current goes with torque
            (0x60F4, DataType.INTEGER32, self.following_error),
            (0x60FD, DataType.UNSIGNED32, self.digital_inputs),
        ):
            parts.objects.show(parts.base + index, 0, data_type, read)

    def position_demand(self, t_ns: int) -> int:
        self._advance(t_ns)
        return self._units.position(self._shaft.demand)

    def internal_position(self, t_ns: int) -> int:
        self._advance(t_ns)
        return to_int32(self._measured() - self._units.zero)

    def position(self, t_ns: int) -> int:
        if t_ns > self._axis.t_ns:
            self._advance(t_ns)
        shaft = self._shaft
        return self._units.position(shaft.demand if self._no_encoder else shaft.position)

    def velocity_demand(self, t_ns: int) -> int:
        self._advance(t_ns)
        return self._units.velocity(self._shaft.demand_velocity)

    def velocity(self, t_ns: int) -> int:
        self._advance(t_ns)
        shaft = self._shaft
        return self._units.velocity(shaft.demand_velocity if self._no_encoder else shaft.velocity)

    def torque(self, t_ns: int) -> int:
        """Per mille of the rated torque."""
        if t_ns > self._axis.t_ns:
            self._advance(t_ns)
        torque_nmm = self._shaft.torque_nmm
        if not torque_nmm:
            return 0
        permille = round(torque_nmm / (self._rated.number or 1) * 1000)
        if not -0x8000 <= permille <= 0x7FFF:
            permille = 0x7FFF if permille > 0 else -0x8000
        return -permille if self._units.per_increment < 0.0 else permille

    def following_error(self, t_ns: int) -> int:
        self._advance(t_ns)
        return to_int32((self._shaft.demand - self._measured()) * self._units.per_increment)

    def digital_inputs(self, t_ns: int) -> int:
        self._advance(t_ns)
        position, mechanics = self._shaft.position, self._parts.mechanics
        return (
            (_LOW_SWITCH if position <= mechanics.low_switch else 0)
            | (_HIGH_SWITCH if position >= mechanics.high_switch else 0)
            | (_TORQUE_OFF if self._torque_off() else 0)
        )

    def _measured(self) -> float:
        return self._shaft.demand if self._no_encoder else self._shaft.position


class FollowingErrorWatch:
    """How far the shaft may stay behind its demand (0x6065), and how long (0x6066)."""

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
