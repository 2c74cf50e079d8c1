"""How long a classical CAN frame is on the wire, in bits: exactly, and at worst."""

from array import array
from functools import lru_cache
from struct import Struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG, STANDARD_ID_MASK

INTERFRAME_BITS: Final = 3

# After the CRC, none of them stuffed: CRC delimiter, acknowledge slot and delimiter, end of frame.
_UNSTUFFED_BITS: Final = 1 + 1 + 1 + 7 + INTERFRAME_BITS

_CRC_BITS: Final = 15
_CRC_POLYNOMIAL: Final = 0x4599
_CRC_MASK: Final = (1 << _CRC_BITS) - 1


def worst_case_bits(data_bytes: int, extended: bool = False) -> int:
    """The longest that a frame of `data_bytes` bytes can be, with 3 bits of interframe space.

    Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis, 2007, (1).
    """
    stuffed = (54 if extended else 34) + 8 * data_bytes
    return stuffed + _UNSTUFFED_BITS + (stuffed - 1) // 4


def frame_bits(can_id: int, data: bytes) -> int:
    """Bits of a frame on the wire, with its stuff bits and 3 bits of interframe space.

    `can_id` carries the kernel's flag bits. The data of a remote frame are not sent: only their
    number is.
    """
    length = len(data)
    crc, run, bits = _header(can_id, length)
    if not can_id & REMOTE_FLAG:
        bits += 8 * length
        for word in _WORDS[length >> 1].unpack_from(data):
            crc = _CRC_OF_WORD[crc << 1 ^ word]
            run = _AFTER_WORD[(run & 7) << 16 | word]
            bits += run >> 3
        if length & 1:
            byte = data[-1]
            crc = (crc << 8 & _CRC_MASK) ^ _CRC_OF_BYTE[crc >> 7 ^ byte]
            run = _AFTER_BYTE[(run & 7) << 8 | byte]
            bits += run >> 3
    # The CRC has 15 bits; a sixteenth that differs from the last one brings no stuff bit.
    return bits + (_AFTER_WORD[(run & 7) << 16 | crc << 1 | ~crc & 1] >> 3)


# A run, the state of the stuffing, is `polarity << 2 | length - 1` of the equal bits at the end,
# length 1 to 4: a fifth one brings a stuff bit, which starts a run of its own. The tables give, by
# run and by what follows, `stuff bits << 3 | run`.


def _stuff(polarity: int, length: int, value: int, count: int) -> tuple[int, int, int]:
    """Polarity and length of the run after the last `count` bits of `value`, and stuff bits."""
    stuffed = 0
    for shift in reversed(range(count)):
        bit = value >> shift & 1
        length = length + 1 if bit == polarity else 1
        polarity = bit
        if length == 5:
            stuffed += 1
            polarity, length = 1 - polarity, 1
    return polarity, length, stuffed


def _crc(crc: int, value: int, count: int) -> int:
    for shift in reversed(range(count)):
        top = crc >> (_CRC_BITS - 1) ^ value >> shift & 1
        crc = (crc << 1 & _CRC_MASK) ^ (_CRC_POLYNOMIAL if top else 0)
    return crc


def _byte_after_run(run: int, byte: int) -> int:
    polarity, length, stuffed = _stuff(run >> 2, (run & 3) + 1, byte, 8)
    return stuffed << 3 | polarity << 2 | length - 1


def _word_table(after_byte: NDArray[np.uint8]) -> bytes:
    """What two bytes make, from what one makes: (8 runs, 256) to (8, 65536)."""
    second = after_byte[after_byte & 7]
    return bytes(((after_byte >> 3 << 3)[:, :, np.newaxis] + second).ravel())


def _crc_word_table(of_byte: NDArray[np.uint16]) -> "array[int]":
    """The CRC of two bytes, from that of one: (256,) to (65536,)."""
    rest = (of_byte << 8 & _CRC_MASK)[:, np.newaxis]
    second = of_byte[(of_byte >> 7)[:, np.newaxis] ^ np.arange(256, dtype=np.uint16)]
    return array("H", (rest ^ second).astype(np.uint16).tobytes())


_AFTER_BYTE: Final = bytes(_byte_after_run(run, byte) for run in range(8) for byte in range(256))
_AFTER_WORD: Final = _word_table(np.frombuffer(_AFTER_BYTE, np.uint8).reshape(8, 256))
_CRC_OF_BYTE: Final = array("H", (_crc(0, byte, 8) for byte in range(256)))
_CRC_OF_WORD: Final = _crc_word_table(np.array(_CRC_OF_BYTE, np.uint16))
_WORDS: Final = tuple(Struct(f">{count}H") for count in range(5))


@lru_cache(maxsize=4096)
def _header(can_id: int, length: int) -> tuple[int, int, int]:
    """CRC and run after start bit, identifier and control field; bits of all but the data."""
    remote = 1 if can_id & REMOTE_FLAG else 0
    if can_id & EXTENDED_FLAG:
        # Start, 11 bits, substitute remote and extension bit, 18 bits, remote, two reserved.
        base, extension = can_id >> 18 & STANDARD_ID_MASK, can_id & 0x3FFFF
        value = (base << 20 | 0b11 << 18 | extension) << 3 | remote << 2
        count = 1 + 11 + 2 + 18 + 3
    else:
        # Start, 11 bits, remote, extension bit, one reserved.
        value = (can_id & STANDARD_ID_MASK) << 3 | remote << 2
        count = 1 + 11 + 3
    value, count = value << 4 | length, count + 4
    # Nothing runs into the start bit: it is the first one.
    polarity, run_length, stuffed = _stuff(1, 1, value, count)
    run = polarity << 2 | run_length - 1
    return _crc(0, value, count), run, count + stuffed + _CRC_BITS + _UNSTUFFED_BITS
