"""EMCY (CiA 301, 7.2.7): a node tells of an error, or that there is none any more."""

from dataclasses import dataclass
from struct import Struct
from typing import Final

from drivers.canopen.codec.error import CodecError

_EMERGENCY = Struct("<HB5s")

NO_ERROR: Final = 0x0000
CAN_OVERRUN: Final = 0x8110
CAN_PASSIVE: Final = 0x8120
HEARTBEAT_LOST: Final = 0x8130
BUS_OFF_RECOVERED: Final = 0x8140
PDO_TOO_SHORT: Final = 0x8210
PDO_TOO_LONG: Final = 0x8220
SYNC_LENGTH: Final = 0x8240
RPDO_TIMEOUT: Final = 0x8250
FOLLOWING_ERROR: Final = 0x8611
SYNC_CONTROLLER: Final = 0x8700


class ErrorRegister:
    """Bits of the error register (0x1001), which every EMCY repeats."""

    GENERIC: Final = 1 << 0
    CURRENT: Final = 1 << 1
    VOLTAGE: Final = 1 << 2
    TEMPERATURE: Final = 1 << 3
    COMMUNICATION: Final = 1 << 4
    DEVICE_PROFILE: Final = 1 << 5
    MANUFACTURER: Final = 1 << 7


@dataclass(frozen=True, slots=True)
class Emergency:
    """One EMCY. `code` 0x0000 says that an error is gone; `vendor` has up to 5 bytes."""

    code: int
    register: int = 0
    vendor: bytes = b""

    @property
    def error_gone(self) -> bool:
        """Whether it tells of the end of an error (0x00xx)."""
        return self.code & 0xFF00 == 0

    def encode(self) -> bytes:
        """The 8 bytes of the EMCY. Raises CodecError."""
        if not (0 <= self.code <= 0xFFFF and 0 <= self.register <= 0xFF and len(self.vendor) <= 5):
            raise CodecError(f"{self} does not fit an EMCY")
        return _EMERGENCY.pack(self.code, self.register, self.vendor)

    def __str__(self) -> str:
        return f"0x{self.code:04X} ({emergency_text(self.code)})"


def decode_emergency(data: bytes) -> Emergency:
    """An EMCY. Some devices send fewer than 8 bytes: what is missing is zero. Raises CodecError."""
    if not 2 <= len(data) <= 8:
        raise CodecError(f"an EMCY has 8 bytes, not {len(data)}: '{data.hex()}'")
    return Emergency(*_EMERGENCY.unpack(data.ljust(8, b"\0")))


def emergency_text(code: int) -> str:
    """What an error code means: by itself, or at least which kind it is."""
    known = _TEXTS.get(code) or _KINDS.get(code >> 8) or _WIDE_KINDS.get(code >> 12)
    return known or "unknown error"


_TEXTS: Final = {
    NO_ERROR: "no error",
    0x2310: "continuous over-current at the output",
    0x2320: "short circuit or earth leakage at the output",
    0x2340: "short circuit at the output",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3210: "DC-link over-voltage",
    0x3220: "DC-link under-voltage",
    0x4110: "ambient temperature too high",
    0x4210: "device temperature too high",
    0x4310: "drive temperature too high",
    0x5112: "24 V logic supply low",
    0x5113: "5 V logic supply low",
    0x5530: "EEPROM failed",
    0x6010: "software watchdog reset",
    0x6320: "parameter error",
    0x7121: "motor blocked",
    0x7122: "motor error or commutation",
    0x7305: "incremental encoder 1",
    0x7306: "incremental encoder 2",
    CAN_OVERRUN: "CAN overrun, messages lost",
    CAN_PASSIVE: "CAN error-passive",
    HEARTBEAT_LOST: "heartbeat or life guarding lost",
    BUS_OFF_RECOVERED: "recovered from bus-off",
    0x8150: "COB-ID collision",
    PDO_TOO_SHORT: "PDO too short, not processed",
    PDO_TOO_LONG: "PDO too long",
    0x8230: "multiplexed PDO, destination object not available",
    SYNC_LENGTH: "unexpected SYNC length",
    RPDO_TIMEOUT: "RPDO timeout",
    0x8311: "torque above its limit",
    0x8331: "torque fault",
    FOLLOWING_ERROR: "following error",
    0x8612: "reference limit",
    SYNC_CONTROLLER: "SYNC controller: SYNC lost or late",
}

# By the high byte.
_KINDS: Final = {
    0x10: "generic error",
    0x50: "device hardware",
    0x60: "device software",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x71: "motor",
    0x73: "sensor",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x83: "torque control",
    0x84: "velocity control",
    0x85: "position control",
    0x86: "positioning control",
    0x87: "SYNC controller",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific",
}

# By the highest digit, where a whole range is of one kind.
_WIDE_KINDS: Final = {
    0x2: "current",
    0x3: "voltage",
    0x4: "temperature",
    0x5: "device hardware",
    0x7: "additional modules",
}
