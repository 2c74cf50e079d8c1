"""Profile velocity (mode 3): a velocity, reached and left on ramps (CiA 402-2, 12)."""

from math import inf

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis import trajectory
from sim_backends.devices.drive.axis.mode import (
    STANDS_STILL,
    TARGET_REACHED,
    AxisParts,
    Lasting,
    Mode,
)


class ProfileVelocity(Mode):
    """Goes on until told otherwise, or until a position limit: there it comes to a stop in time."""

    code = 3

    def __init__(self, parts: AxisParts) -> None:
        super().__init__(parts)
        self._target = parts.own(0x60FF, 0, DataType.INTEGER32)
        self._acceleration = parts.own(0x6083, 0, DataType.UNSIGNED32, 100_000)
        self._deceleration = parts.own(0x6084, 0, DataType.UNSIGNED32, 100_000)
        self._window = parts.own(0x606D, 0, DataType.UNSIGNED16, 200)
        self._window_ms = parts.own(0x606E, 0, DataType.UNSIGNED16, 10)
        self._threshold = parts.own(0x606F, 0, DataType.UNSIGNED16, 50)
        self._threshold_ms = parts.own(0x6070, 0, DataType.UNSIGNED16, 10)
        self._commanded: int | None = None
        self._near = Lasting()
        self._slow = Lasting()
        self._reached = False
        self._still = True

    @property
    def busy(self) -> bool:
        return self.shaft.moving or not self._still or not self._reached

    def start(self) -> None:
        self._commanded = None
        self.limited = False
        self.commanded()

    def commanded(self) -> None:
        if self._target.number != self._commanded:
            self._commanded = self._target.number
            self._go(self.parts.units.increments_s(self._commanded))

    def resume(self) -> None:
        self._commanded = None
        self.commanded()

    def tick(self) -> None:
        units, timers = self.parts.units, self.parts.timers
        velocity, now_ns = units.velocity(self.shaft.velocity), self.shaft.t_ns
        near = abs(velocity - self._target.number) <= self._window.number
        slow = abs(velocity) <= self._threshold.number
        near_ns = timers.host_ns(self._window_ms.number * 1e-3)
        slow_ns = timers.host_ns(self._threshold_ms.number * 1e-3)
        self._reached = self._near.update(near, now_ns, near_ns)
        self._still = self._slow.update(slow, now_ns, slow_ns)

    def status(self) -> int:
        return (TARGET_REACHED if self._reached else 0) | (STANDS_STILL if self._still else 0)

    def _go(self, velocity: float) -> None:
        parts = self.parts
        shaft, limits = parts.shaft, parts.limits
        fastest = limits.max_velocity
        self.limited = abs(velocity) > fastest
        velocity = max(-fastest, min(fastest, velocity))
        acceleration = limits.acceleration(self._acceleration)
        deceleration = limits.deceleration(self._deceleration)
        low, high = limits.range_around(shaft.demand)
        end = high if velocity > 0.0 else low
        self._reached = False
        self._near.forget()
        if velocity == 0.0 or end in (inf, -inf):
            change = trajectory.change_velocity
            pieces = change(shaft.demand_velocity, velocity, acceleration, deceleration)
            shaft.follow(pieces, None)
            return
        distance = end - shaft.demand
        pieces = trajectory.move(
            distance, shaft.demand_velocity, abs(velocity), acceleration, deceleration
        )
        self.limited = self.limited or distance == 0.0
        shaft.follow(pieces, end)
