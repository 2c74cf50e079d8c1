"""Writes MCAP files: the library's writer with the work per message cut down to a tenth.

A recording has hundreds of messages a second, and the library makes objects and a dozen small
writes of each. All that is rare is left to the library's own records; the file is the same to the
last byte, but for its chunks' compression, which is lighter, and for declarations that are
repeated where that is asked for.
"""

import fcntl
import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

# A file that takes what it is given even while the disk does not: it waits for room, in memory.


_WRITE_FROM: Final = 1 << 16


class PatientFile:
    """Append only, new, and locked against a recovery while it is open.

    What the disk refuses is kept and tried again at the next flush, in order, so that the file is
    at any time the beginning of what was written to it. Who writes looks at `pending`.
    """

    def __init__(self, path: Path) -> None:
        """Raises OSError; FileExistsError where there is such a file."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._fd = os.open(path, flags, 0o644)
        with suppress(OSError):  # not every file system has locks
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._pending = bytearray()
        self.written = 0
        """Bytes that the operating system has taken."""
        self.failed = ""
        """Why it does not take more; empty: it does."""
        self.deleted = False
        """Whether its name is gone, as of the last `sync`."""

    @property
    def pending(self) -> int:
        """Bytes that wait."""
        return len(self._pending)

    def write(self, data: bytes) -> int:
        """Take all of `data`."""
        self._pending += data
        if len(self._pending) >= _WRITE_FROM and not self.failed:
            self.flush()
        return len(data)

    def tell(self) -> int:
        """Where the next byte will stand."""
        return self.written + len(self._pending)

    def flush(self) -> None:
        """Hand what waits to the operating system, as far as it takes it."""
        try:
            while self._pending:
                taken = os.write(self._fd, self._pending)
                self.written += taken
                del self._pending[:taken]
            self.failed = "the file was deleted" if self.deleted else ""
        except OSError as error:
            self.failed = error.strerror or str(error)

    def sync(self) -> None:
        """Wait until the disk has what was handed over."""
        try:
            os.fdatasync(self._fd)
            if os.fstat(self._fd).st_nlink == 0:
                self.deleted, self.failed = True, "the file was deleted"
        except OSError as error:
            self.failed = error.strerror or str(error)

    def close(self) -> None:
        """Give up what still waits."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def sync_folder(folder: Path) -> None:
    """Make a new name in `folder` outlive a power cut. Raises OSError."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


_CHUNK_BYTES: Final = 1 << 20
_COMPRESSION: Final = "zstd"
COMPRESSION_LEVEL: Final = 1
"""Half the work of the library's 3, and recordings are no larger."""
_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
"""Opcode, length of what follows; channel, sequence, log time, publish time."""
_RECORD_HEAD_BYTES: Final = 9
_SCHEMAS_EVERY: Final = 32
"""Chunks. All channels are declared in 250 bytes, all schemas in 1.5 kB: in every chunk they would
be a fifth of a recording."""
_MESSAGE_FIELDS_BYTES: Final = _MESSAGE_HEAD.size - _RECORD_HEAD_BYTES
_MESSAGE: Final = int(Opcode.MESSAGE)
_INDEX_HEAD: Final = struct.Struct("<BQHI")
"""Opcode, length of what follows; channel, bytes of the entries."""
_INDEX_FIELDS_BYTES: Final = _INDEX_HEAD.size - _RECORD_HEAD_BYTES
_ENTRY_NUMBERS: Final = 2
"""Of an index: log time, and offset in the chunk."""
_FOOTER_START: Final = struct.Struct("<BQQQ")
_FOOTER_BYTES: Final = 8 + 8 + 4


class Output(Protocol):
    """Where the file goes."""

    def write(self, data: bytes) -> int:
        """Take all of `data`."""
        ...

    def tell(self) -> int:
        """Where the next byte will stand."""
        ...

    def flush(self) -> None:
        """Hand on what waits."""
        ...


class _Chunk:
    """The chunk that is being filled. entries: of each channel's index, one after the other."""

    __slots__ = ("data", "entries")

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """The next one, empty."""
        self.data = bytearray()
        self.entries: defaultdict[int, list[int]] = defaultdict(list)


class McapChannel:
    """One channel of a file."""

    __slots__ = ("_chunk", "_end_chunk", "_number", "sequence")

    def __init__(self, number: int, chunk: _Chunk, end_chunk: Callable[[], None]) -> None:
        self._number = number
        self._chunk = chunk
        self._end_chunk = end_chunk
        self.sequence = 0
        """Number of the next message."""

    def add(self, wall_ns: int, payload: bytes) -> None:
        """Add a message, logged and published at this date."""
        chunk, number, sequence = self._chunk, self._number, self.sequence
        data, entries = chunk.data, chunk.entries[number]
        entries += (wall_ns, len(data))
        length = _MESSAGE_FIELDS_BYTES + len(payload)
        data += _MESSAGE_HEAD.pack(_MESSAGE, length, number, sequence, wall_ns, wall_ns)
        data += payload
        self.sequence = sequence + 1
        if len(data) > _CHUNK_BYTES:
            self._end_chunk()


class McapFile:
    """A file in chunks, compressed and indexed."""

    def __init__(self, output: Output, library: str, repeat: bool = False) -> None:
        """library: who writes this, for readers that care.

        repeat: declare all channels at the beginning of every chunk and all schemas in every 32nd,
        so that damage to one chunk costs what is in it, and not what it is needed for.
        """
        self._output = output
        self._repeat = repeat
        self._compressor = zstandard.ZstdCompressor(COMPRESSION_LEVEL)
        self._chunk = _Chunk()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk_indices: list[ChunkIndex] = []
        self._metadata_indices: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._first_ns = self._last_ns = 0
        output.write(MCAP0_MAGIC)
        output.write(_encoded(Header(profile="", library=library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """A new schema's number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._add_record(_encoded(schema))
        return schema.id

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> McapChannel:
        """A new channel. encoding: of its messages. schema: 0 for none."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata or {}),
            schema_id=schema,
        )
        self._channels.append(channel)
        self._add_record(_encoded(channel))
        return McapChannel(number, self._chunk, self._end_chunk)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Stands before what is still in the open chunk."""
        offset, record = self._output.tell(), _encoded(Metadata(name=name, metadata=dict(values)))
        self._output.write(record)
        self._metadata_indices.append(MetadataIndex(offset=offset, length=len(record), name=name))

    def flush(self) -> None:
        """End the chunk: what was written so far can be read from now on."""
        self._end_chunk()
        self._output.flush()

    def finish(self) -> None:
        """Write the summary. Nothing can be added any more."""
        self._end_chunk()
        self._output.write(_encoded(DataEnd(0)))
        begins = self._output.tell()
        summary, offsets = bytearray(), bytearray()
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunk_indices),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, self._metadata_indices),
        ):
            group = b"".join(map(_encoded, records))
            offset = SummaryOffset(
                group_length=len(group), group_opcode=opcode, group_start=begins + len(summary)
            )
            offsets += _encoded(offset)
            summary += group
        offsets_begin = begins + len(summary)
        summary += offsets
        start = _FOOTER_START.pack(Opcode.FOOTER, _FOOTER_BYTES, begins, offsets_begin)
        checksum = zlib.crc32(start, zlib.crc32(summary))
        self._output.write(bytes(summary))
        self._output.write(_encoded(_footer(begins, offsets_begin, checksum)))
        self._output.write(MCAP0_MAGIC)

    def _add_record(self, record: bytes) -> None:
        self._chunk.data += record
        if len(self._chunk.data) > _CHUNK_BYTES:
            self._end_chunk()

    def _end_chunk(self) -> None:
        """A chunk without messages stays open."""
        data, entries = self._chunk.data, self._chunk.entries
        if not entries:
            return
        self._chunk.begin()
        if self._repeat:
            self._declare_again()
        first_ns = min(min(numbers[::_ENTRY_NUMBERS]) for numbers in entries.values())
        last_ns = max(max(numbers[::_ENTRY_NUMBERS]) for numbers in entries.values())
        self._count(entries, first_ns, last_ns)
        compressed = self._compressor.compress(data)
        record = _encoded(
            Chunk(
                compression=_COMPRESSION,
                data=compressed,
                message_end_time=last_ns,
                message_start_time=first_ns,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        starts = self._output.tell()
        self._output.write(record)
        indices, places = bytearray(), {}
        for channel, numbers in entries.items():
            places[channel] = starts + len(record) + len(indices)
            size = 8 * len(numbers)
            indices += _INDEX_HEAD.pack(
                Opcode.MESSAGE_INDEX, _INDEX_FIELDS_BYTES + size, channel, size
            )
            indices += struct.pack(f"<{len(numbers)}Q", *numbers)
        self._output.write(bytes(indices))
        self._chunk_indices.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=starts,
                compression=_COMPRESSION,
                compressed_size=len(compressed),
                message_end_time=last_ns,
                message_index_length=len(indices),
                message_index_offsets=places,
                message_start_time=first_ns,
                uncompressed_size=len(data),
            )
        )

    def _declare_again(self) -> None:
        chunks = len(self._chunk_indices) + 1
        schemas = self._schemas if chunks % _SCHEMAS_EVERY == 0 else []
        for record in (*schemas, *self._channels):
            self._chunk.data += _encoded(record)

    def _count(self, entries: Mapping[int, list[int]], first_ns: int, last_ns: int) -> None:
        first = not self._counts
        self._first_ns = first_ns if first else min(self._first_ns, first_ns)
        self._last_ns = max(self._last_ns, last_ns)
        for channel, numbers in entries.items():
            count = len(numbers) // _ENTRY_NUMBERS
            self._counts[channel] = self._counts.get(channel, 0) + count

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunk_indices),
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns,
            metadata_count=len(self._metadata_indices),
            schema_count=len(self._schemas),
        )


def _footer(begins: int, offsets_begin: int, checksum: int) -> Footer:
    return Footer(summary_start=begins, summary_offset_start=offsets_begin, summary_crc=checksum)


def _encoded(record: Any) -> bytes:
    """Any of the library's records."""
    builder = RecordBuilder()
    record.write(builder)
    encoded: bytes = builder.end()  # type: ignore[no-untyped-call]
    return encoded
