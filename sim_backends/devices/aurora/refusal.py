"""Operating modes of the emulated tracker, and the codes with which it refuses commands."""

from enum import Enum, auto

Reply = str | bytes
"""Text, or the body of a binary reply; empty text is no reply."""


class Mode(Enum):
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


class Refusal(Exception):  # noqa: N818 - it is an answer, not a failure
    """The command is answered with this error code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error {code:02X}")
        self.code = code
