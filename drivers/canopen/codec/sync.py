"""SYNC (CiA 301, 7.2.5): the beat of synchronous PDOs, with a counter where 0x1019 asks for it."""

from typing import Final

from drivers.canopen.codec.error import CodecError

HIGHEST_COUNTER: Final = 240


def encode_sync(counter: int | None = None) -> bytes:
    """The data of a SYNC. Raises CodecError."""
    if counter is None:
        return b""
    if not 1 <= counter <= HIGHEST_COUNTER:
        raise CodecError(f"a SYNC counter is 1 to {HIGHEST_COUNTER}, not {counter}")
    return bytes((counter,))


def decode_sync(data: bytes) -> int | None:
    """The counter of a SYNC; None where it has none. Raises CodecError."""
    if not data:
        return None
    if len(data) != 1 or not 1 <= data[0] <= HIGHEST_COUNTER:
        raise CodecError(f"a SYNC carries nothing, or a counter from 1 to 240: '{data.hex()}'")
    return data[0]
