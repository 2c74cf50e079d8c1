"""The checksum is CRC-16/ARC."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aurora.codec.crc import crc16
from tests.drivers.aurora.golden import COMMANDS, REPLIES


def one_bit_at_a_time(data: bytes) -> int:
    register = 0
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ (0xA001 if register & 1 else 0)
    return register


def test_the_catalogue_s_check_value() -> None:
    assert crc16(b"123456789") == 0xBB3D


@pytest.mark.parametrize(("text", "digits"), (COMMANDS | REPLIES).items())
def test_known_commands_and_replies(text: str, digits: str) -> None:
    assert crc16(text.encode()) == int(digits, 16)


@given(st.binary(max_size=300))
def test_many_bits_a_step_give_what_a_bit_a_step_gives(data: bytes) -> None:
    assert crc16(data) == one_bit_at_a_time(data)


@given(st.binary(max_size=50))
def test_a_checksum_appended_low_byte_first_brings_the_register_to_zero(data: bytes) -> None:
    assert crc16(data + crc16(data).to_bytes(2, "little")) == 0
