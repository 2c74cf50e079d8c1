"""PDOs (CiA 301, 7.2.2): their parameters in the object dictionary, and the values they carry."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.can.frame import EXTENDED_ID_MASK, STANDARD_ID_MASK
from drivers.canopen.codec.error import CodecError

MAX_BITS: Final = 64
HIGHEST_SYNCHRONOUS_TYPE: Final = 240

RPDO_COMMUNICATION: Final = 0x1400
RPDO_MAPPING: Final = 0x1600
TPDO_COMMUNICATION: Final = 0x1800
TPDO_MAPPING: Final = 0x1A00

PDOS_PER_AXIS: Final = 0x40
"""Axis k of a multi-axis node has its PDO parameters this much times k further on."""


class TransmissionType:
    """When a PDO is sent or applied (sub-index 2). 1 to 240: with every so manieth SYNC."""

    SYNCHRONOUS_ACYCLIC: Final = 0
    EVERY_SYNC: Final = 1
    REMOTE_SYNCHRONOUS: Final = 252
    REMOTE: Final = 253
    MANUFACTURER_EVENT: Final = 254
    PROFILE_EVENT: Final = 255


_NOT_VALID: Final = 1 << 31
_NO_REMOTE: Final = 1 << 30
_EXTENDED: Final = 1 << 29


@dataclass(frozen=True, slots=True)
class PdoCobId:
    """Sub-index 1 of a PDO's communication parameters."""

    can_id: int
    valid: bool = True
    remote_allowed: bool = True
    extended: bool = False

    def encode(self) -> int:
        """The number to write. Raises CodecError."""
        if not 0 <= self.can_id <= (EXTENDED_ID_MASK if self.extended else STANDARD_ID_MASK):
            raise CodecError(f"0x{self.can_id:X} is no identifier for a PDO")
        flags = 0 if self.valid else _NOT_VALID
        flags |= 0 if self.remote_allowed else _NO_REMOTE
        return self.can_id | flags | (_EXTENDED if self.extended else 0)


def decode_pdo_cob_id(value: int) -> PdoCobId:
    """What a number read from sub-index 1 says. Raises CodecError."""
    extended = bool(value & _EXTENDED)
    can_id = value & EXTENDED_ID_MASK
    if not 0 <= value <= 0xFFFFFFFF or (not extended and can_id > STANDARD_ID_MASK):
        raise CodecError(f"0x{value:X} is no COB-ID of a PDO")
    return PdoCobId(can_id, not value & _NOT_VALID, not value & _NO_REMOTE, extended)


@dataclass(frozen=True, slots=True)
class MappingEntry:
    """One object in a PDO: sub-index 1 and up of its mapping parameters."""

    index: int
    subindex: int
    bits: int

    def encode(self) -> int:
        """The number to write."""
        return self.index << 16 | self.subindex << 8 | self.bits

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.subindex:02X}/{self.bits}"


def decode_mapping_entry(value: int) -> MappingEntry:
    """What a number read from the mapping parameters says. Raises CodecError."""
    if not 0 <= value <= 0xFFFFFFFF:
        raise CodecError(f"{value} is no mapping entry")
    return MappingEntry(value >> 16, value >> 8 & 0xFF, value & 0xFF)


@dataclass(frozen=True, slots=True)
class Field:
    """How one mapped object lies in a PDO."""

    bits: int
    signed: bool = False


class PdoLayout:
    """How the mapped objects lie in a PDO: one after the other from bit 0, little-endian."""

    def __init__(self, fields: Iterable[Field]) -> None:
        """Raises CodecError where the fields do not fit a PDO."""
        self.fields = tuple(fields)
        bits = sum(field.bits for field in self.fields)
        if bits > MAX_BITS or any(field.bits < 1 for field in self.fields):
            raise CodecError(f"fields of {[f.bits for f in self.fields]} bits do not fit a PDO")
        self.size = (bits + 7) // 8
        """Bytes of the PDO."""
        formats = [_FORMATS.get((field.bits, field.signed)) for field in self.fields]
        whole_bytes = None not in formats
        self._struct = struct.Struct("<" + "".join(map(str, formats))) if whole_bytes else None

    def pack(self, values: Sequence[int]) -> bytes:
        """The PDO that carries `values`, one for each field. Raises CodecError."""
        if self._struct is None:
            return self._pack_bits(values)
        try:
            return self._struct.pack(*values)
        except struct.error as error:
            raise CodecError(f"{list(values)} does not fit the PDO: {error}") from None

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """The values in a PDO, one for each field. Raises CodecError."""
        if self._struct is None:
            return self._unpack_bits(data)
        try:
            return self._struct.unpack(data)
        except struct.error:
            raise self._wrong_size(data) from None

    def _pack_bits(self, values: Sequence[int]) -> bytes:
        if len(values) != len(self.fields):
            raise CodecError(f"{len(values)} values for {len(self.fields)} fields")
        packed = shift = 0
        for field, value in zip(self.fields, values, strict=True):
            low = -1 << field.bits - 1 if field.signed else 0
            if not low <= value < low + (1 << field.bits):
                raise CodecError(f"{value} does not fit {field}")
            packed |= (value & (1 << field.bits) - 1) << shift
            shift += field.bits
        return packed.to_bytes(self.size, "little")

    def _unpack_bits(self, data: bytes) -> tuple[int, ...]:
        if len(data) != self.size:
            raise self._wrong_size(data)
        packed = int.from_bytes(data, "little")
        values = []
        for field in self.fields:
            value = packed & (1 << field.bits) - 1
            negative = field.signed and value >> field.bits - 1
            values.append(value - (1 << field.bits) if negative else value)
            packed >>= field.bits
        return tuple(values)

    def _wrong_size(self, data: bytes) -> CodecError:
        return CodecError(f"this PDO has {self.size} bytes, not {len(data)}: '{data.hex()}'")


_FORMATS: Final = {
    (8, False): "B",
    (8, True): "b",
    (16, False): "H",
    (16, True): "h",
    (32, False): "I",
    (32, True): "i",
    (64, False): "Q",
    (64, True): "q",
}
