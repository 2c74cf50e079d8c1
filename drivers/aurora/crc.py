"""CRC-16/ARC, the checksum of every command and reply."""

from functools import lru_cache

_REFLECTED_POLYNOMIAL = 0xA001


def _after_bits(register: int) -> int:
    for _ in range(8):
        register = (register >> 1) ^ (_REFLECTED_POLYNOMIAL if register & 1 else 0)
    return register


_AFTER_BYTE = tuple(_after_bits(byte) for byte in range(256))
"""The register after one byte, by its low byte before it.

A table of words would halve the steps, but at forty replies a second it is never in the cache.
"""


@lru_cache(maxsize=8)
def crc16(data: bytes) -> int:
    """CRC-16/ARC of `data`: reflected 0x8005, starts at 0, no final inversion.

    What was asked last is remembered: heads of replies are always the same, and where the device
    is emulated in the same process each reply is asked for twice.
    """
    register = 0
    table = _AFTER_BYTE
    for byte in data:
        register = (register >> 8) ^ table[(register ^ byte) & 0xFF]
    return register
