"""Whole records of an MCAP file, and where they go on behind damaged bytes.

A record is believed by what it says twice: a chunk by its checksum, an index by its two lengths, a
string by the record that it fills to the last byte. Behind damage the next chunk is found by the
first four bytes of its compressed content, which are always the same, and believed by its
checksum; the next metadata by their opcode, and believed by their lengths.
"""

import re
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import IO, Final, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, McapRecord, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

RECORD_HEAD: Final = struct.Struct("<BQ")
"""Opcode, length of what follows."""
_CHUNK_HEAD: Final = struct.Struct("<QQQII4sQ")
"""First and last log time, size and checksum of the content, compression, compressed size."""
_CHUNK_CRC: Final = struct.Struct("<I")
_COMPRESSION: Final = b"zstd"
_CONTENT_AT: Final = RECORD_HEAD.size + _CHUNK_HEAD.size
_CRC_AT: Final = RECORD_HEAD.size + 24
_ZSTD_FRAME: Final = b"\x28\xb5\x2f\xfd"
"""Every zstd frame begins with it (RFC 8878)."""
_INDEX_HEAD: Final = struct.Struct("<HI")
_INDEX_ENTRY_BYTES: Final = 16
_DATA_END_BYTES: Final = 4
_MESSAGE_HEAD_BYTES: Final = 22
_CONTENT_AT_MOST: Final = 1 << 26
"""Chunks are ended at 1 MiB; one message more may be in them."""
_METADATA_AT_MOST: Final = 1 << 16
_START: Final = re.compile(
    re.escape(_ZSTD_FRAME) + rb"|" + bytes([Opcode.METADATA]) + rb"(?=..\x00{6})", re.DOTALL
)
_WINDOW_BYTES: Final = 1 << 22
_PIECE_BYTES: Final = 1 << 16

_FILLED: Final[dict[int, Callable[[ReadDataStream], McapRecord]]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
}
"""Records whose strings fill them to the last byte."""


class FramedRecord(NamedTuple):
    """One record and its place in the file. body: of a chunk, its content."""

    opcode: int
    body: bytes
    start: int
    end: int


def frame_at(file: IO[bytes], start: int, size: int) -> FramedRecord | None:
    """The record of the data section that begins at `start`. None: there is none to believe.

    size: of the file, or as much of it as counts. Raises OSError.
    """
    file.seek(start)
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return None
    opcode, length = RECORD_HEAD.unpack(head)
    end = start + RECORD_HEAD.size + length
    if end > size:
        return None
    if opcode == Opcode.CHUNK:
        content = _chunk_content(file.read(length))
        return None if content is None else FramedRecord(opcode, content, start, end)
    if opcode == Opcode.DATA_END and length != _DATA_END_BYTES:
        return None
    body = file.read(length)
    return FramedRecord(opcode, body, start, end) if _believable(opcode, body) else None


def next_frame(file: IO[bytes], start: int, size: int) -> FramedRecord | None:
    """The first chunk or metadata record at or behind `start`. None: there is no more."""
    for place, mark in _marks(file, start, size):
        if mark == _ZSTD_FRAME:
            begins = place - _CONTENT_AT
            found = _chunk_around(file, begins, size) if begins >= start else None
        else:
            found = _metadata_at(file, place, size)
        if found is not None:
            return found
    return None


def filled(opcode: int, body: bytes) -> McapRecord:
    """A record that has nothing behind its last string. Raises whatever a parser raises."""
    stream = BytesIO(body)
    record = _FILLED[opcode](ReadDataStream(stream))
    if stream.tell() != len(body):
        raise ValueError("there are bytes behind the record's end")
    return record


def _believable(opcode: int, body: bytes) -> bool:
    if opcode in _FILLED:
        return _is_filled(opcode, body)
    if opcode == Opcode.MESSAGE_INDEX:
        if len(body) < _INDEX_HEAD.size:
            return False
        _, entries = _INDEX_HEAD.unpack_from(body)
        return bool(entries == len(body) - _INDEX_HEAD.size and not entries % _INDEX_ENTRY_BYTES)
    if opcode == Opcode.MESSAGE:
        return len(body) >= _MESSAGE_HEAD_BYTES
    return opcode == Opcode.DATA_END


def _is_filled(opcode: int, body: bytes) -> bool:
    try:
        filled(opcode, body)
    except Exception:  # whatever a parser says of damaged bytes
        return False
    return True


def _chunk_content(body: bytes) -> bytes | None:
    """What is in a chunk. None: it contradicts itself, or its checksum."""
    if len(body) < _CHUNK_HEAD.size or body[32:36] != _COMPRESSION:
        return _foreign_content(body)
    *_, content_size, checksum, _, _, compressed = _CHUNK_HEAD.unpack_from(body)
    if compressed != len(body) - _CHUNK_HEAD.size or content_size > _CONTENT_AT_MOST:
        return None
    found = _decompressed(iter((body[_CHUNK_HEAD.size :],)))
    if found is None or len(found[0]) != content_size:
        return None
    return found[0] if checksum in {0, zlib.crc32(found[0])} else None


def _foreign_content(body: bytes) -> bytes | None:
    """Of a chunk that is compressed otherwise than ours, or not at all."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        return stream.read(size)
    except Exception:  # whatever a parser says of damaged bytes
        return None


def _chunk_around(file: IO[bytes], start: int, size: int) -> FramedRecord | None:
    """The chunk whose compressed content stands where a record that begins at `start` has it.

    Its checksum and its content are enough: the rest of its head may be damaged.
    """
    file.seek(start + _CRC_AT)
    (checksum,) = _CHUNK_CRC.unpack(file.read(_CHUNK_CRC.size))
    file.seek(start + _CONTENT_AT)
    found = _decompressed(iter(lambda: file.read(_PIECE_BYTES), b""))
    if found is None or zlib.crc32(found[0]) != checksum:
        return None
    end = start + _CONTENT_AT + found[1]
    return FramedRecord(Opcode.CHUNK, found[0], start, end) if end <= size else None


def _decompressed(pieces: Iterator[bytes]) -> tuple[bytes, int] | None:
    """The content of the zstd frame that `pieces` begin with, and how many bytes the frame takes.

    None: it is none, has no end, or is too large to be one of a recording.
    """
    stream, content, taken = zstandard.ZstdDecompressor().decompressobj(), bytearray(), 0
    try:
        for piece in pieces:
            if not taken and not 0 <= zstandard.frame_content_size(piece) <= _CONTENT_AT_MOST:
                return None
            content += stream.decompress(piece)
            taken += len(piece)
            if stream.eof:
                return bytes(content), taken - len(stream.unused_data)
            if len(content) > _CONTENT_AT_MOST:
                return None
    except zstandard.ZstdError:
        pass
    return None


def _metadata_at(file: IO[bytes], start: int, size: int) -> FramedRecord | None:
    file.seek(start)
    head = file.read(RECORD_HEAD.size)
    _, length = RECORD_HEAD.unpack(head)
    end = start + RECORD_HEAD.size + length
    if end > size or length > _METADATA_AT_MOST:
        return None
    body = file.read(length)
    return (
        FramedRecord(Opcode.METADATA, body, start, end)
        if _is_filled(Opcode.METADATA, body)
        else None
    )


def _marks(file: IO[bytes], start: int, size: int) -> Iterator[tuple[int, bytes]]:
    """Places at which something may begin, with the bytes found there."""
    overlap = RECORD_HEAD.size - 1
    while start < size:
        file.seek(start)
        window = file.read(min(_WINDOW_BYTES + overlap, size - start))
        for match in _START.finditer(window):
            if match.start() < _WINDOW_BYTES:
                yield start + match.start(), match.group()
        start += _WINDOW_BYTES
