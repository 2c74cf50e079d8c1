"""Whatever bytes come, in whatever pieces: sound replies come out, damaged ones never do."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aurora.codec.replies import (
    MAX_REPLY_BYTES,
    BinaryReply,
    CodedReply,
    DamagedReply,
    Reply,
    TextReply,
    coded_reply,
    encode_binary_reply,
    encode_error,
    encode_text_reply,
)
from drivers.aurora.codec.reply_reader import ReplyReader
from tests.drivers.aurora.golden import BX, REPLIES, TX

texts = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=80)
replies = st.one_of(texts.map(TextReply), st.binary(max_size=120).map(BinaryReply))


def on_the_wire(reply: Reply) -> bytes:
    if isinstance(reply, TextReply):
        return encode_text_reply(reply.text)
    assert isinstance(reply, BinaryReply)
    return encode_binary_reply(reply.body)


@pytest.mark.parametrize(("text", "digits"), REPLIES.items())
def test_known_text_replies_both_ways(text: str, digits: str) -> None:
    data = f"{text}{digits}\r".encode()
    assert encode_text_reply(text) == data
    assert ReplyReader().feed(data) == [TextReply(text)]


@pytest.mark.parametrize("name", BX)
def test_known_binary_replies_are_framed_by_their_length(name: str) -> None:
    data, _ = BX[name]
    (reply,) = ReplyReader().feed(data)
    assert isinstance(reply, BinaryReply)
    assert encode_binary_reply(reply.body) == data


@given(st.lists(replies, max_size=6), st.data())
def test_replies_come_out_as_they_went_in_however_they_are_cut(
    sent: list[Reply], data: st.DataObject
) -> None:
    stream = b"".join(map(on_the_wire, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    reader = ReplyReader()
    found: list[Reply] = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += reader.feed(stream[start:end])
    assert found == sent
    assert reader.pending == reader.noise_bytes == 0


@pytest.mark.parametrize("data", [*(d for d, _ in BX.values()), *(d for d, _ in TX.values())])
def test_no_flipped_bit_is_ever_accepted(data: bytes) -> None:
    for bit in range(8 * len(data)):
        broken = bytearray(data)
        broken[bit // 8] ^= 1 << bit % 8
        found = ReplyReader().feed(bytes(broken))
        assert not any(isinstance(reply, TextReply | BinaryReply) for reply in found), bit


@pytest.mark.parametrize(
    "noise", [b"\x80", b"\xff\x00\xfe", b"\xc4", b"\xc4\x81", b"\r", b"\x00\r"]
)
@pytest.mark.parametrize("data", [encode_text_reply("OKAY"), BX["both valid"][0]])
def test_noise_before_a_reply_does_not_hide_it(noise: bytes, data: bytes) -> None:
    reader = ReplyReader()
    assert len(reader.feed(noise + data)) == 1
    assert reader.noise_bytes == len(noise)


def test_text_that_is_cut_off_by_a_binary_reply_is_dropped_as_noise() -> None:
    reader = ReplyReader()
    assert reader.feed(b"OKA" + BX["no handles"][0]) == [BinaryReply(bytes(3))]
    assert reader.noise_bytes == 3


def test_a_device_that_restarts_in_the_middle_of_a_binary_reply_is_heard() -> None:
    data = BX["both valid"][0]
    for cut in range(1, 94):
        found = ReplyReader().feed(data[:cut] + encode_text_reply("RESET"))
        assert found[-1] == TextReply("RESET"), cut
        assert not any(isinstance(reply, BinaryReply) for reply in found), cut


def test_a_device_that_restarts_in_the_middle_of_a_text_reply_is_heard() -> None:
    data = TX["both valid"][0]
    for cut in range(1, 151):
        found = ReplyReader().feed(data[:cut] + encode_text_reply("RESET"))
        assert found[-1] == TextReply("RESET"), cut


def test_a_wrong_checksum_gives_one_damaged_reply_and_the_next_reply_is_read() -> None:
    reader = ReplyReader()
    assert reader.feed(b"OKAYA897\r" + encode_text_reply("OKAY")) == [
        DamagedReply("the reply's checksum is wrong", b"OKAYA897\r"),
        TextReply("OKAY"),
    ]


@given(st.binary(max_size=3000))
def test_any_bytes_are_digested(data: bytes) -> None:
    reader = ReplyReader()
    for start in range(0, len(data), 7):
        reader.feed(data[start : start + 7])
        assert reader.pending <= MAX_REPLY_BYTES
    reader.clear()
    assert reader.feed(encode_text_reply("OKAY")) == [TextReply("OKAY")]


def test_a_reply_without_an_end_takes_bounded_room() -> None:
    reader = ReplyReader()
    found: list[Any] = []
    for _ in range(100):
        found += reader.feed(b"x" * 1000)
        assert reader.pending <= MAX_REPLY_BYTES
    assert found and all(isinstance(reply, DamagedReply) for reply in found)


def test_errors_and_warnings_are_told_from_other_text() -> None:
    assert encode_error(0x0C) == b"ERROR0C4E42\r"
    assert coded_reply("ERROR0C") == CodedReply(0x0C, is_warning=False)
    assert coded_reply("WARNING02") == CodedReply(0x02, is_warning=True)
    assert coded_reply("ERROR0C0") is coded_reply("OKAY") is coded_reply("ERRORxx") is None
