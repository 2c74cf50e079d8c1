"""The frame round every OpenIGTLink message: header, extended header, metadata and checksum.

OpenIGTLink protocol, versions 2 and 3 (headers 1 and 2): http://openigtlink.org/developers/spec.
All numbers are big-endian. Bytes in, values out: nothing here reads or waits.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

_HEADER: Final = struct.Struct(">H12s20sQQQ")
"""Header version, type, device name, time, size of the body, CRC of the body."""
_EXTENDED: Final = struct.Struct(">HHII")
"""Its own size, size of the metadata's header, of the metadata, number of the message."""
_METADATA_COUNT: Final = struct.Struct(">H")
_METADATA_ENTRY: Final = struct.Struct(">HHI")
"""Size of the key, encoding of the value, size of the value."""
HEADER_BYTES: Final = _HEADER.size
VERSIONS: Final = (1, 2)
"""Of the header: that of protocol 1 and 2, and that of protocol 3."""

_US_ASCII, _UTF_8 = 3, 106
"""MIBenum numbers of character sets, as IANA has registered them."""
_POLYNOMIAL: Final = 0x42F0E1EBA9EA3693
"""ECMA-182; neither reflected nor inverted, begins with 0."""
_ALL_64: Final = (1 << 64) - 1
_NS_PER_S: Final = 1_000_000_000

_MOST_BODY_BYTES: Final = 1 << 16
"""Of what is read: clients' questions have some dozens."""
_MOST_PASSED_OVER: Final = 1 << 30
"""Of what is not, as a picture that a client sends to everybody; a longer one is none."""


class FramingError(ValueError):
    """Bytes that are no OpenIGTLink message; the text says why."""


@dataclass(frozen=True)
class Frame:
    """One message, its content still bytes."""

    kind: str
    """`TRANSFORM` and so on, at most 12 characters."""
    device: str
    """Who or what it is of, at most 20 characters."""
    content: bytes = b""
    date_ns: int = 0
    """Since 1970; what a time has not got is not told of it (2 ** -32 s)."""
    metadata: dict[str, str] = field(default_factory=dict)
    """Only header 2 has it."""
    number: int = 0
    """Likewise."""


def packed(frame: Frame, version: int = 1) -> bytes:
    """A frame's bytes, with header 1 or 2. Raises FramingError."""
    if version not in VERSIONS:
        raise FramingError(f"there is no header {version}")
    kind, device = _name(frame.kind, 12), _name(frame.device, 20)
    body = frame.content
    if version > 1:
        heads, values = _packed_metadata(frame.metadata)
        extended = _EXTENDED.pack(_EXTENDED.size, len(heads), len(values), frame.number)
        body = extended + body + heads + values
    return _HEADER.pack(version, kind, device, _time(frame.date_ns), len(body), crc64(body)) + body


class Deframer:
    """Makes frames of a stream of bytes, however they come in."""

    def __init__(self, most_body_bytes: int = _MOST_BODY_BYTES) -> None:
        self.version = 1
        """Of the newest frame's header."""
        self._most = most_body_bytes
        self._buffer = bytearray()
        self._over = 0
        """Bytes still to come of a body that is too long to be read: it is passed over."""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Every frame that is whole with these bytes. Raises FramingError: nothing that comes after
        can be told from what came before."""
        self._buffer += data
        self._pass_over()
        while len(self._buffer) >= HEADER_BYTES:
            head = bytes(self._buffer[:HEADER_BYTES])
            version, kind, device, time, size, crc = _HEADER.unpack(head)
            if version not in VERSIONS:
                raise FramingError(f"a header of version {version}")
            if size > _MOST_PASSED_OVER:
                raise FramingError(f"a body of {size} bytes")
            if size > self._most:
                self._over = HEADER_BYTES + size
                self._pass_over()
                continue
            end = HEADER_BYTES + size
            if len(self._buffer) < end:
                return
            body = bytes(self._buffer[HEADER_BYTES:end])
            del self._buffer[:end]
            if crc64(body) != crc:
                raise FramingError("the checksum is not that of the body")
            self.version = version
            yield _frame(version, _text(kind), _text(device), _date_ns(time), body)

    def _pass_over(self) -> None:
        passed = min(self._over, len(self._buffer))
        del self._buffer[:passed]
        self._over -= passed


def _frame(version: int, kind: str, device: str, date_ns: int, body: bytes) -> Frame:
    """Raises FramingError."""
    if version == 1:
        return Frame(kind, device, body, date_ns)
    if len(body) < _EXTENDED.size:
        raise FramingError("the extended header is cut off")
    extended, heads, values, number = _EXTENDED.unpack_from(body)
    end = len(body) - heads - values
    if not _EXTENDED.size <= extended <= end:
        raise FramingError("the parts of the body are longer than the body")
    metadata = _metadata(body[end : end + heads], body[end + heads :])
    return Frame(kind, device, body[extended:end], date_ns, metadata, number)


def _packed_metadata(metadata: dict[str, str]) -> tuple[bytes, bytes]:
    heads, values = _METADATA_COUNT.pack(len(metadata)), b""
    for key, value in metadata.items():
        name, text = key.encode(), value.encode()
        encoding = _US_ASCII if value.isascii() else _UTF_8
        try:
            heads += _METADATA_ENTRY.pack(len(name), encoding, len(text))
        except struct.error:
            raise FramingError("a key of metadata is too long") from None
        values += name + text
    return heads, values


def _metadata(heads: bytes, values: bytes) -> dict[str, str]:
    """Raises FramingError."""
    if not heads:
        return {}
    found, at = {}, 0
    try:
        (count,) = _METADATA_COUNT.unpack_from(heads)
        for entry in range(count):
            place = _METADATA_COUNT.size + entry * _METADATA_ENTRY.size
            key_size, _, size = _METADATA_ENTRY.unpack_from(heads, place)
            end = at + key_size + size
            if end > len(values):
                raise FramingError("metadata is cut off")
            key = values[at : at + key_size].decode(errors="replace")
            found[key] = values[at + key_size : end].decode(errors="replace")
            at = end
    except struct.error:
        raise FramingError("the metadata's header is cut off") from None
    return found


def _name(text: str, most: int) -> bytes:
    """Raises FramingError."""
    if not text.isascii() or "\0" in text or len(text) > most:
        raise FramingError(f"{text!r} is no name of at most {most} ASCII characters")
    return text.encode("ascii")


def _text(field_bytes: bytes) -> str:
    return field_bytes.partition(b"\0")[0].decode("ascii", errors="replace").rstrip()


def _time(date_ns: int) -> int:
    """Fixed point: seconds in the upper 32 bits, their fraction in the lower."""
    seconds, rest_ns = divmod(date_ns, _NS_PER_S)
    return ((seconds & 0xFFFFFFFF) << 32) | ((rest_ns << 32) // _NS_PER_S)


def _date_ns(time: int) -> int:
    fraction = time & 0xFFFFFFFF
    return (time >> 32) * _NS_PER_S + -((-fraction * _NS_PER_S) >> 32)


def _table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 56
        for _ in range(8):
            crc = (crc << 1) ^ (_POLYNOMIAL if crc >> 63 else 0)
            crc &= _ALL_64
        table.append(crc)
    return tuple(table)


_TABLE: Final = _table()


def crc64(data: bytes) -> int:
    """Of a body."""
    crc, table = 0, _TABLE
    for byte in data:
        crc = ((crc << 8) & _ALL_64) ^ table[(crc >> 56) ^ byte]
    return crc
