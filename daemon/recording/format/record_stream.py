"""What the daemon says to the recorder process: records, one after the other, through a pipe.

Each is little-endian: length of the content (u32), number (u16), monotonic time in ns (i64), then
the content. Numbers below FIRST_CHANNEL are orders; the others are channels, declared before use.
"""

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

HEAD: Final = struct.Struct("<IHq")

BEGIN: Final = 0
"""Content: a `Begin`. Comes first."""
CHANNEL: Final = 1
"""Content: number (u16) and topic of a channel."""
SYNC: Final = 2
"""Bring what is there to the disk now."""
END: Final = 3
"""Content: number of messages that were dropped on the way (u64). Comes last."""
FIRST_CHANNEL: Final = 16

_NUMBER: Final = struct.Struct("<H")
_COUNT: Final = struct.Struct("<Q")
_CONTENT_AT_MOST: Final = 1 << 24


class Begin(msgspec.Struct, frozen=True, kw_only=True):
    """What a recording starts with; as in `RunWriter`."""

    path: str
    header: dict[str, str]
    wall_offset_ns: int


class RecorderProgress(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the recorder process answers: one line of JSON, about twice a second."""

    bytes_written: int = 0
    free_mb: float | None = None
    dropped: int = 0
    """For lack of room on the disk."""
    failed: str = ""
    lost: bool = False
    """The file was deleted: what is written will never be seen."""


class Record(NamedTuple):
    """One record. What `content` holds depends on `number`."""

    number: int
    t_ns: int
    content: bytes


class RecordStreamError(ValueError):
    """Bytes that are no record stream."""


class RecordWriter:
    """The daemon's side: records into a buffer that whoever has the pipe takes from."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self._numbers: dict[str, int] = {}

    def begin(self, begin: Begin) -> None:
        self._put(BEGIN, 0, msgspec.json.encode(begin))

    def message(self, topic: str, t_ns: int, payload: bytes) -> None:
        number = self._numbers.get(topic)
        if number is None:
            number = self._numbers[topic] = FIRST_CHANNEL + len(self._numbers)
            self._put(CHANNEL, 0, _NUMBER.pack(number) + topic.encode())
        self.buffer += HEAD.pack(len(payload), number, t_ns)
        self.buffer += payload

    def sync(self) -> None:
        self._put(SYNC, 0, b"")

    def end(self, dropped: int) -> None:
        self._put(END, 0, _COUNT.pack(dropped))

    def _put(self, number: int, t_ns: int, content: bytes) -> None:
        self.buffer += HEAD.pack(len(content), number, t_ns)
        self.buffer += content


class RecordReader:
    """The recorder's side: pieces of any size in, whole records out."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[Record]:
        """The records that `data` completes. Raises RecordStreamError."""
        self._buffer += data
        offset = 0
        while len(self._buffer) - offset >= HEAD.size:
            length, number, t_ns = HEAD.unpack_from(self._buffer, offset)
            if length > _CONTENT_AT_MOST:
                raise RecordStreamError(f"a record of {length} bytes")
            end = offset + HEAD.size + length
            if end > len(self._buffer):
                break
            yield Record(number, t_ns, bytes(self._buffer[offset + HEAD.size : end]))
            offset = end
        del self._buffer[:offset]


def declared_channel(content: bytes) -> tuple[int, str]:
    """Number and topic in a CHANNEL record."""
    return int(_NUMBER.unpack_from(content)[0]), content[_NUMBER.size :].decode()


def dropped_count(content: bytes) -> int:
    """The count in an END record."""
    return int(_COUNT.unpack(content)[0])
