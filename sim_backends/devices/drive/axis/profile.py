"""Profile position (mode 1): set-points one after the other, with a handshake (CiA 402-2, 10)."""

from math import inf

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis import trajectory
from sim_backends.devices.drive.axis.mode import (
    CHANGE_IMMEDIATELY,
    NEW_SETPOINT,
    RELATIVE,
    SETPOINT_ACKNOWLEDGED,
    STANDS_STILL,
    TARGET_REACHED,
    AxisParts,
    Lasting,
    Mode,
)

_ROUNDING = 0.5  # counts, between a target and where the shaft can be


class ProfilePosition(Mode):
    """A target counts when bit 4 of the controlword rises. One more may wait for its turn."""

    code = 1

    def __init__(self, parts: AxisParts) -> None:
        super().__init__(parts)
        self._target = parts.own(0x607A, 0, DataType.INTEGER32)
        self._velocity = parts.own(0x6081, 0, DataType.UNSIGNED32, 10_000)
        self._acceleration = parts.own(0x6083, 0, DataType.UNSIGNED32, 100_000)
        self._deceleration = parts.own(0x6084, 0, DataType.UNSIGNED32, 100_000)
        self._window = parts.own(0x6067, 0, DataType.UNSIGNED32, 10)
        self._window_ms = parts.own(0x6068, 0, DataType.UNSIGNED16, 10)
        self._goal = 0.0
        self._next_goal: float | None = None
        self._new_setpoint = False
        self._acknowledged = False
        self._within = Lasting()
        self._reached = True

    @property
    def busy(self) -> bool:
        return self.shaft.moving or not self._reached or self._next_goal is not None

    def start(self) -> None:
        self._goal = self.shaft.demand
        self._next_goal = None
        self._acknowledged = self._new_setpoint = self.limited = False
        self._begin(move=False)

    def controlled(self, control: int, previous: int) -> None:
        self._new_setpoint = bool(control & NEW_SETPOINT)
        if self._new_setpoint and not previous & NEW_SETPOINT:
            self._take(control)
        elif not self._new_setpoint and self._next_goal is None:
            self._acknowledged = False

    def resume(self) -> None:
        self._begin(move=True)

    def tick(self) -> None:
        shaft, units = self.shaft, self.parts.units
        if not shaft.moving and self._next_goal is not None:
            self._goal, self._next_goal = self._next_goal, None
            self._acknowledged = self._new_setpoint
            self._begin(move=True)
            return
        error = abs(self._goal - shaft.position)
        within = error <= units.length(self._window.number) + _ROUNDING
        window_ns = self.parts.timers.host_ns(self._window_ms.number * 1e-3)
        if self._within.update(within, shaft.t_ns, window_ns):
            self._reached = True

    def status(self) -> int:
        reached = TARGET_REACHED if self._reached else 0
        return reached | (SETPOINT_ACKNOWLEDGED if self._acknowledged else 0)

    def _take(self, control: int) -> None:
        """A new set-point: go there at once, or after the one under way."""
        under_way = self.shaft.moving and not control & CHANGE_IMMEDIATELY
        if under_way and self._next_goal is not None:
            return  # no room: not acknowledged until there is
        goal = self._goal_from(control)
        self._acknowledged = True
        if under_way:
            self._next_goal = goal
        else:
            self._goal, self._next_goal = goal, None
            self._begin(move=True)

    def _goal_from(self, control: int) -> float:
        units = self.parts.units
        if control & RELATIVE:
            last = self._goal if self._next_goal is None else self._next_goal
            goal = last + self._target.number / units.per_increment
        else:
            goal = units.nearest(units.increments(self._target.number), self.shaft.demand)
        low, high = self.parts.limits.range_around(self.shaft.demand)
        self.limited = not low <= goal <= high
        return min(max(goal, low), high)

    def _begin(self, *, move: bool) -> None:
        shaft, limits = self.shaft, self.parts.limits
        self._within.forget()
        self._reached = not move
        if move:
            velocity = abs(self.parts.units.increments_s(self._velocity.number))
            if velocity == 0.0:
                return
            pieces = trajectory.move(
                self._goal - shaft.demand,
                shaft.demand_velocity,
                min(velocity, limits.max_velocity),
                limits.acceleration(self._acceleration),
                limits.deceleration(self._deceleration),
            )
            shaft.follow(pieces, self._goal)


# Profile velocity (mode 3): a velocity, reached and left on ramps (CiA 402-2, 12).


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
