"""SYNC with and without counter."""

import pytest

from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.sync import decode_sync, encode_sync


@pytest.mark.parametrize(("counter", "data"), [(None, b""), (1, b"\x01"), (240, b"\xf0")])
def test_counter(counter: int | None, data: bytes) -> None:
    assert encode_sync(counter) == data
    assert decode_sync(data) == counter


@pytest.mark.parametrize("data", [b"\x00", b"\xf1", b"\x01\x02"])
def test_no_sync(data: bytes) -> None:
    with pytest.raises(CodecError):
        decode_sync(data)


@pytest.mark.parametrize("counter", [0, 241])
def test_no_counter(counter: int) -> None:
    with pytest.raises(CodecError, match="240"):
        encode_sync(counter)
