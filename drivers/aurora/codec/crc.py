"""CRC-16/ARC, the checksum of every command and reply.

Read with its lowest bit first, as a serial line sends them, data is a polynomial n(z) over two
values. Its checksum is n z^-N modulo z^16 + z^14 + z + 1, where N is the number of bits. That
modulus is (z + 1) R with R = z^15 + z^14 + 1. Modulo z + 1 only the parity counts. Modulo any power
R^m with m = 2^k, which again has three terms, 1 is as much as z^14m + z^15m: so up to 14m of the
lowest bits are added further up, in one step with whole numbers as long as the data. A reply with
two tools takes eight such steps; byte by byte it would take ninety.
"""

from functools import lru_cache
from typing import NamedTuple

_R = 0xC001


class _Fold(NamedTuple):
    """Some lowest bits go, and come back at two places further up."""

    bits: int
    mask: int
    up: int
    further_up: int


@lru_cache(maxsize=128)
def _folds(length: int) -> tuple[_Fold, ...]:
    """The steps for so many bytes, big ones first. What a step adds, 15m bits, must not be longer
    than what the later ones take away and the 15 bits that stay."""
    folds = []
    left = 8 * length
    while left:
        m = 1
        while 15 * (2 * m) <= left - 14 * (2 * m) + 15:
            m *= 2
        bits = min(14 * m, left)
        folds.append(_Fold(bits, (1 << bits) - 1, 14 * m - bits, 15 * m - bits))
        left -= bits
    return tuple(folds)


@lru_cache(maxsize=8)
def crc16(data: bytes) -> int:
    """CRC-16/ARC of `data`: reflected 0x8005, starts at 0, no final inversion.

    What was asked last is remembered: heads of replies are always the same, and where the device
    is emulated in the same process each reply is asked for twice.
    """
    n = int.from_bytes(data, "little")
    parity = n.bit_count() & 1
    for bits, mask, up, further_up in _folds(len(data)):
        low = n & mask
        n = (n >> bits) ^ (low << up) ^ (low << further_up)
    return n if n.bit_count() & 1 == parity else n ^ _R
