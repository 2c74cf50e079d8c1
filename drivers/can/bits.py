"""How long a classical CAN frame is on the wire, in bits, at worst."""

from typing import Final

INTERFRAME_BITS: Final = 3

UNSTUFFED_BITS: Final = 1 + 1 + 1 + 7 + INTERFRAME_BITS
"""After the CRC: its delimiter, acknowledge slot and delimiter, end of frame, interframe space."""


def worst_case_bits(data_bytes: int, extended: bool = False) -> int:
    """The longest that a frame of `data_bytes` bytes can be, with 3 bits of interframe space.

    Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis, 2007, (1).
    """
    stuffed = (54 if extended else 34) + 8 * data_bytes
    return stuffed + UNSTUFFED_BITS + (stuffed - 1) // 4
