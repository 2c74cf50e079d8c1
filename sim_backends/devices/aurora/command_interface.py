"""What a command sees of the emulated tracker: its mode, its parts, and how it refuses."""

from enum import Enum, auto
from typing import Protocol

from config.emulation.lab import EmulatedTracker
from drivers.aurora.codec.commands import LineSettings
from drivers.aurora.codec.tracking_data import TrackingData
from sim_backends.devices.aurora.parameters import Parameters
from sim_backends.devices.aurora.rack import Handle, Rack

Reply = str | bytes
"""Text, or the body of a binary reply; empty text is no reply."""


class TrackerMode(Enum):
    """Operating modes."""

    RESETTING = auto()
    POWERED = auto()
    """Setup, but not initialised."""
    SETUP = auto()
    TRACKING = auto()


INVALID_COMMAND, TOO_LONG, TOO_SHORT, BAD_CRC = 0x01, 0x02, 0x03, 0x04
BAD_LINE_SETTINGS, PARAMETER_COUNT, INVALID_HANDLE, INVALID_PRIORITY = 0x06, 0x07, 0x08, 0x09
INVALID_LED, INVALID_LED_STATE, WRONG_MODE = 0x0A, 0x0B, 0x0C
NO_TOOL, NOT_INITIALISED, SYSTEM_NOT_INITIALISED = 0x0D, 0x0E, 0x10
CANNOT_START_TRACKING, BLANK_MEMORY, MEMORY_WRITE_FAILED = 0x12, 0x13, 0x1F
OUT_OF_RANGE, BECAME_UNOCCUPIED, INVALID_LINE_STATE = 0x23, 0x2C, 0x31
NOT_PRESENT, NEEDS_8_BITS = 0x42, 0xC5


class CommandError(Exception):
    """The command is answered with this error code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error {code:02X}")
        self.code = code


class CommandedTracker(Protocol):
    """What commands read of the tracker, and what they make it do."""

    config: EmulatedTracker
    mode: TrackerMode
    rack: Rack
    parameters: Parameters

    @property
    def line(self) -> LineSettings:
        """The serial line's settings."""
        ...

    @property
    def field_generator_is_unplugged(self) -> bool:
        """Whether nothing can be measured for want of a field."""
        ...

    def change_line(self, settings: LineSettings) -> None:
        """COMM, from the end of its reply on."""
        ...

    def forget_parameters(self) -> None:
        """All user parameters as at power-up."""
        ...

    def initialise(self) -> None:
        """INIT, in whatever mode."""
        ...

    def reset_soon(self, soft: bool) -> None:
        """RESET."""
        ...

    def look_for_tools(self) -> None:
        """PHSR: what was plugged in or out is known from now on."""
        ...

    def serial_of(self, handle: Handle) -> str:
        """The serial number that PHINF reports."""
        ...

    def start_tracking(self, fast: bool, from_zero: bool) -> None:
        """TSTART."""
        ...

    def stop_tracking(self) -> None:
        """TSTOP."""
        ...

    def tracking_data(self, out_of_volume_too: bool) -> TrackingData:
        """The content of BX and TX."""
        ...
