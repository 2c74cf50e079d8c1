"""Modes of operation: their numbers, and what a drive in each is sent."""

from dataclasses import dataclass
from typing import Final

from drivers.cia402 import objects

HOMING_MODE: Final = 6


@dataclass(frozen=True)
class OperationMode:
    """One mode of operation."""

    number: int
    """0x6060."""
    text: str
    target: int
    """The object that carries the target: position or velocity, both 32 bits signed."""

    @property
    def is_velocity(self) -> bool:
        """Whether the target is a velocity."""
        return self.target == objects.TARGET_VELOCITY


MODES: Final = {
    "pp": OperationMode(1, "profile position", objects.TARGET_POSITION),
    "pv": OperationMode(3, "profile velocity", objects.TARGET_VELOCITY),
    "csp": OperationMode(8, "cyclic synchronous position", objects.TARGET_POSITION),
    "csv": OperationMode(9, "cyclic synchronous velocity", objects.TARGET_VELOCITY),
}
CYCLIC_MODES: Final = ("csp", "csv")
"""Drives in these follow a stream of targets, one for each SYNC."""
