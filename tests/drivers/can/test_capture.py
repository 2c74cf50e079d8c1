"""CAN captures are pcap files that come back as they were written."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.capture import CaptureError, capture_header, capture_record, read_capture
from drivers.can.frame import CanFrame

frames = st.builds(
    CanFrame, can_id=st.integers(0, 0x7FF) | st.just(0x20000040), data=st.binary(max_size=8)
)


@given(st.lists(st.tuples(st.integers(0, 2**62), frames)))
def test_what_is_written_is_read(records: list[tuple[int, CanFrame]]) -> None:
    records = [(t_ns % (2**32 * 10**9), frame) for t_ns, frame in records]
    content = capture_header() + b"".join(
        capture_record(t_ns, frame.can_id, frame.data) for t_ns, frame in records
    )
    assert list(read_capture(content)) == records


def test_the_header_is_that_of_a_nanosecond_pcap_of_socketcan() -> None:
    magic, major, minor, *_, link_type = struct.unpack("<IHHiIII", capture_header())
    assert (magic, major, minor, link_type) == (0xA1B23C4D, 2, 4, 227)


def test_the_identifier_stands_big_endian() -> None:
    record = capture_record(1_000_000_002, 0x181, b"\x01\x02")
    assert record.hex() == (
        "01000000020000001000000010000000" + "0000018102000000" + "0102000000000000"
    )


def test_a_record_cut_short_by_a_crash_ends_the_file() -> None:
    content = capture_header() + capture_record(1, 0x80, b"") + capture_record(2, 0x80, b"")[:-3]
    assert [t_ns for t_ns, _ in read_capture(content)] == [1]


@pytest.mark.parametrize("content", [b"", b"\0" * 24, capture_header()[:-1]])
def test_other_files_are_refused(content: bytes) -> None:
    with pytest.raises(CaptureError):
        list(read_capture(content))
