"""CAN traffic as a capture file: pcap with nanoseconds, which Wireshark and tshark read as it is.

Link type 227 (CAN over SocketCAN). Read it with `tshark -r FILE -d can.subdissector,canopen`.
"""

import struct
from collections.abc import Iterator
from typing import Final

from drivers.can.frame import CanFrame

_MAGIC_NANOSECONDS: Final = 0xA1B23C4D
_LINKTYPE_CAN_SOCKETCAN: Final = 227
_SNAP_LENGTH: Final = 16
_FILE_HEADER: Final = struct.Struct("<IHHiIII")
_RECORD_HEADER: Final = struct.Struct("<IIII")
_FRAME: Final = struct.Struct(">IB3x8s")  # unlike the kernel's struct, the ID is big-endian
_NS_PER_S: Final = 1_000_000_000


class CaptureError(ValueError):
    """Bytes that are no CAN capture; the text says where and why."""


def capture_header() -> bytes:
    """What a capture file begins with."""
    return _FILE_HEADER.pack(_MAGIC_NANOSECONDS, 2, 4, 0, 0, _SNAP_LENGTH, _LINKTYPE_CAN_SOCKETCAN)


def capture_record(wall_time_ns: int, can_id: int, data: bytes) -> bytes:
    """One frame, seen at `wall_time_ns` (since 1970)."""
    seconds, nanoseconds = divmod(wall_time_ns, _NS_PER_S)
    size = _FRAME.size
    return _RECORD_HEADER.pack(seconds, nanoseconds, size, size) + _FRAME.pack(
        can_id, len(data), data
    )


def read_capture(content: bytes) -> Iterator[tuple[int, CanFrame]]:
    """Wall time in ns and frame of each record. A record cut short by a crash ends the file."""
    if len(content) < _FILE_HEADER.size:
        raise CaptureError("too short for a capture file")
    magic, *_, link_type = _FILE_HEADER.unpack_from(content)
    if magic != _MAGIC_NANOSECONDS or link_type != _LINKTYPE_CAN_SOCKETCAN:
        raise CaptureError(f"magic {magic:#x} and link type {link_type} are not a CAN capture")
    offset = _FILE_HEADER.size
    while offset + _RECORD_HEADER.size + _FRAME.size <= len(content):
        seconds, nanoseconds, size, _ = _RECORD_HEADER.unpack_from(content, offset)
        can_id, length, data = _FRAME.unpack_from(content, offset + _RECORD_HEADER.size)
        if size != _FRAME.size or length > 8:
            raise CaptureError(f"the record at byte {offset} is no classical CAN frame")
        yield seconds * _NS_PER_S + nanoseconds, CanFrame(can_id, data[:length])
        offset += _RECORD_HEADER.size + size
