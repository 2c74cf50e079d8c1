"""OpenIGTLink's frame: the same bytes as an independent implementation, and no trust in bytes."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.bridges.openigtlink.framing import (
    HEADER_BYTES,
    Deframer,
    Frame,
    FramingError,
    crc64,
    packed,
)

NAMES = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=12)
DATES = st.integers(0, 4_000_000_000 * 10**9)
FRAMES = st.builds(
    Frame,
    kind=NAMES,
    device=NAMES,
    content=st.binary(max_size=300),
    date_ns=DATES,
    metadata=st.dictionaries(st.text(max_size=20), st.text(max_size=20), max_size=4),
    number=st.integers(0, 2**32 - 1),
)


def test_the_checksum_is_that_of_ecma_182() -> None:
    """The catalogue of parametrised CRC algorithms gives this one for `CRC-64/ECMA-182`."""
    assert crc64(b"123456789") == 0x6C40DF5F0B497347


@given(st.lists(FRAMES, max_size=4), st.sampled_from([1, 2]), st.data())
def test_frames_come_back_however_their_bytes_arrive(
    frames: list[Frame], version: int, data: st.DataObject
) -> None:
    stream = b"".join(packed(frame, version) for frame in frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    deframer, came = Deframer(), list[Frame]()
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        came += deframer.feed(stream[begin:end])
    kept = frames
    if version == 1:  # which has neither
        kept = [Frame(f.kind, f.device, f.content, f.date_ns) for f in frames]
    assert came == kept


@given(st.binary(max_size=400))
def test_any_bytes_are_frames_or_refused(data: bytes) -> None:
    with suppress(FramingError):
        list(Deframer().feed(data))


@given(FRAMES, st.data())
def test_a_damaged_body_is_refused(frame: Frame, data: st.DataObject) -> None:
    whole = bytearray(packed(frame, 2))
    at = data.draw(st.integers(HEADER_BYTES, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    with pytest.raises(FramingError, match="checksum"):
        list(Deframer().feed(bytes(whole)))


@given(FRAMES, st.data())
def test_parts_of_a_body_that_lie_about_their_size_are_refused(
    frame: Frame, data: st.DataObject
) -> None:
    """With a checksum that is right: whoever sent it meant it."""
    body = bytearray(packed(frame, 2)[HEADER_BYTES:])
    body[data.draw(st.integers(0, 7))] ^= data.draw(st.integers(1, 255))
    again = bytearray(packed(Frame(frame.kind, frame.device, bytes(body), frame.date_ns), 1))
    again[0:2] = b"\0\2"
    try:
        (came,) = Deframer().feed(bytes(again))
    except FramingError:
        return
    assert len(came.content) <= len(body)


@pytest.mark.parametrize("text", ["Ümlaut", "a\0b", "a name of twenty-one x"])
def test_a_name_that_has_no_place_in_a_header_is_refused(text: str) -> None:
    with pytest.raises(FramingError, match="no name"):
        packed(Frame("STRING", text))


def test_a_body_that_would_fill_the_memory_is_refused_before_it_comes() -> None:
    head = bytearray(packed(Frame("TRANSFORM", "Tip")))
    head[42:50] = (1 << 40).to_bytes(8, "big")
    with pytest.raises(FramingError, match="a body of"):
        list(Deframer().feed(bytes(head)))


@pytest.mark.parametrize("piece", [1, 57, 1000, 1 << 20])
def test_a_body_that_is_too_long_is_passed_over(piece: int) -> None:
    long, short = Frame("IMAGE", "Slice", bytes(3000)), Frame("GET_STATUS", "")
    stream = b"".join(map(packed, (short, long, long, short)))
    deframer, came = Deframer(most_body_bytes=1000), list[Frame]()
    for at in range(0, len(stream), piece):
        came += deframer.feed(stream[at : at + piece])
    assert came == [short, short]


def test_a_version_that_is_not_known_is_refused() -> None:
    with pytest.raises(FramingError, match="version 3"):
        list(Deframer().feed(b"\0\3" + packed(Frame("TRANSFORM", "Tip"))[2:]))
    with pytest.raises(FramingError, match="header 3"):
        packed(Frame("TRANSFORM", "Tip"), 3)


def test_metadata_without_room_is_refused() -> None:
    with pytest.raises(FramingError, match="too long"):
        packed(Frame("STRING", "a", metadata={"k" * 70_000: ""}), 2)


@given(NAMES, st.integers(0, 2_000_000_000 * 10**9), st.sampled_from([1, 2]))
def test_pyigtl_reads_the_header_as_it_was_meant(device: str, date_ns: int, version: int) -> None:
    messages = pytest.importorskip("pyigtl.messages")
    whole = packed(Frame("STRING", device, b"\0\3\0\2ok", date_ns, {"robot": "arm"}, 9), version)
    head = messages.MessageBase.parse_header(whole[:HEADER_BYTES])
    assert head["header_version"] == version and head["message_type"] == "STRING"
    assert head["device_name"] == device and head["body_size"] == len(whole) - HEADER_BYTES
    assert head["timestamp"] == pytest.approx(date_ns * 1e-9, abs=1e-6)
    message = messages.StringMessage()
    message.unpack(head, whole[HEADER_BYTES:])
    assert message.string == "ok"
    assert message.metadata == ({"robot": "arm"} if version == 2 else {})
    assert messages.CRC64(whole[HEADER_BYTES:]) == crc64(whole[HEADER_BYTES:])
