"""Commands as bytes and back, from a client's and from the device's side."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aurora.codec.commands import (
    BAUD_CODES,
    MAX_COMMAND_BYTES,
    AuroraCommand,
    CommandReader,
    LineSettings,
    decode_command,
    decode_line_settings,
    encode_command,
    encode_line_settings,
)
from drivers.aurora.codec.crc import crc16
from drivers.aurora.codec.errors import CodecError
from tests.drivers.aurora.golden import COMMANDS

words = st.from_regex(r"[A-Z][A-Z0-9]{0,9}", fullmatch=True)
arguments = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=60)


@pytest.mark.parametrize(("text", "digits"), COMMANDS.items())
def test_known_commands_both_ways(text: str, digits: str) -> None:
    word, _, rest = text.partition(":")
    assert encode_command(word, rest) == f"{text}{digits}\r".encode()
    assert decode_command(f"{text}{digits}".encode()) == AuroraCommand(word, rest)


@given(words, arguments)
def test_a_command_comes_back_as_it_was(word: str, rest: str) -> None:
    assert decode_command(encode_command(word, rest)[:-1]) == AuroraCommand(word, rest)


@given(words, arguments)
def test_a_command_without_checksum_comes_back_as_it_was(word: str, rest: str) -> None:
    assert decode_command(f"{word} {rest}".encode()) == AuroraCommand(word, rest)


@pytest.mark.parametrize("text", [b"pinit:0a", b"PINIT:0a", b"Pinit:0A"])
def test_case_does_not_matter(text: bytes) -> None:
    with_checksum = text + b"%04x" % crc16(text)
    assert decode_command(with_checksum).word == "PINIT"
    assert decode_command(text.replace(b":", b" ")).word == "PINIT"


@given(words, arguments, st.data())
def test_a_command_with_one_flipped_bit_is_never_taken_for_what_it_was(
    word: str, rest: str, data: st.DataObject
) -> None:
    line = bytearray(encode_command(word, rest)[:-1])
    bit = data.draw(st.integers(0, 8 * len(line) - 1))
    line[bit // 8] ^= 1 << bit % 8
    try:
        command = decode_command(bytes(line))
    except CodecError:
        return
    # Hex digits may change their case; a word that a space now ends has no checksum.
    assert command == AuroraCommand(word, rest) or line[len(command.word)] == ord(" ")


@pytest.mark.parametrize(
    "line", [b"", b":E3A5", b"INIT", b"INIT;E3A5", b"1NIT ", b"INIT \xff", b"A" * 2000]
)
def test_what_is_no_command_is_refused(line: bytes) -> None:
    with pytest.raises(CodecError) as raised:
        decode_command(line)
    assert not raised.value.bad_crc


@pytest.mark.parametrize("line", [b"INIT:", b"INIT:E3A4", b"INIT:E3", b"INIT:ZZZZ"])
def test_a_wrong_checksum_is_named_as_such(line: bytes) -> None:
    with pytest.raises(CodecError) as raised:
        decode_command(line)
    assert raised.value.bad_crc


@given(st.lists(st.binary(max_size=40).filter(lambda b: b"\r" not in b)), st.data())
def test_the_reader_finds_the_same_lines_in_whatever_pieces_they_come(
    lines: list[bytes], data: st.DataObject
) -> None:
    stream = b"".join(line + b"\r" for line in lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    reader = CommandReader()
    found = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += reader.feed(stream[start:end])
    assert found == lines
    assert reader.pending == 0


def test_a_line_without_an_end_takes_no_more_room_than_a_command() -> None:
    reader = CommandReader()
    for _ in range(100):
        assert reader.feed(b"x" * 1000) == []
    assert reader.pending == MAX_COMMAND_BYTES + 1
    (line,) = reader.feed(b"\r")
    with pytest.raises(CodecError, match="at most"):
        decode_command(line)


@pytest.mark.parametrize("baud_rate", BAUD_CODES)
@pytest.mark.parametrize("hardware_handshake", [False, True])
def test_line_settings_both_ways(baud_rate: int, hardware_handshake: bool) -> None:
    settings = LineSettings(baud_rate, 8, "none", 1, hardware_handshake)
    assert decode_line_settings(encode_line_settings(settings)) == settings


def test_odd_line_settings_both_ways() -> None:
    assert decode_line_settings("51210") == LineSettings(115200, 7, "even", 2, False)
    assert encode_line_settings(LineSettings(115200, 7, "even", 2, False)) == "51210"


@pytest.mark.parametrize(
    "text", ["", "5000", "500000", "70000", "B0000", "52000", "50300", "x0000"]
)
def test_line_settings_that_no_aurora_has(text: str) -> None:
    with pytest.raises(CodecError):
        decode_line_settings(text)
