"""The kernel's bytes, in pieces of any length, become reports."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.steering.input_events import (
    EV_KEY,
    EV_REL,
    EV_SYN,
    EVENT,
    SYN_DROPPED,
    EventStream,
    InputEvent,
    Report,
    packed,
)

EVENTS = st.builds(
    InputEvent,
    st.integers(1, 3),
    st.integers(0, 0x2FF),
    st.integers(-(2**31), 2**31 - 1),
)


def test_an_event_is_as_long_as_the_kernel_has_it() -> None:
    assert EVENT.size == struct.calcsize("l") * 2 + 8


@given(
    reports=st.lists(st.lists(EVENTS, max_size=5), max_size=5), cuts=st.lists(st.integers(0, 700))
)
def test_reports_come_whole_however_their_bytes_are_cut(
    reports: list[list[InputEvent]], cuts: list[int]
) -> None:
    data = b"".join(packed(7_000, *events) for events in reports)
    stream, found, last = EventStream(), [], 0
    for cut in [*sorted(min(cut, len(data)) for cut in cuts), len(data)]:
        found += stream.feed(data[last:cut])
        last = cut
    assert found == [Report(tuple(events)) for events in reports]


def test_nothing_is_reported_before_it_is_whole() -> None:
    data = packed(0, InputEvent(EV_KEY, 256, 1))
    stream = EventStream()
    assert stream.feed(data[:-1]) == []
    assert stream.feed(data[-1:]) == [Report((InputEvent(EV_KEY, 256, 1),))]


@pytest.mark.parametrize("before", [0, 1, 3])
def test_lost_events_are_told_with_the_next_report(before: int) -> None:
    lost = EVENT.pack(0, 0, EV_SYN, SYN_DROPPED, 0)
    events = [InputEvent(EV_REL, 0, 5)] * before
    data = b"".join(EVENT.pack(0, 0, *event) for event in events) + lost + packed(0)
    assert EventStream().feed(data) == [Report(tuple(events), lost=True)]


def test_a_report_without_an_end_takes_no_room_without_end() -> None:
    stream = EventStream()
    stream.feed(EVENT.pack(0, 0, EV_REL, 0, 1) * 100_000)
    (report,) = stream.feed(packed(0))
    assert len(report.events) <= 256
    assert report.lost
