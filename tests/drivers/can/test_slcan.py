"""SLCAN lines, both directions."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.frame import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, CanFrame
from drivers.can.slcan import (
    BEL,
    MAX_LINE_BYTES,
    AdapterStatus,
    Close,
    Done,
    Empty,
    LineReader,
    Open,
    Queued,
    ReadSerialNumber,
    ReadStatus,
    ReadVersion,
    Received,
    Refused,
    Reply,
    SerialNumber,
    SetBitRate,
    SetBitTiming,
    SetTimestamps,
    SlcanCommand,
    SlcanError,
    Transmit,
    Version,
    decode_command,
    decode_data_frame,
    decode_reply,
    encode_command,
    encode_frame,
    encode_reply,
)

COMMANDS: list[tuple[bytes, SlcanCommand]] = [
    (b"t18121122\r", Transmit(CanFrame(0x181, b"\x11\x22"))),
    (b"t0000\r", Transmit(CanFrame(0x000))),
    (b"T18DAF1103001122\r", Transmit(CanFrame(0x18DAF110 | EXTENDED_FLAG, b"\x00\x11\x22"))),
    (b"r7018\r", Transmit(CanFrame(0x701 | REMOTE_FLAG, bytes(8)))),
    (b"R000007010\r", Transmit(CanFrame(0x701 | REMOTE_FLAG | EXTENDED_FLAG))),
    (b"S8\r", SetBitRate(1_000_000)),
    (b"S6\r", SetBitRate(500_000)),
    (b"S0\r", SetBitRate(10_000)),
    (b"s031C\r", SetBitTiming(0x03, 0x1C)),
    (b"O\r", Open()),
    (b"L\r", Open(listen_only=True)),
    (b"C\r", Close()),
    (b"F\r", ReadStatus()),
    (b"V\r", ReadVersion()),
    (b"N\r", ReadSerialNumber()),
    (b"Z1\r", SetTimestamps(True)),
    (b"Z0\r", SetTimestamps(False)),
    (b"\r", Empty()),
]

REPLIES: list[tuple[bytes, Reply]] = [
    (b"t18121122\r", Received(CanFrame(0x181, b"\x11\x22"))),
    (b"t18121122EA5F\r", Received(CanFrame(0x181, b"\x11\x22"), 59_999)),
    (b"T0000018120A0B0001\r", Received(CanFrame(0x181 | EXTENDED_FLAG, b"\x0a\x0b"), 1)),
    (b"r70100010\r", Received(CanFrame(0x701 | REMOTE_FLAG), 0x10)),
    (b"\r", Done()),
    (b"\a", Refused()),
    (b"z\r", Queued()),
    (b"Z\r", Queued(extended=True)),
    (b"F24\r", AdapterStatus(0x24)),
    (b"V1013\r", Version(10, 13)),
    (b"NA123\r", SerialNumber("A123")),
]


@pytest.mark.parametrize(("line", "command"), COMMANDS)
def test_commands(line: bytes, command: SlcanCommand) -> None:
    assert encode_command(command) == line
    assert decode_command(line[:-1]) == command


@pytest.mark.parametrize(("line", "reply"), REPLIES)
def test_replies(line: bytes, reply: Reply) -> None:
    assert encode_reply(reply) == line
    assert decode_reply(BEL if line == BEL else line[:-1]) == reply


@pytest.mark.parametrize(
    "line",
    [
        b"t1812112",  # half a byte
        b"t181211",  # less data than its length
        b"t1812112233",  # more
        b"t8000",  # no 11-bit identifier
        b"T200000000",  # no 29-bit identifier
        b"t1819112233445566778899",  # nine bytes
        b"t18",
        b"S9",
        b"S",
        b"Sx",
        b"s12",
        b"X",
        b"O1",
        b"Z2",
        b"\xff\xfe",
        b"t181\xb21122",
    ],
)
def test_what_is_no_command_is_refused_with_the_line_shown(line: bytes) -> None:
    with pytest.raises(SlcanError) as raised:
        decode_command(line)
    assert repr(line)[2:-1] in str(raised.value)


@pytest.mark.parametrize("line", [b"F", b"F1", b"V10", b"N", b"t1812112", b"t18121122123", b"q"])
def test_what_is_no_reply_is_refused(line: bytes) -> None:
    with pytest.raises(SlcanError):
        decode_reply(line)


def test_a_frame_that_slcan_cannot_carry_is_refused() -> None:
    with pytest.raises(SlcanError):
        encode_frame(CanFrame(ERROR_FLAG | 0x40, bytes(8)))
    with pytest.raises(SlcanError):
        encode_frame(CanFrame(0x181, bytes(9)))


def test_a_bit_rate_that_slcan_does_not_have_is_refused_with_those_it_has() -> None:
    with pytest.raises(SlcanError, match="1000000"):
        encode_command(SetBitRate(123_456))


frames = st.builds(
    CanFrame,
    st.one_of(
        st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF).map(lambda number: number | EXTENDED_FLAG)
    ),
    st.binary(max_size=8),
)


@given(frames, st.none() | st.integers(0, 59_999))
def test_frames_survive_the_line(frame: CanFrame, timestamp_ms: int | None) -> None:
    line = encode_reply(Received(frame, timestamp_ms))
    assert decode_reply(line[:-1]) == Received(frame, timestamp_ms)
    assert len(line) <= MAX_LINE_BYTES + 1


@given(
    st.builds(CanFrame, st.integers(0, 0xFF), st.binary(max_size=8)),
    st.integers(0, 20),
    st.integers(0, 7),
)
def test_a_wrong_bit_does_not_pass_the_quick_way_where_it_is_refused_on_the_other(
    frame: CanFrame, place: int, bit: int
) -> None:
    line = bytearray(encode_frame(frame)[:-1])
    line[place % len(line)] ^= 1 << bit
    found = decode_data_frame(bytes(line))
    if found is not None:
        assert decode_reply(bytes(line)) == Received(found)


def test_the_8_of_an_identifier_with_a_wrong_bit_is_no_digit() -> None:
    assert decode_data_frame(b"t08121122") == CanFrame(0x081, b"\x11\x22")
    assert decode_data_frame(b"t0x121122") is None


@given(st.binary(max_size=40))
def test_any_bytes_are_a_command_or_an_error(line: bytes) -> None:
    for decode in (decode_command, decode_reply):
        with suppress(SlcanError):
            decode(line)


@given(st.lists(st.sampled_from([line for line, _ in COMMANDS + REPLIES]), max_size=20), st.data())
def test_lines_come_out_whole_however_the_stream_is_cut(
    lines: list[bytes], data: st.DataObject
) -> None:
    stream = b"".join(lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    reader = LineReader()
    got: list[bytes] = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        got += reader.feed(stream[start:end])
    assert got == [line if line == BEL else line[:-1] for line in lines]


def test_a_line_without_end_takes_no_memory_and_is_no_command() -> None:
    reader = LineReader()
    assert list(reader.feed(b"t" * 100_000)) == []
    assert len(reader._line) <= MAX_LINE_BYTES + 1
    (line,) = reader.feed(b"\r")
    with pytest.raises(SlcanError):
        decode_command(line)
    assert list(reader.feed(b"O\r")) == [b"O"]


def test_a_bell_in_a_line_ends_it() -> None:
    assert list(LineReader().feed(b"t18\aO\r")) == [BEL, b"O"]
