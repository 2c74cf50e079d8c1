"""How far, how fast and how hard an axis may move: CiA 402's limits, in increments and seconds."""

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis.mechanics import AxisMechanics, Units
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary

_OVERTRAVEL = 20.0  # increments that the motor goes on after a limit switch has closed


class Limits:
    """The limits of one axis."""

    def __init__(
        self, objects: ObjectDictionary, base: int, units: Units, mechanics: AxisMechanics
    ) -> None:
        def own(index: int, subindex: int, data_type: DataType, default: int) -> Entry:
            entry = objects.own(base + index, subindex, data_type, default)
            entry.on_write = lambda _: self.configure()
            return entry

        self._units = units
        self._mechanics = mechanics
        self._low = own(0x607D, 1, DataType.INTEGER32, -(2**31))
        self._high = own(0x607D, 2, DataType.INTEGER32, 2**31 - 1)
        self._home_offset = own(0x607C, 0, DataType.INTEGER32, 0)
        self._profile_velocity = own(0x607F, 0, DataType.UNSIGNED32, 2**31 - 1)
        self._motor_speed_rpm = own(0x6080, 0, DataType.UNSIGNED32, 3000)
        self._acceleration = own(0x60C5, 0, DataType.UNSIGNED32, 2**31 - 1)
        self._deceleration = own(0x60C6, 0, DataType.UNSIGNED32, 2**31 - 1)
        self.configure()

    def configure(self) -> None:
        """Take over the limits as they are now, after any change of them, of zero or of units."""
        units, mechanics = self._units, self._mechanics
        # Software limits count from the home position, without the home offset.
        offset = self._home_offset.number
        ends = (
            units.increments(self._low.number - offset),
            units.increments(self._high.number - offset),
        )
        low, high = min(ends), max(ends)
        if self._low.number >= self._high.number:
            low, high = float("-inf"), float("inf")
        self.low = max(low, mechanics.low_switch - _OVERTRAVEL)
        self.high = min(high, mechanics.high_switch + _OVERTRAVEL)
        motor_speed = self._motor_speed_rpm.number / 60 * mechanics.counts_per_turn
        profile_velocity = abs(units.increments_s(self._profile_velocity.number))
        self.max_velocity = min(motor_speed, profile_velocity)
        self.max_acceleration = max(1.0, units.length(self._acceleration.number))
        self.max_deceleration = max(1.0, units.length(self._deceleration.number))

    def range_around(self, demand: float) -> tuple[float, float]:
        """Where the demand may go. Beyond a limit it may stay, but not go further."""
        return min(self.low, demand), max(self.high, demand)

    def acceleration(self, entry: Entry) -> float:
        """What an acceleration object asks for, within the limit."""
        return min(self.max_acceleration, max(1.0, self._units.length(entry.number)))

    def deceleration(self, entry: Entry) -> float:
        """What a deceleration object asks for, within the limit."""
        return min(self.max_deceleration, max(1.0, self._units.length(entry.number)))
