"""Classical CAN frames, as values and as the kernel's 16-byte `struct can_frame`."""

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

from drivers.can.conditions import OFF, OVERFLOW, PASSIVE
from drivers.conditions import Condition

# How long a classical CAN frame is on the wire, in bits, at worst.


INTERFRAME_BITS: Final = 3

UNSTUFFED_BITS: Final = 1 + 1 + 1 + 7 + INTERFRAME_BITS
"""After the CRC: its delimiter, acknowledge slot and delimiter, end of frame, interframe space."""


def worst_case_bits(data_bytes: int, extended: bool = False) -> int:
    """The longest that a frame of `data_bytes` bytes can be, with 3 bits of interframe space.

    Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis, 2007, (1).
    """
    stuffed = (54 if extended else 34) + 8 * data_bytes
    return stuffed + UNSTUFFED_BITS + (stuffed - 1) // 4


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


# The kernel's error frames: what the CAN controller says about the bus.


_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_RESTARTED: Final = 0x100

# Second byte of a controller error.
_RECEIVE_OVERFLOW: Final = 0x01
_TRANSMIT_OVERFLOW: Final = 0x02
_RECEIVE_PASSIVE: Final = 0x10
_TRANSMIT_PASSIVE: Final = 0x20
_ACTIVE: Final = 0x40


def conditions_of_error_frame(can_id: int, data: bytes) -> Iterator[tuple[Condition, bool, str]]:
    """What an error frame says: condition, whether it holds now, and details.

    An overflow is over as soon as it is told; the receiver counts it.
    """
    if can_id & _BUS_OFF:
        yield OFF, True, "error counter over 255"
    if can_id & _RESTARTED:
        yield OFF, False, "restarted"
        yield PASSIVE, False, "restarted"
    if can_id & _CONTROLLER and len(data) > 1:
        state = data[1]
        if state & (_RECEIVE_OVERFLOW | _TRANSMIT_OVERFLOW):
            yield OVERFLOW, True, "receive" if state & _RECEIVE_OVERFLOW else "transmit"
            yield OVERFLOW, False, ""
        if state & (_RECEIVE_PASSIVE | _TRANSMIT_PASSIVE):
            counters = f"counters {data[6]}/{data[7]}" if len(data) > 7 else "error-passive"
            yield PASSIVE, True, counters
        if state & _ACTIVE:
            yield PASSIVE, False, "error-active again"
