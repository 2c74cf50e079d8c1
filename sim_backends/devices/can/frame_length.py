"""How long a classical CAN frame is on the wire, in bits, to the last stuff bit.

Compiled: every frame of the emulated bus asks for it, and its bits depend on each other one by one.
"""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG, UNSTUFFED_BITS

_CRC_BITS: Final = 15
_CRC_POLYNOMIAL: Final = 0x4599
_CRC_MASK: Final = (1 << _CRC_BITS) - 1
_LONGEST_RUN: Final = 5
"""After so many equal bits comes a stuff bit, which is their opposite."""

_BITS_AT_ONCE: Final = 8
_STATE_BITS: Final = 3
"""What the next stuff bit depends on: the last bit, and how many like it there were, from 1."""
_STATE_MASK: Final = (1 << _STATE_BITS) - 1

_kernel = njit(cache=True)


def _state(bit: int, run: int) -> int:
    return bit << 2 | run - 1


def _stuffed_bit(state: int, bit: int) -> int:
    """The state after one more bit, and above it the number of stuff bits: 0 or 1."""
    run = (state & 0b11) + 2 if bit == state >> 2 else 1
    if run == _LONGEST_RUN:
        return 1 << _STATE_BITS | _state(1 - bit, 1)
    return _state(bit, run)


def _stuffing_table() -> NDArray[np.uint8]:
    """[count, state, value]: the same after the `count` bits of `value`, the highest first."""
    states = range(_STATE_MASK + 1)
    table = np.zeros((_BITS_AT_ONCE + 1, len(states), 1 << _BITS_AT_ONCE), np.uint8)
    table[0] = np.array(states)[:, np.newaxis]
    last = np.array([[_stuffed_bit(state, bit) for bit in (0, 1)] for state in states])
    for count in range(1, _BITS_AT_ONCE + 1):
        values = np.arange(1 << count)
        before = table[count - 1][:, values >> 1]
        table[count][:, values] = (before & ~np.uint8(_STATE_MASK)) + last[
            before & _STATE_MASK, values & 1
        ]
    return table


def _crc_table() -> NDArray[np.int64]:
    """What each value makes of a checksum that was 0 when all its bits have gone in."""
    table = np.zeros(1 << _BITS_AT_ONCE, np.int64)
    for value in range(1, table.size):
        shifted = int(table[value >> 1]) << 1
        if (shifted >> _CRC_BITS ^ value) & 1:
            shifted ^= _CRC_POLYNOMIAL
        table[value] = shifted & _CRC_MASK
    return table


_STUFFING: Final = _stuffing_table()
_CRC: Final = _crc_table()
_BEFORE_START: Final = _state(1, 1)
"""Nothing runs into the start bit: it is the first one."""


def frame_bits(can_id: int, data: bytes) -> int:
    """Bits of a frame on the wire, with its stuff bits and 3 bits of interframe space.

    `can_id` carries the kernel's flag bits. The data of a remote frame are not sent: only their
    number is.
    """
    bits: int = wire_bits(can_id, len(data), int.from_bytes(data, "big", signed=True))
    return bits


@_kernel
def wire_bits(can_id: int, length: int, payload: int) -> int:
    """The same for up to 8 bytes of data as one number, big-endian and signed."""
    remote = 1 if can_id & REMOTE_FLAG else 0
    if can_id & EXTENDED_FLAG:
        # Start, 11 bits, substitute remote and extension bit, 18 bits, remote, two reserved.
        base, extension = can_id >> 18 & 0x7FF, can_id & 0x3FFFF
        header, header_bits = (base << 20 | 0b11 << 18 | extension) << 3 | remote << 2, 35
    else:
        # Start, 11 bits, remote, extension bit, one reserved.
        header, header_bits = (can_id & 0x7FF) << 3 | remote << 2, 15
    header_bits += 4
    data_bits = 0 if remote else 8 * length
    crc, state, stuffed = 0, _BEFORE_START, 0
    for part in range(3):
        if part == 0:
            value, left = header << 4 | length, header_bits
        elif part == 1:
            value, left = payload, data_bits
        else:
            value, left = crc, _CRC_BITS
        while left:
            count = min(left, _BITS_AT_ONCE)
            left -= count
            bits = value >> left & (1 << count) - 1
            crc = (crc << count & _CRC_MASK) ^ _CRC[crc >> _CRC_BITS - count ^ bits]
            after = _STUFFING[count, state, bits]
            state = after & _STATE_MASK
            stuffed += after >> _STATE_BITS
    return int(header_bits + data_bits + _CRC_BITS + stuffed + UNSTUFFED_BITS)
