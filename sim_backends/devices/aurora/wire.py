"""What a serial line does to bytes: it takes its time, and turns a wrong rate into noise."""

import numpy as np

_NOISE_BYTES = 64


def wire_ns(count: int, baud_rate: int) -> int:
    """Time that `count` bytes take: 10 bits each."""
    return count * 10_000_000_000 // baud_rate


def heard(data: bytes, sent_at: int, heard_at: int, random: np.random.Generator) -> bytes:
    """What a receiver at one baud rate makes of bytes sent at another.

    Noise has its high bits set here: start bits and gaps are sampled at the wrong moments.
    """
    if sent_at == heard_at:
        return data
    count = min(max(len(data) * heard_at // max(sent_at, 1), 1), _NOISE_BYTES)
    return bytes(random.integers(0x80, 0x100, count, dtype=np.uint8))
