"""What each condition of a driver means for the robot: the cause that it raises."""

from collections.abc import Mapping
from typing import Final

from drivers.aurora import conditions as tracker
from drivers.can import conditions as bus
from drivers.cia402 import conditions as drive
from drivers.conditions import Condition

CAUSE_OF_CONDITION: Final[Mapping[Condition, str]] = {
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
        "tracker_not_ready",
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
        "tracker_warning",
    ),
    **dict.fromkeys((bus.CANNOT_OPEN, bus.TAKEN), "bus_not_open"),
    bus.FOREIGN_MASTER: "foreign_master",
    bus.GONE: "bus_gone",
    **dict.fromkeys((bus.DOWN, bus.OFF), "bus_off"),
    bus.QUEUE_FULL: "bus_queue_full",
    **dict.fromkeys(
        (
            bus.PASSIVE,
            bus.ERRORS,
            bus.QUEUE_SHORT,
            bus.OVERFLOW,
            bus.FOREIGN_FRAMES,
            bus.OVERLOADED,
        ),
        "bus_degraded",
    ),
    **dict.fromkeys(
        (
            drive.ABSENT,
            drive.NOT_OPERATIONAL,
            drive.WRONG_DEVICE,
            drive.BAD_EDS,
            drive.SETTING_REFUSED,
            drive.SDO_SILENT,
            drive.PDO_MALFORMED,
            drive.MODE_REFUSED,
        ),
        "node_not_ready",
    ),
    drive.SETTINGS_CHANGED: "drive_settings_changed",
    drive.LOST: "node_lost",
    drive.PDO_SILENT: "node_lost",
    drive.RESET: "node_reset",
    drive.EMERGENCY: "drive_emergency",
    drive.FAULT: "drive_fault",
    drive.FOLLOWING_ERROR: "drive_following_error",
    drive.NO_VOLTAGE: "drive_no_voltage",
    drive.UNWILLING: "drive_not_enabled",
    drive.LIMIT_ACTIVE: "drive_limit",
    **dict.fromkeys(
        (drive.WARNING, drive.SAFETY_MISSING, drive.CYCLIC_MODE_NOT_LISTED), "drive_warning"
    ),
}

ONCE: Final = frozenset({drive.EMERGENCY})
"""Conditions whose coming counts, and not their staying: drives do not always tell of the end of an
error, and one that lasts shows as a fault."""
