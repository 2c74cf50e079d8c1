"""What every mode of operation is to its axis, and what it works with."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis.limits import Limits
from sim_backends.devices.drive.axis.mechanics import AxisMechanics, Units
from sim_backends.devices.drive.axis.shaft import Shaft
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary
from sim_backends.devices.drive.node.timers import Timers

# Bits of the controlword that belong to the mode.
NEW_SETPOINT: Final = 1 << 4
START_HOMING: Final = 1 << 4
CHANGE_IMMEDIATELY: Final = 1 << 5
RELATIVE: Final = 1 << 6

# Bits of the statusword that belong to the mode, under the names they have in each.
TARGET_REACHED: Final = 1 << 10
SETPOINT_ACKNOWLEDGED: Final = 1 << 12
STANDS_STILL: Final = 1 << 12
FOLLOWS_COMMAND: Final = 1 << 12
HOMING_ATTAINED: Final = 1 << 12
FOLLOWING_ERROR: Final = 1 << 13
HOMING_ERROR: Final = 1 << 13


@dataclass(frozen=True)
class AxisParts:
    """What the modes of one axis share. `base`: offset of its objects, 0x800 per axis."""

    objects: ObjectDictionary
    base: int
    shaft: Shaft
    units: Units
    limits: Limits
    mechanics: AxisMechanics
    timers: Timers
    homed: Callable[[], None]
    """To be called when the zero has moved."""

    def own(self, index: int, subindex: int, data_type: DataType, default: int = 0) -> Entry:
        """The axis' own object at `index` of the first axis."""
        return self.objects.own(self.base + index, subindex, data_type, default)


class Lasting:
    """Whether something has held for some time."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def forget(self) -> None:
        """It has not held so far."""
        self._since_ns = None

    def update(self, holds: bool, t_ns: int, duration_ns: int) -> bool:
        """Whether it holds at `t_ns` and has for `duration_ns`."""
        if not holds:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = t_ns
        return t_ns - self._since_ns >= duration_ns


class Mode:
    """A mode of operation. Its methods are called with the shaft advanced to the present."""

    code: int = 0
    """As in 0x6060."""

    def __init__(self, parts: AxisParts) -> None:
        self.parts = parts
        self.shaft = parts.shaft
        self.limited = False
        """Whether it could not do all it was asked to (statusword bit 11)."""

    @property
    def busy(self) -> bool:
        """Whether it must be looked after by `tick` from time to time."""
        return False

    @property
    def ignores_following_error(self) -> bool:
        """While it pushes against a stop on purpose."""
        return False

    def start(self) -> None:
        """The axis follows this mode from now on."""

    def controlled(self, control: int, previous: int) -> None:
        """Another controlword came while the axis follows this mode."""

    def commanded(self) -> None:
        """Targets came, new ones or the same."""

    def resume(self) -> None:
        """A halt, or a stop that was taken back, is over."""

    def tick(self) -> None:
        """Some time has passed."""

    def status(self) -> int:
        """The mode's bits of the statusword."""
        return 0
