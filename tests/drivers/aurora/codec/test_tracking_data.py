"""Tracking replies, binary and text: the same content, both ways."""

import math
import struct
from contextlib import suppress

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.replies import (
    BinaryReply,
    TextReply,
    encode_binary_reply,
    encode_text_reply,
)
from drivers.aurora.codec.reply_reader import ReplyReader
from drivers.aurora.codec.status_bits import HandleState
from drivers.aurora.codec.tracking_data import (
    ToolReading,
    TrackingData,
    decode_bx,
    decode_tx,
    encode_bx,
    encode_tx,
)
from tests.drivers.aurora.golden import BX, DISABLED_C, MISSING_B, TX

uint32 = st.integers(0, 2**32 - 1)
float32 = st.floats(width=32, allow_nan=False)
handles = st.integers(0, 255)


def readings(number: st.SearchStrategy[float]) -> st.SearchStrategy[ToolReading]:
    valid = st.builds(
        ToolReading,
        handles,
        st.just(HandleState.VALID),
        st.tuples(number, number, number, number),
        st.tuples(number, number, number),
        number,
        uint32,
        uint32,
    )
    missing = st.builds(
        ToolReading,
        handles,
        st.just(HandleState.MISSING),
        st.none(),
        st.none(),
        st.just(0.0),
        uint32,
        uint32,
    )
    disabled = handles.map(lambda handle: ToolReading(handle, HandleState.DISABLED))
    return st.one_of(valid, missing, disabled)


def data_with(number: st.SearchStrategy[float]) -> st.SearchStrategy[TrackingData]:
    several = st.lists(readings(number), max_size=5).map(tuple)
    return st.builds(TrackingData, several, st.integers(0, 0xFFFF))


@pytest.mark.parametrize("name", BX)
def test_known_binary_replies_both_ways(name: str) -> None:
    data, content = BX[name]
    (reply,) = ReplyReader().feed(data)
    assert isinstance(reply, BinaryReply)
    assert decode_bx(reply.body) == content
    assert encode_binary_reply(encode_bx(content)) == data


@pytest.mark.parametrize("name", TX)
def test_known_text_replies_both_ways(name: str) -> None:
    data, content = TX[name]
    (reply,) = ReplyReader().feed(data)
    assert isinstance(reply, TextReply)
    found = decode_tx(reply.text)
    assert found.system_status == content.system_status
    for got, expected in zip(found.readings, content.readings, strict=True):
        assert got._replace(quaternion=None, position_mm=None, indicator=0.0) == (
            expected._replace(quaternion=None, position_mm=None, indicator=0.0)
        )
        assert (got.quaternion or ()) == pytest.approx(expected.quaternion or ())
        assert (got.position_mm or ()) == pytest.approx(expected.position_mm or ())
        assert got.indicator == pytest.approx(expected.indicator)
    assert encode_text_reply(encode_tx(content)) == data


@given(data_with(float32))
def test_binary_content_comes_back_as_it_was(content: TrackingData) -> None:
    assert decode_bx(encode_bx(content)) == content


@given(data_with(st.floats(-9.0, 9.0)))
def test_text_content_comes_back_to_its_resolution(content: TrackingData) -> None:
    found = decode_tx(encode_tx(content))
    for got, expected in zip(found.readings, content.readings, strict=True):
        assert (got.quaternion or ()) == pytest.approx(expected.quaternion or (), abs=0.51e-4)
        assert (got.position_mm or ()) == pytest.approx(expected.position_mm or (), abs=0.51e-2)
        assert got.state is expected.state
        assert got.frame_number == expected.frame_number
    assert encode_tx(found) == encode_tx(decode_tx(encode_tx(found)))


def test_a_pose_that_is_not_a_number_arrives_as_such() -> None:
    """Judging it is not the codec's business; the other tools of the reply are fine."""
    broken = BX["both valid"][1].readings[0]._replace(position_mm=(math.nan, 0.0, math.inf))
    (got,) = decode_bx(encode_bx(TrackingData((broken,), 0))).readings
    assert got.position_mm is not None
    assert math.isnan(got.position_mm[0]) and math.isinf(got.position_mm[2])


@given(st.binary(max_size=200))
def test_any_binary_body_gives_content_or_the_codec_s_own_error(body: bytes) -> None:
    try:
        content = decode_bx(body)
    except CodecError:
        return
    floats = [v for r in content.readings for v in (*(r.quaternion or ()), *(r.position_mm or ()))]
    assume(not any(math.isnan(value) for value in floats))
    assert encode_bx(content) == body


@given(
    st.one_of(st.text(max_size=200), st.from_regex(r"\A0[12]([0-9A-F]{2}[ -~]{60,80}\n)+0{4}\Z"))
)
def test_any_text_gives_content_or_the_codec_s_own_error(text: str) -> None:
    with suppress(CodecError):
        decode_tx(text)


@pytest.mark.parametrize("cut", range(87))
def test_a_body_that_is_too_short_says_so(cut: int) -> None:
    (reply,) = ReplyReader().feed(BX["both valid"][0])
    assert isinstance(reply, BinaryReply)
    with pytest.raises(CodecError):
        decode_bx(reply.body[:cut])


def test_a_body_that_is_too_long_says_so() -> None:
    with pytest.raises(CodecError, match="1 bytes too many"):
        decode_bx(bytes(4))


def test_an_unknown_handle_state_is_refused() -> None:
    with pytest.raises(CodecError, match="unknown state 08"):
        decode_bx(struct.pack("<BBBH", 1, 0x0A, 0x08, 0))


def test_a_disabled_handle_may_carry_what_other_firmware_appends() -> None:
    for tail in ("DISABLED", "DISABLED0000007100000148", "UNOCCUPIED"):
        assert decode_tx(f"010C{tail}\n0000").readings == (DISABLED_C,)


@pytest.mark.parametrize("value", [10.0, -10.0, math.nan, math.inf])
def test_a_quaternion_that_does_not_fit_its_text_field_is_refused(value: float) -> None:
    reading = TX["both valid"][1].readings[0]._replace(quaternion=(value, 0.0, 0.0, 0.0))
    with pytest.raises(CodecError):
        encode_tx(TrackingData((reading,), 0))


@pytest.mark.parametrize("encode", [encode_bx, encode_tx])
def test_a_reading_without_its_parts_cannot_be_encoded(encode: object) -> None:
    assert callable(encode)
    incomplete = [
        ToolReading(0x0A, HandleState.VALID, None, None, 0.0, 0x31, 1),
        MISSING_B._replace(frame_number=None),
        MISSING_B._replace(frame_number=2**32),
        MISSING_B._replace(handle=256),
        MISSING_B._replace(port_status=-1),
    ]
    for reading in incomplete:
        with pytest.raises(CodecError):
            encode(TrackingData((reading,), 0))
