"""The window: fixed size, first in first out, nothing but finite samples of this robot."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.learning.inverse.window import Window
from daemon.learning.samples.motion import MotionSample

AXES = 4


def sample(number: int) -> MotionSample:
    """One that can be told from others."""
    return MotionSample(
        np.full(3, number), np.full(AXES, -number), np.full(AXES, 2 * number), np.full(3, 0.5)
    )


def same(a: MotionSample, b: MotionSample) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@given(capacity=st.integers(1, 7), count=st.integers(0, 25))
def test_first_in_first_out(capacity: int, count: int) -> None:
    window, expected = Window(capacity, AXES), deque[int](maxlen=capacity)
    for number in range(count):
        leaving = expected[0] if len(expected) == capacity else None
        fallen = window.add(sample(number))
        expected.append(number)
        assert (fallen is None) == (leaving is None)
        if fallen is not None and leaving is not None:
            assert same(fallen, sample(leaving))
    assert len(window) == len(expected)
    assert window.full == (len(expected) == capacity)
    assert all(same(a, sample(b)) for a, b in zip(window, expected, strict=True))


def test_samples_keep_their_slot_and_the_buffers_their_place() -> None:
    window = Window(3, AXES)
    before = [array.ctypes.data for array in (window.tip_mm, window.u, window.delta_u)]
    for number in range(5):
        slot = window.slot
        window.add(sample(number))
        assert window.tip_mm[slot, 0] == number
    assert [int(row[0]) for row in window.tip_mm] == [3, 4, 2]
    assert before == [array.ctypes.data for array in (window.tip_mm, window.u, window.delta_u)]


def test_what_is_taken_out_or_looked_at_is_a_copy() -> None:
    window = Window(1, AXES)
    window.add(sample(1))
    (seen,) = window
    fallen = window.add(sample(2))
    assert fallen is not None
    window.add(sample(3))
    assert same(seen, sample(1))
    assert same(fallen, sample(1))


@pytest.mark.parametrize("name", MotionSample._fields)
@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
def test_a_poisoned_sample_is_refused_and_changes_nothing(name: str, poison: float) -> None:
    window = Window(2, AXES)
    window.add(sample(1))
    bad = sample(2)._replace(**{name: np.full(len(getattr(sample(2), name)), poison)})
    with pytest.raises(ValueError, match=f"{name} is not finite"):
        window.add(bad)
    assert [int(kept.tip_mm[0]) for kept in window] == [1]
    assert window.slot == 1


def test_a_sample_of_another_robot_is_refused() -> None:
    with pytest.raises(ValueError, match="delta_u: shape"):
        Window(2, AXES).add(sample(1)._replace(delta_u=np.zeros(AXES + 1)))


def test_a_cleared_window_starts_anew() -> None:
    window = Window(2, AXES)
    for number in range(3):
        window.add(sample(number))
    window.clear()
    assert not list(window)
    window.add(sample(7))
    assert window.tip_mm[0, 0] == 7


def test_a_window_needs_room() -> None:
    with pytest.raises(ValueError, match="no window of 0"):
        Window(0, AXES)
