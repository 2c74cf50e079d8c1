"""Classical CAN frames, as values and as the kernel's 16-byte `struct can_frame`."""

import struct
from typing import NamedTuple

EXTENDED_FLAG = 0x80000000
REMOTE_FLAG = 0x40000000
ERROR_FLAG = 0x20000000

STANDARD_ID_MASK = 0x7FF
EXTENDED_ID_MASK = 0x1FFFFFFF

CAN_FRAME = struct.Struct("<IB3x8s")
"""struct can_frame on a little-endian host: ID with flags, length, padding, data."""

FRAME_BYTES = CAN_FRAME.size


class CanFrame(NamedTuple):
    """One frame. `can_id` carries the kernel's flag bits (extended, remote, error)."""

    can_id: int
    data: bytes = b""

    def __str__(self) -> str:
        """As candump writes it: `181#1122`."""
        width, number = (8, self.can_id & EXTENDED_ID_MASK)
        if not self.can_id & (EXTENDED_FLAG | ERROR_FLAG):
            width = 3
        body = "R" if self.can_id & REMOTE_FLAG else self.data.hex().upper()
        return f"{number:0{width}X}#{body}"


def pack_frame(frame: CanFrame) -> bytes:
    """The kernel's 16 bytes for `frame`."""
    return CAN_FRAME.pack(frame.can_id, len(frame.data), frame.data)


def unpack_frame(packed: bytes) -> CanFrame:
    """The frame in 16 bytes of the kernel's. Raises ValueError where they are not one."""
    if len(packed) != FRAME_BYTES:
        raise ValueError(f"a CAN frame has {FRAME_BYTES} bytes, not {len(packed)}")
    can_id, length, data = CAN_FRAME.unpack(packed)
    if length > 8:
        raise ValueError(f"a CAN frame carries at most 8 bytes, not {length}")
    return CanFrame(can_id, data[:length])
