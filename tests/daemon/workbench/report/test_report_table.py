"""Columns of messages: in the order of time, as wide as the longest row, nan where nothing is."""

from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daemon.workbench.report.report_table import Column, MessageTable, number


class Message(NamedTuple):
    row: list[float] | None
    one: float | None = None


def table() -> MessageTable:
    return MessageTable(
        {
            "three": Column(lambda message: message.row, 3),
            "longest": Column(lambda message: message.row),
            "one": number(lambda message: message.one),
        }
    )


MESSAGES = st.lists(
    st.tuples(
        st.integers(0, 5),
        st.builds(
            Message,
            st.none() | st.lists(st.floats(-1e3, 1e3), max_size=5),
            st.none() | st.floats(-1e3, 1e3),
        ),
    ),
    max_size=20,
)


def padded(row: list[float] | None, width: int) -> list[float]:
    return [*(row or []), *[np.nan] * width][:width]


@given(MESSAGES)
def test_columns_have_what_the_messages_had_in_the_order_of_time(
    messages: list[tuple[int, Message]],
) -> None:
    filled = table()
    for wall_ns, message in messages:
        filled.add(wall_ns, message)
    times, columns = filled.read()
    ordered = sorted(messages, key=lambda each: each[0])
    assert times.tolist() == [wall_ns for wall_ns, _ in ordered]
    longest = max((len(message.row or []) for _, message in messages), default=0)
    for name, width in (("three", 3), ("longest", longest)):
        expected = [padded(message.row, width) for _, message in ordered]
        assert columns[name].shape == (len(messages), width)
        shaped = np.array(expected).reshape(len(messages), width)
        np.testing.assert_array_equal(columns[name], shaped)
    ones = [np.nan if message.one is None else message.one for _, message in ordered]
    np.testing.assert_array_equal(columns["one"], np.array(ones))


def test_reading_does_not_end_the_growing() -> None:
    growing = table()
    growing.add(1, Message([1.0]))
    assert growing.read()[1]["longest"].tolist() == [[1.0]]
    growing.add(2, Message([2.0, 3.0]))
    np.testing.assert_array_equal(growing.read()[1]["longest"], [[1.0, np.nan], [2.0, 3.0]])
