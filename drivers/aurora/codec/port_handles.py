"""PHSR: which port handles there are, and in what state."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.fields import FieldReader
from drivers.aurora.codec.status_bits import PortStatus


class HandleList(IntEnum):
    """The handles that PHSR can be asked for."""

    ALL = 0
    TO_FREE = 1
    TO_INITIALISE = 2
    TO_ENABLE = 3
    ENABLED = 4


class PortHandle(NamedTuple):
    """One port handle and its status."""

    handle: int
    status: PortStatus


def decode_port_handles(text: str) -> tuple[PortHandle, ...]:
    """The handles in a reply to PHSR. Raises CodecError."""
    reader = FieldReader(text, "PHSR")
    handles = tuple(
        PortHandle(reader.hex(2), PortStatus(reader.hex(3))) for _ in range(reader.hex(2))
    )
    reader.end()
    return handles


def encode_port_handles(handles: Sequence[PortHandle]) -> str:
    """The reply to PHSR that lists `handles`. Only the low twelve status bits have room."""
    if len(handles) > 0xFF:
        raise CodecError("PHSR: at most 255 handles")
    entries = [f"{handle:02X}{status & 0xFFF:03X}" for handle, status in handles]
    return f"{len(handles):02X}" + "".join(entries)
