"""SDO abort codes (CiA 301, table 22). Match on the number: texts differ between products."""

from enum import IntEnum
from typing import Final


class AbortCode(IntEnum):
    """Why an SDO transfer was aborted."""

    TOGGLE_NOT_ALTERNATED = 0x05030000
    TIMEOUT = 0x05040000
    COMMAND_INVALID = 0x05040001
    BLOCK_SIZE_INVALID = 0x05040002
    SEQUENCE_NUMBER_INVALID = 0x05040003
    CRC_ERROR = 0x05040004
    OUT_OF_MEMORY = 0x05040005
    UNSUPPORTED_ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    MAPPING_TOO_LONG = 0x06040042
    PARAMETER_INCOMPATIBLE = 0x06040043
    INTERNALLY_INCOMPATIBLE = 0x06040047
    HARDWARE_ERROR = 0x06060000
    LENGTH_MISMATCH = 0x06070010
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    VALUE_OUT_OF_RANGE = 0x06090030
    VALUE_TOO_HIGH = 0x06090031
    VALUE_TOO_LOW = 0x06090032
    MAXIMUM_BELOW_MINIMUM = 0x06090036
    RESOURCE_NOT_AVAILABLE = 0x060A0023
    GENERAL_ERROR = 0x08000000
    CANNOT_STORE = 0x08000020
    LOCAL_CONTROL = 0x08000021
    DEVICE_STATE = 0x08000022
    NO_OBJECT_DICTIONARY = 0x08000023
    NO_DATA = 0x08000024


def abort_text(code: int) -> str:
    """What an abort code means."""
    return _TEXTS.get(code, "unknown abort code")


_TEXTS: Final[dict[int, str]] = {
    AbortCode.TOGGLE_NOT_ALTERNATED: "toggle bit not alternated",
    AbortCode.TIMEOUT: "SDO protocol timed out",
    AbortCode.COMMAND_INVALID: "command specifier not valid or unknown",
    AbortCode.BLOCK_SIZE_INVALID: "block size not valid",
    AbortCode.SEQUENCE_NUMBER_INVALID: "sequence number not valid",
    AbortCode.CRC_ERROR: "CRC error",
    AbortCode.OUT_OF_MEMORY: "out of memory",
    AbortCode.UNSUPPORTED_ACCESS: "access to the object not supported",
    AbortCode.WRITE_ONLY: "the object can only be written",
    AbortCode.READ_ONLY: "the object can only be read",
    AbortCode.NO_OBJECT: "the object does not exist",
    AbortCode.NOT_MAPPABLE: "the object cannot be mapped to the PDO",
    AbortCode.MAPPING_TOO_LONG: "the mapped objects are longer than a PDO",
    AbortCode.PARAMETER_INCOMPATIBLE: "general parameter incompatibility",
    AbortCode.INTERNALLY_INCOMPATIBLE: "general internal incompatibility in the device",
    AbortCode.HARDWARE_ERROR: "hardware error",
    AbortCode.LENGTH_MISMATCH: "data type does not match, length does not match",
    AbortCode.TOO_LONG: "data type does not match, too long",
    AbortCode.TOO_SHORT: "data type does not match, too short",
    AbortCode.NO_SUBINDEX: "the subindex does not exist",
    AbortCode.VALUE_OUT_OF_RANGE: "value out of range",
    AbortCode.VALUE_TOO_HIGH: "value too high",
    AbortCode.VALUE_TOO_LOW: "value too low",
    AbortCode.MAXIMUM_BELOW_MINIMUM: "maximum is less than minimum",
    AbortCode.RESOURCE_NOT_AVAILABLE: "resource not available",
    AbortCode.GENERAL_ERROR: "general error",
    AbortCode.CANNOT_STORE: "data cannot be transferred or stored",
    AbortCode.LOCAL_CONTROL: "data cannot be transferred or stored because of local control",
    AbortCode.DEVICE_STATE: "data cannot be transferred or stored in the present device state",
    AbortCode.NO_OBJECT_DICTIONARY: "no object dictionary",
    AbortCode.NO_DATA: "no data available",
}
