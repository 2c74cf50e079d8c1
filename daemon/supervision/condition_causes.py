"""What each condition of a driver means for the robot: the cause that it raises."""

from collections.abc import Mapping
from typing import Final

from drivers.aurora import conditions as tracker
from drivers.can import conditions as bus
from drivers.cia402 import conditions as drive
from drivers.conditions import Condition
from safety.causes import Cause

CAUSE_OF_CONDITION: Final[Mapping[Condition, Cause]] = {
    **dict.fromkeys(
        (
            tracker.PORT_MISSING,
            tracker.PORT_DENIED,
            tracker.PORT_BUSY,
            tracker.PORT_UNUSABLE,
            tracker.LINK_LOST,
            tracker.NO_ANSWER,
            tracker.WRONG_FAMILY,
            tracker.RATE_REFUSED,
            tracker.DEVICE_ERROR,
            tracker.BAD_REPLIES,
            tracker.FIELD_GENERATOR_UNPLUGGED,
            tracker.TOOL_ABSENT,
            tracker.TOOL_NOT_PROGRAMMED,
            tracker.TOOL_REFUSED,
            tracker.TOOL_UNIDENTIFIED,
        ),
        Cause.TRACKER_NOT_READY,
    ),
    # Whether these matter shows in the age and the quality of the tip.
    **dict.fromkeys(
        (
            tracker.SILENT,
            tracker.FROZEN,
            tracker.CRC_ERRORS,
            tracker.FRAMES_MISSED,
            tracker.DEVICE_WARNING,
            tracker.DEVICE_RESET,
            tracker.CONFIGURATION_CHANGED,
            tracker.ALERT,
            tracker.TOOL_MISSING,
            tracker.TOOL_DISABLED,
            tracker.OUT_OF_VOLUME,
            tracker.PARTIALLY_OUT_OF_VOLUME,
            tracker.SENSOR_FAULT,
            tracker.IMPLAUSIBLE_POSE,
        ),
        Cause.TRACKER_WARNING,
    ),
    **dict.fromkeys((bus.CANNOT_OPEN, bus.TAKEN), Cause.BUS_NOT_OPEN),
    bus.FOREIGN_MASTER: Cause.FOREIGN_MASTER,
    bus.GONE: Cause.BUS_GONE,
    **dict.fromkeys((bus.DOWN, bus.OFF), Cause.BUS_OFF),
    bus.QUEUE_FULL: Cause.BUS_QUEUE_FULL,
    **dict.fromkeys(
        (
            bus.PASSIVE,
            bus.ERRORS,
            bus.QUEUE_SHORT,
            bus.OVERFLOW,
            bus.FOREIGN_FRAMES,
            bus.OVERLOADED,
        ),
        Cause.BUS_DEGRADED,
    ),
    **dict.fromkeys(
        (
            drive.ABSENT,
            drive.NOT_OPERATIONAL,
            drive.WRONG_DEVICE,
            drive.NUMBER_TWICE,
            drive.BAD_EDS,
            drive.SETTING_REFUSED,
            drive.SDO_SILENT,
            drive.PDO_MALFORMED,
            drive.MODE_REFUSED,
        ),
        Cause.NODE_NOT_READY,
    ),
    drive.SETTINGS_CHANGED: Cause.DRIVE_SETTINGS_CHANGED,
    drive.LOST: Cause.NODE_LOST,
    drive.PDO_SILENT: Cause.NODE_LOST,
    drive.RESET: Cause.NODE_RESET,
    drive.EMERGENCY: Cause.DRIVE_EMERGENCY,
    drive.FAULT: Cause.DRIVE_FAULT,
    drive.FOLLOWING_ERROR: Cause.DRIVE_FOLLOWING_ERROR,
    drive.NO_VOLTAGE: Cause.DRIVE_NO_VOLTAGE,
    drive.UNWILLING: Cause.DRIVE_NOT_ENABLED,
    drive.LIMIT_ACTIVE: Cause.DRIVE_LIMIT,
    **dict.fromkeys(
        (
            drive.WARNING,
            drive.SAFETY_MISSING,
            drive.EMERGENCIES_UNHEARD,
            drive.CYCLIC_MODE_NOT_LISTED,
            drive.COUNTS_DIFFER,
        ),
        Cause.DRIVE_WARNING,
    ),
}

ONCE: Final = frozenset({drive.EMERGENCY})
"""Conditions whose coming counts, and not their staying: drives do not always tell of the end of an
error, and one that lasts shows as a fault."""
