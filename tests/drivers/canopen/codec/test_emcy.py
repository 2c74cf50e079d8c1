"""Emergency messages, the short ones of sloppy devices too."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.codec.emcy import (
    FOLLOWING_ERROR,
    Emergency,
    ErrorRegister,
    decode_emergency,
    emergency_text,
)
from drivers.canopen.codec.error import CodecError

GOLDEN = [
    ("1186210102030405", Emergency(0x8611, 0x21, b"\x01\x02\x03\x04\x05")),
    ("3081110000000000", Emergency(0x8130, 0x11, bytes(5))),
    ("0000000000000000", Emergency(0x0000, 0x00, bytes(5))),
]


@pytest.mark.parametrize(("data", "emergency"), GOLDEN)
def test_messages(data: str, emergency: Emergency) -> None:
    assert emergency.encode().hex() == data
    assert decode_emergency(bytes.fromhex(data)) == emergency


def test_vendor_bytes_are_filled_up() -> None:
    assert Emergency(FOLLOWING_ERROR, ErrorRegister.GENERIC, b"\x07").encode().hex() == (
        "1186010700000000"
    )


@pytest.mark.parametrize(
    ("data", "code", "register"),
    [("1186", 0x8611, 0), ("118601", 0x8611, 1), ("11860101", 0x8611, 1)],
)
def test_what_a_short_message_lacks_is_zero(data: str, code: int, register: int) -> None:
    emergency = decode_emergency(bytes.fromhex(data))
    assert (emergency.code, emergency.register) == (code, register)
    assert len(emergency.vendor) == 5


@pytest.mark.parametrize("length", [0, 1, 9])
def test_no_emergency(length: int) -> None:
    with pytest.raises(CodecError, match="8 bytes"):
        decode_emergency(bytes(length))


@pytest.mark.parametrize(
    "emergency", [Emergency(0x10000), Emergency(-1), Emergency(0, 256), Emergency(0, 0, bytes(6))]
)
def test_what_does_not_fit(emergency: Emergency) -> None:
    with pytest.raises(CodecError, match="fit"):
        emergency.encode()


def test_the_end_of_an_error_is_told_apart() -> None:
    assert Emergency(0x0000).error_gone
    assert not Emergency(0x1000).error_gone


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x8611, "following error"),
        (0x8130, "heartbeat or life guarding lost"),
        (0x3220, "DC-link under-voltage"),
        (0x8650, "positioning control"),
        (0x4321, "temperature"),
        (0xFF42, "device specific"),
        (0x0212, "unknown error"),
    ],
)
def test_texts_say_what_is_known(code: int, text: str) -> None:
    assert emergency_text(code) == text
    assert text in str(Emergency(code))


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFF), st.binary(min_size=5, max_size=5))
def test_roundtrip(code: int, register: int, vendor: bytes) -> None:
    emergency = Emergency(code, register, vendor)
    assert decode_emergency(emergency.encode()) == emergency
