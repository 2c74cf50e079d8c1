"""Cyclic synchronous position (8) and velocity (9): the master makes the profile."""

from math import copysign, inf

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis.mode import FOLLOWS_COMMAND, AxisParts, Mode
from sim_backends.devices.drive.axis.trajectory import Piece

_LEAST_PERIOD_S = 1e-4


class InterpolationPeriod:
    """0x60C2: how long the drive takes from one target to the next."""

    def __init__(self, parts: AxisParts) -> None:
        self._timers = parts.timers
        self.value = parts.own(0x60C2, 1, DataType.UNSIGNED8, 1)
        self.exponent = parts.own(0x60C2, 2, DataType.INTEGER8, -3)
        self.value.on_write = self.exponent.on_write = lambda _: self.configure()
        self.ns = 1_000_000

    def configure(self) -> None:
        """Take over the period as it is now."""
        seconds = max(_LEAST_PERIOD_S, self.value.number * 10.0**self.exponent.number)
        self.ns = self._timers.host_ns(seconds)


class CyclicPosition(Mode):
    """Goes straight to each target within one period, and waits there if no other comes."""

    code = 8

    def __init__(self, parts: AxisParts, period: InterpolationPeriod) -> None:
        super().__init__(parts)
        self._units = parts.units
        self._limits = parts.limits
        self._target = parts.own(0x607A, 0, DataType.INTEGER32)
        self._period = period
        self.holding = False
        """Ignores its targets."""

    def start(self) -> None:
        self.limited = self.holding = False

    def commanded(self) -> None:
        if self.holding:
            return
        units, limits, shaft = self._units, self._limits, self.shaft
        target = units.zero + self._target.value / units.per_increment  # type: ignore[operator]
        demand = shaft.demand
        if units.modulo is not None:
            target = units.nearest(target, demand)
        limited = False
        if not limits.low <= target <= limits.high:
            low, high = limits.range_around(demand)
            limited = not low <= target <= high
            target = min(max(target, low), high)
        reach = limits.max_velocity * self._period.ns * 1e-9
        if not -reach <= target - demand <= reach:
            limited = True
            target = demand + reach if target > demand else demand - reach
        self.limited = limited
        shaft.interpolate(target, self._period.ns)

    def status(self) -> int:
        return 0 if self.holding else FOLLOWS_COMMAND


class CyclicVelocity(Mode):
    """Goes to each velocity within one period and keeps it, up to a position limit."""

    code = 9

    def __init__(self, parts: AxisParts, period: InterpolationPeriod) -> None:
        super().__init__(parts)
        self._target = parts.own(0x60FF, 0, DataType.INTEGER32)
        self._period = period

    def start(self) -> None:
        self.limited = False

    def commanded(self) -> None:
        shaft, limits = self.shaft, self.parts.limits
        wanted = self.parts.units.increments_s(self._target.number)
        velocity = max(-limits.max_velocity, min(limits.max_velocity, wanted))
        ramp_s, before = self._period.ns * 1e-9, shaft.demand_velocity
        ramp = Piece(ramp_s, before, (velocity - before) / ramp_s)
        low, high = limits.range_around(shaft.demand)
        after_ramp = shaft.demand + ramp.distance
        end = high if velocity > 0.0 else low
        if not low < after_ramp < high:
            self.limited = True
            end = high if after_ramp >= high else low
            shaft.follow(_straight(end - shaft.demand, max(abs(velocity), abs(before))), end)
            return
        self.limited = velocity != wanted
        if velocity == 0.0:
            shaft.follow([ramp], None)
        elif end in (inf, -inf):
            shaft.follow([ramp, Piece(inf, velocity, 0.0)], None)
        else:
            shaft.follow([ramp, *_straight(end - after_ramp, abs(velocity))], end)

    def status(self) -> int:
        return FOLLOWS_COMMAND


def _straight(distance: float, speed: float) -> list[Piece]:
    """There with a constant velocity."""
    if distance == 0.0 or speed == 0.0:
        return []
    return [Piece(abs(distance) / speed, copysign(speed, distance), 0.0)]
