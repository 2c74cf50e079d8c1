"""Where the axes were when the tracker measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.loop.actuation_history import ActuationHistory


def history(*samples: tuple[int, float]) -> ActuationHistory:
    made = ActuationHistory(2)
    for t_ns, value in samples:
        made.add(t_ns, (value, -value))
    return made


def test_between_two_samples_it_is_in_proportion() -> None:
    made = history((0, 0.0), (100, 1.0), (200, 5.0))
    assert made.at(150).tolist() == [3.0, -3.0]


def test_outside_the_samples_it_is_the_nearest_one() -> None:
    made = history((100, 1.0), (200, 5.0))
    assert made.at(0).tolist() == [1.0, -1.0]
    assert made.at(999).tolist() == [5.0, -5.0]


def test_before_anything_is_known_it_says_so() -> None:
    with pytest.raises(LookupError):
        history().at(0)
    assert not history().known
    assert history((0, 1.0)).known


@given(st.integers(1, 300), st.floats(0, 1))
def test_a_straight_motion_is_read_back_exactly(count: int, share: float) -> None:
    made = history(*((1000 * step, float(step)) for step in range(count)))
    oldest = max(0, count - 64)
    t_ns = round(1000 * (oldest + share * (count - 1 - oldest)))
    np.testing.assert_allclose(made.at(t_ns), [t_ns / 1000, -t_ns / 1000], atol=1e-9)


MS = 1_000_000


def test_what_was_told_for_a_frame_is_told_again_for_times_about_it() -> None:
    made = history((0, 0.0), (100 * MS, 1.0))
    told = made.at_frame(50 * MS)
    assert told.tolist() == [0.5, -0.5]
    made.add(200 * MS, (9.0, -9.0))
    later = made.at_frame(110 * MS)
    assert made.about(50 * MS) is told
    assert made.about(63 * MS) is told
    assert made.about(100 * MS) is later
    assert made.at_frame(50 * MS).tolist() == told.tolist()


@given(st.lists(st.integers(1, 40), min_size=1, max_size=40), st.integers(-50, 900))
def test_the_nearest_frame_is_found_wherever_it_is(gaps_ms: list[int], asked_ms: int) -> None:
    made = history((0, 0.0))
    told = {int(t_ms): made.at_frame(int(t_ms) * MS) for t_ms in np.cumsum(gaps_ms)[-32:]}
    nearest = min(reversed(told), key=lambda t_ms: abs(t_ms - asked_ms))
    found = made.about(asked_ms * MS)
    assert (found is told[nearest]) == (abs(nearest - asked_ms) <= 13)


def test_where_no_frame_is_near_it_is_worked_out() -> None:
    made = history((0, 0.0), (100 * MS, 1.0))
    assert made.about(20 * MS).tolist() == [0.2, -0.2]
    made.at_frame(100 * MS)
    assert made.about(20 * MS).tolist() == [0.2, -0.2]
    assert made.about(86 * MS).tolist() == pytest.approx([0.86, -0.86])


def test_frames_are_not_remembered_for_ever() -> None:
    made = history((0, 0.0), (10_000 * MS, 100.0))
    for frame in range(100):
        made.at_frame(frame * 25 * MS)
    assert len(made._frames) == 32
