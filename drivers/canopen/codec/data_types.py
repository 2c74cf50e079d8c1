"""CANopen's data types (CiA 301, 7.4.7): values of objects as the bytes of SDOs and PDOs."""

from enum import IntEnum
from typing import Final

from drivers.canopen.codec.error import CodecError

Value = int | bytes
"""An object's value: a number, or the bytes of a string or domain."""


class DataType(IntEnum):
    """The types that drives use, by their index in the object dictionary."""

    BOOLEAN = 0x01
    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    VISIBLE_STRING = 0x09
    OCTET_STRING = 0x0A
    DOMAIN = 0x0F
    INTEGER64 = 0x15
    UNSIGNED64 = 0x1B

    @property
    def size(self) -> int | None:
        """Bytes of a value; None where it may have any length."""
        return _SIZES.get(self)

    @property
    def signed(self) -> bool:
        """Whether numbers may be negative."""
        return self in _SIGNED


_SIZES: Final = {
    DataType.BOOLEAN: 1,
    DataType.INTEGER8: 1,
    DataType.INTEGER16: 2,
    DataType.INTEGER32: 4,
    DataType.INTEGER64: 8,
    DataType.UNSIGNED8: 1,
    DataType.UNSIGNED16: 2,
    DataType.UNSIGNED32: 4,
    DataType.UNSIGNED64: 8,
}
_SIGNED: Final = {DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32, DataType.INTEGER64}


def encode_value(data_type: DataType, value: Value) -> bytes:
    """The bytes of a value, little-endian. Raises CodecError."""
    size = data_type.size
    if size is None or isinstance(value, bytes):
        if size is not None or not isinstance(value, bytes):
            raise CodecError(f"{value!r} is no {data_type.name}")
        return value
    try:
        return value.to_bytes(size, "little", signed=data_type.signed)
    except OverflowError:
        raise CodecError(f"{value} does not fit {data_type.name}") from None


def decode_value(data_type: DataType, data: bytes) -> Value:
    """The value in the bytes of an object. Raises CodecError."""
    size = data_type.size
    if size is None:
        return data
    if len(data) != size:
        raise CodecError(f"{data_type.name} has {size} bytes, not {len(data)}: '{data.hex()}'")
    return int.from_bytes(data, "little", signed=data_type.signed)
