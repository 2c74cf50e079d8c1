"""The same file as the library writes, to the last byte, at our level of compression."""

from collections.abc import Callable
from functools import partial
from io import BytesIO
from typing import Any
from unittest.mock import patch

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from daemon.recording.format.mcap_file import COMPRESSION_LEVEL, McapFile

LIBRARY = "somebody"

message = st.tuples(st.integers(1, 3), st.integers(0, 1 << 62), st.binary(max_size=40))
orders = st.lists(st.one_of(message, st.sampled_from(["flush", "metadata"])), max_size=30)


def theirs(order: list[object], padding: int) -> bytes:
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD)
    sequences = [0, 0, 0]

    def add(channel: int, t_ns: int, payload: bytes) -> None:
        sequence = sequences[channel - 1]
        sequences[channel - 1] = sequence + 1
        writer.add_message(channels[channel - 1], t_ns, payload, t_ns, sequence)

    compress = partial(zstandard.compress, level=COMPRESSION_LEVEL)
    with patch.object(zstandard, "compress", compress):
        writer.start(library=LIBRARY)
        channels = registered(writer)
        fill(writer, add, order, padding)
    return stream.getvalue()


def ours(order: list[object], padding: int) -> bytes:
    stream = BytesIO()
    file = McapFile(stream, LIBRARY)
    channels = registered(file)

    def add(channel: int, t_ns: int, payload: bytes) -> None:
        channels[channel - 1].add(t_ns, payload)

    fill(file, add, order, padding)
    return stream.getvalue()


def registered(writer: Any) -> list[Any]:
    schema = writer.register_schema("a.Schema", "jsonschema", b"{}")
    return [
        writer.register_channel("/told", "json", schema),
        writer.register_channel("/raw", "x-raw", 0, {"of": "nobody"}),
        writer.register_channel("/more", "json", schema),
    ]


def fill(
    writer: Writer | McapFile,
    add: Callable[[int, int, bytes], None],
    order: list[object],
    padding: int,
) -> None:
    """add: takes channel, date and payload. padding: bytes that every message is longer by."""
    for number, one in enumerate(order):
        if one == "flush":
            writer.flush()  # type: ignore[no-untyped-call, unused-ignore]
        elif one == "metadata":
            writer.add_metadata("about", {"number": str(number)})
        else:
            assert isinstance(one, tuple)
            channel, t_ns, data = one
            add(channel, t_ns, data + bytes(padding))
    writer.finish()  # type: ignore[no-untyped-call, unused-ignore]


@settings(max_examples=60)
@given(orders)
def test_every_byte_is_the_librarys(order: list[object]) -> None:
    assert ours(order, 0) == theirs(order, 0)


def test_long_files_have_many_chunks_and_a_reader_finds_all_messages() -> None:
    order: list[object] = [(1 + k % 3, 1000 + k, b"%d" % k) for k in range(60)]
    written = ours(order, 100_000)
    assert written == theirs(order, 100_000)
    reader = make_reader(BytesIO(written))
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 60
    assert summary.statistics.chunk_count == pytest.approx(6, abs=1)
    found = [(channel.topic, message.data) for _, channel, message in reader.iter_messages()]
    assert [int(data[:6].rstrip(b"\0")) for _, data in found] == list(range(60))
