"""Values of objects as bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.codec.data_types import DataType, Value, decode_value, encode_value
from drivers.canopen.codec.error import CodecError


@pytest.mark.parametrize(
    ("data_type", "value", "data"),
    [
        (DataType.BOOLEAN, 1, "01"),
        (DataType.UNSIGNED8, 200, "c8"),
        (DataType.INTEGER8, -3, "fd"),
        (DataType.UNSIGNED16, 0x1234, "3412"),
        (DataType.INTEGER16, -2, "feff"),
        (DataType.UNSIGNED32, 0x65766173, "73617665"),
        (DataType.INTEGER32, -(2**31), "00000080"),
        (DataType.VISIBLE_STRING, b"save", "73617665"),
        (DataType.DOMAIN, b"", ""),
    ],
)
def test_values(data_type: DataType, value: Value, data: str) -> None:
    assert encode_value(data_type, value).hex() == data
    assert decode_value(data_type, bytes.fromhex(data)) == value


@pytest.mark.parametrize(
    ("data_type", "value"),
    [
        (DataType.UNSIGNED8, 256),
        (DataType.UNSIGNED16, -1),
        (DataType.INTEGER8, 128),
        (DataType.UNSIGNED8, b"\x01"),
        (DataType.VISIBLE_STRING, 1),
    ],
)
def test_values_that_do_not_fit(data_type: DataType, value: Value) -> None:
    with pytest.raises(CodecError):
        encode_value(data_type, value)


@pytest.mark.parametrize("data", [b"", b"\x01", b"\x01\x02\x03"])
def test_wrong_length(data: bytes) -> None:
    with pytest.raises(CodecError, match="2 bytes"):
        decode_value(DataType.UNSIGNED16, data)


@given(st.sampled_from([t for t in DataType if t.size]), st.data())
def test_roundtrip(data_type: DataType, data: st.DataObject) -> None:
    assert data_type.size is not None
    drawn = data.draw(st.binary(min_size=data_type.size, max_size=data_type.size))
    assert encode_value(data_type, decode_value(data_type, drawn)) == drawn
