"""The device's status bits. Bits without a name are kept: newer firmware may give them one."""

from enum import IntEnum, IntFlag
from functools import lru_cache


class HandleState(IntEnum):
    """What a tracking reply says about one port handle."""

    VALID = 0x01
    MISSING = 0x02
    """Enabled, but no pose: out of the volume, disturbed, or a faulty sensor."""
    DISABLED = 0x04
    """Not enabled, or unplugged and not freed yet."""


class PortStatus(IntFlag):
    """Status of a port handle: all bits in tracking replies, the low six in PHSR."""

    OCCUPIED = 1 << 0
    SWITCH_1_CLOSED = 1 << 1
    SWITCH_2_CLOSED = 1 << 2
    SWITCH_3_CLOSED = 1 << 3
    INITIALISED = 1 << 4
    ENABLED = 1 << 5
    OUT_OF_VOLUME = 1 << 6
    PARTIALLY_OUT_OF_VOLUME = 1 << 7
    SENSOR_BROKEN = 1 << 8
    SENSOR_SHORTED = 1 << 10
    SIGNAL_TOO_LARGE = 1 << 11
    PROCESSING_EXCEPTION = 1 << 12


class SystemStatus(IntFlag):
    """Status of the whole system. The bits marked old are reserved in newer firmware."""

    SYNC_ERROR = 1 << 0
    """Old."""
    CRC_ERROR = 1 << 2
    """Old."""
    PROCESSING_EXCEPTION = 1 << 3
    """Old."""
    HARDWARE_FAILURE = 1 << 4
    """Old."""
    FIELD_GENERATOR_UNPLUGGED = 1 << 5
    TOOL_PLUGGED = 1 << 6
    TOOL_UNPLUGGED = 1 << 7
    ALERT_PENDING = 1 << 8
    CONFIGURATION_CHANGED = 1 << 10
    """A sensor interface unit was added or removed."""


@lru_cache(maxsize=64)
def port_status(bits: int) -> PortStatus:
    """The same as `PortStatus(bits)`, for every frame: bits rarely change, and enums are slow."""
    return PortStatus(bits)


@lru_cache(maxsize=64)
def system_status(bits: int) -> SystemStatus:
    """The same as `SystemStatus(bits)`, for every frame."""
    return SystemStatus(bits)
