"""How long a classical CAN frame is on the wire, in bits, to the last stuff bit.

Compiled: every frame of the emulated bus asks for it, and its bits depend on each other one by one.
"""

from struct import Struct
from typing import Final

from numba import njit

from drivers.can.bits import UNSTUFFED_BITS
from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG

_CRC_BITS: Final = 15
_CRC_POLYNOMIAL: Final = 0x4599
_CRC_MASK: Final = (1 << _CRC_BITS) - 1
_LONGEST_RUN: Final = 5
"""After so many equal bits comes a stuff bit, which is their opposite."""

_WORDS: Final = Struct(">II")
_WORD_BITS: Final = 32

_kernel = njit(cache=True)


def frame_bits(can_id: int, data: bytes) -> int:
    """Bits of a frame on the wire, with its stuff bits and 3 bits of interframe space.

    `can_id` carries the kernel's flag bits. The data of a remote frame are not sent: only their
    number is.
    """
    high, low = _WORDS.unpack(data.ljust(_WORDS.size))
    bits: int = _frame_bits(can_id, len(data), high, low)
    return bits


@_kernel
def _frame_bits(can_id: int, length: int, high: int, low: int) -> int:
    """The same for up to 8 bytes of data in two words."""
    remote = 1 if can_id & REMOTE_FLAG else 0
    if can_id & EXTENDED_FLAG:
        # Start, 11 bits, substitute remote and extension bit, 18 bits, remote, two reserved.
        base, extension = can_id >> 18 & 0x7FF, can_id & 0x3FFFF
        header, count = (base << 20 | 0b11 << 18 | extension) << 3 | remote << 2, 35
    else:
        # Start, 11 bits, remote, extension bit, one reserved.
        header, count = (can_id & 0x7FF) << 3 | remote << 2, 15
    # Nothing runs into the start bit: it is the first one.
    crc, polarity, run, stuffed = 0, 1, 1, 0
    data_bits = 0 if remote else 8 * length
    high_bits = min(data_bits, _WORD_BITS)
    for part in range(4):
        if part == 0:
            value, bits, left_out = header << 4 | length, count + 4, 0
        elif part == 1:
            value, bits, left_out = high, high_bits, _WORD_BITS - high_bits
        elif part == 2:
            value, bits = low, data_bits - high_bits
            left_out = _WORD_BITS - bits
        else:
            value, bits, left_out = crc, _CRC_BITS, 0
        for shift in range(bits - 1, -1, -1):
            bit = value >> (shift + left_out) & 1
            if (crc >> (_CRC_BITS - 1)) ^ bit:
                crc = (crc << 1 & _CRC_MASK) ^ _CRC_POLYNOMIAL
            else:
                crc = crc << 1 & _CRC_MASK
            run = run + 1 if bit == polarity else 1
            polarity = bit
            if run == _LONGEST_RUN:
                stuffed += 1
                polarity, run = 1 - bit, 1
    return int(count + 4 + data_bits + _CRC_BITS + stuffed + UNSTUFFED_BITS)
