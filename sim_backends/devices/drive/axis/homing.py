"""Homing (mode 6): finding the zero (CiA 402-2, 11)."""

from dataclasses import dataclass
from enum import Enum, auto
from math import ceil, floor
from typing import Final

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis import trajectory
from sim_backends.devices.drive.axis.mode import (
    HOMING_ATTAINED,
    HOMING_ERROR,
    START_HOMING,
    TARGET_REACHED,
    AxisParts,
    Lasting,
    Mode,
)

_STALL_S: Final = 0.1
"""Pushing against a mechanical stop for so long means that it is one."""


class Kind(Enum):
    """What a step of a homing run looks for."""

    SWITCH_CLOSES = auto()
    SWITCH_OPENS = auto()
    INDEX = auto()
    STOP = auto()


@dataclass(frozen=True)
class Step:
    """Go in `direction` until it is found. `side`: which limit switch, -1 or +1."""

    kind: Kind
    direction: int
    side: int = 0


_NEGATIVE_SWITCH: Final = (Step(Kind.SWITCH_CLOSES, -1, -1), Step(Kind.SWITCH_OPENS, +1, -1))
_POSITIVE_SWITCH: Final = (Step(Kind.SWITCH_CLOSES, +1, +1), Step(Kind.SWITCH_OPENS, -1, +1))

METHODS: Final = {
    1: (*_NEGATIVE_SWITCH, Step(Kind.INDEX, +1)),
    2: (*_POSITIVE_SWITCH, Step(Kind.INDEX, -1)),
    17: _NEGATIVE_SWITCH,
    18: _POSITIVE_SWITCH,
    33: (Step(Kind.INDEX, -1),),
    34: (Step(Kind.INDEX, +1),),
    35: (),
    37: (),
    # This make's own: as 17 and 18, with the mechanical stop in place of the switch.
    -17: (Step(Kind.STOP, -1),),
    -18: (Step(Kind.STOP, +1),),
}


class Phase(Enum):
    """How far a run is, with the statusword bits that say so."""

    NOT_STARTED = TARGET_REACHED
    RUNNING = 0
    INTERRUPTED = TARGET_REACHED | 1
    ATTAINED = HOMING_ATTAINED
    DONE = HOMING_ATTAINED | TARGET_REACHED
    FAILED = HOMING_ERROR
    FAILED_STANDING = HOMING_ERROR | TARGET_REACHED


_STATUS: Final = TARGET_REACHED | HOMING_ATTAINED | HOMING_ERROR


class HomingMode(Mode):
    """One homing run after the other."""

    code = 6

    def __init__(self, parts: AxisParts) -> None:
        super().__init__(parts)
        self._method = parts.own(0x6098, 0, DataType.INTEGER8, 37)
        self._fast = parts.own(0x6099, 1, DataType.UNSIGNED32, 4000)
        self._slow = parts.own(0x6099, 2, DataType.UNSIGNED32, 400)
        self._acceleration = parts.own(0x609A, 0, DataType.UNSIGNED32, 50_000)
        self._offset = parts.own(0x607C, 0, DataType.INTEGER32)
        self._phase = Phase.NOT_STARTED
        self._steps: list[Step] = []
        self._home = 0.0
        self._index = 0.0
        self._stalls = Lasting()

    @property
    def busy(self) -> bool:
        return self._phase in (Phase.RUNNING, Phase.ATTAINED, Phase.FAILED)

    @property
    def ignores_following_error(self) -> bool:
        return self._phase is Phase.RUNNING and self._steps[0].kind is Kind.STOP

    def start(self) -> None:
        self._phase = Phase.NOT_STARTED

    def controlled(self, control: int, previous: int) -> None:
        wanted, was = control & START_HOMING, previous & START_HOMING
        if wanted and not was:
            self._begin()
        elif was and not wanted and self._phase is Phase.RUNNING:
            self._brake()
            self._phase = Phase.INTERRUPTED

    def resume(self) -> None:
        """A run that was halted does not go on by itself."""
        if self._phase is Phase.RUNNING:
            self._phase = Phase.INTERRUPTED

    def tick(self) -> None:
        moving = self.shaft.moving
        if self._phase is Phase.RUNNING:
            self._look()
        elif self._phase is Phase.ATTAINED and not moving:
            self._phase = Phase.DONE
        elif self._phase is Phase.FAILED and not moving:
            self._phase = Phase.FAILED_STANDING

    def status(self) -> int:
        return self._phase.value & _STATUS

    def _begin(self) -> None:
        self._steps = list(METHODS[self._method.number])
        self._home = self.shaft.position
        self._phase = Phase.RUNNING
        if self._steps and not (self._fast.number and self._slow.number):
            self._fail()
        else:
            self._next_step()

    def _next_step(self) -> None:
        if not self._steps:
            self._attain()
            return
        step = self._steps[0]
        self._stalls.forget()
        self._index = self._next_index(step.direction)
        rapid = step.kind in (Kind.SWITCH_CLOSES, Kind.STOP)
        speed = abs(self.parts.units.increments_s((self._fast if rapid else self._slow).number))
        rate = self.parts.limits.acceleration(self._acceleration)
        shaft = self.shaft
        velocity = step.direction * min(speed, self.parts.limits.max_velocity)
        pieces = trajectory.change_velocity(shaft.demand_velocity, velocity, rate, rate)
        shaft.follow(pieces, None)
        self._look()

    def _look(self) -> None:
        """Whether what this step looks for has been found."""
        found = self._found(self._steps[0])
        if found is not None:
            self._home = found
            self._steps.pop(0)
            self._next_step()
        elif self._steps[0].kind is Kind.INDEX and self._at_switch(self._steps[0].direction):
            self._fail()

    def _found(self, step: Step) -> float | None:
        """Where it was. Switches and index are latched: exact, however late they are looked at."""
        position, mechanics = self.shaft.position, self.parts.mechanics
        match step.kind:
            case Kind.SWITCH_CLOSES:
                return position if self._at_switch(step.side) else None
            case Kind.SWITCH_OPENS:
                edge = mechanics.low_switch if step.side < 0 else mechanics.high_switch
                return None if self._at_switch(step.side) else edge
            case Kind.INDEX:
                passed = (position - self._index) * step.direction >= 0.0
                return self._index if passed else None
            case Kind.STOP:
                return self._stalled(step.direction)

    def _at_switch(self, side: int) -> bool:
        position, mechanics = self.shaft.position, self.parts.mechanics
        if side < 0:
            return position <= mechanics.low_switch
        return position >= mechanics.high_switch

    def _stalled(self, direction: int) -> float | None:
        pushes = self.shaft.pushing == direction
        if not self._stalls.update(pushes, self.shaft.t_ns, self.parts.timers.host_ns(_STALL_S)):
            return None
        self.shaft.hold()
        return self.shaft.position

    def _next_index(self, direction: int) -> float:
        """The first index pulse beyond the last thing found."""
        turn, index = self.parts.mechanics.counts_per_turn, self.parts.mechanics.index_counts
        turns = (self._home - index) / turn
        return index + turn * (floor(turns) + 1 if direction > 0 else ceil(turns) - 1)

    def _attain(self) -> None:
        units = self.parts.units
        units.zero = self._home + self._offset.number / units.per_increment
        self.parts.homed()
        self._brake()
        self._phase = Phase.ATTAINED
        if not self.shaft.moving:
            self._phase = Phase.DONE

    def _fail(self) -> None:
        self._brake()
        self._phase = Phase.FAILED

    def _brake(self) -> None:
        shaft = self.shaft
        rate = self.parts.limits.acceleration(self._acceleration)
        shaft.follow(trajectory.stop(shaft.demand_velocity, rate), None)
