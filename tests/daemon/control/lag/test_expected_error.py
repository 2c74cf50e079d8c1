"""How far off a tip is expected to be, and how fast it is let go along a path for that."""

from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.control.lag.expected_error import ExpectedError

DT_S = 0.025
GAIN_PER_S = 7.0


def seen(
    expected: ExpectedError, error_mm: float, speed_mm_s: float, lag_s: float, for_s: float
) -> None:
    for _ in range(round(for_s / DT_S)):
        expected.add(DT_S, error_mm, speed_mm_s, lag_s)


def settled_pace(expected: ExpectedError, speed_mm_s: float, lag_s: float) -> float:
    for _ in range(400):
        expected.look_ahead(DT_S, speed_mm_s, lag_s)
    return expected.pace


@given(st.floats(0.05, 3.0), st.floats(1.0, 40.0), st.floats(0.05, 1.0))
def test_as_much_is_expected_as_was_seen_at_that_speed(
    error_mm: float, speed_mm_s: float, lag_s: float
) -> None:
    expected = ExpectedError(GAIN_PER_S, None)
    seen(expected, error_mm, speed_mm_s, lag_s, for_s=60.0)
    assert expected.at(speed_mm_s, lag_s) == pytest.approx(error_mm, rel=0.02)
    assert expected.at(2.0 * speed_mm_s, lag_s) > expected.at(speed_mm_s, lag_s)
    assert expected.at(2.0 * speed_mm_s, lag_s) <= 2.0 * expected.at(speed_mm_s, lag_s)


def test_a_late_body_is_expected_to_be_farther_off_before_anything_is_seen() -> None:
    fresh = ExpectedError(GAIN_PER_S, 1.0)
    assert fresh.at(20.0, 0.1) < 0.5
    assert fresh.at(20.0, 0.8) > 1.0


def test_what_changes_is_known_in_some_seconds() -> None:
    expected = ExpectedError(GAIN_PER_S, None)
    seen(expected, 0.3, 20.0, 0.8, for_s=60.0)
    seen(expected, 3.0, 20.0, 0.8, for_s=6.0)
    assert expected.at(20.0, 0.8) == pytest.approx(3.0 * (1.0 - exp(-1.0)) ** 0.5, rel=0.05)


def test_a_prompt_body_that_follows_as_usual_keeps_every_path_s_time() -> None:
    for speed_mm_s in (5.0, 20.0, 40.0):
        expected = ExpectedError(GAIN_PER_S, 1.0)
        assert settled_pace(expected, speed_mm_s, 0.12) == 1.0
        seen(expected, 0.35, speed_mm_s, 0.12, for_s=10.0)
        assert settled_pace(expected, speed_mm_s, 0.12) == 1.0


@given(st.floats(1.5, 6.0))
def test_a_path_is_slowed_to_where_no_more_is_expected_than_is_tolerated(error_mm: float) -> None:
    expected = ExpectedError(GAIN_PER_S, 1.0)
    seen(expected, error_mm, 20.0, 0.8, for_s=60.0)
    pace = settled_pace(expected, 20.0, 0.8)
    assert 0.25 <= pace < 1.0
    if error_mm < 3.5:
        assert expected.at(pace * 20.0, 0.8) == pytest.approx(1.0, rel=0.05)


def test_a_reference_that_stands_or_creeps_is_not_slowed_for_what_is_off_at_any_speed() -> None:
    expected = ExpectedError(GAIN_PER_S, 1.0)
    seen(expected, 8.0, 0.0, 0.8, for_s=60.0)
    for speed_mm_s in (0.0, 2.0):
        assert settled_pace(expected, speed_mm_s, 0.8) == 1.0


@given(st.floats(0.0, 1e6), st.floats(0.0, 1e4), st.floats(0.0, 2.0), st.floats(0.0, 0.2))
def test_the_pace_is_above_none_and_never_more_than_all_and_changes_slowly(
    error_mm: float, speed_mm_s: float, lag_s: float, dt_s: float
) -> None:
    expected = ExpectedError(GAIN_PER_S, 1.0)
    for _ in range(200):
        expected.add(dt_s, error_mm, speed_mm_s, lag_s)
        before = expected.pace
        expected.look_ahead(dt_s, speed_mm_s, lag_s)
        assert 0.25 <= expected.pace <= 1.0
        assert abs(expected.pace - before) <= 0.5 * dt_s + 1e-9


def test_whoever_keeps_the_time_is_never_slowed() -> None:
    expected = ExpectedError(GAIN_PER_S, None)
    seen(expected, 30.0, 20.0, 0.8, for_s=10.0)
    assert settled_pace(expected, 20.0, 0.8) == 1.0
    assert expected.at(20.0, 0.8) > 25.0


def test_what_axes_can_do_nothing_about_is_expected_at_any_speed_and_slows_nothing() -> None:
    expected, plain = ExpectedError(GAIN_PER_S, 1.0), ExpectedError(GAIN_PER_S, 1.0)
    for _ in range(2000):
        expected.add(DT_S, 0.3, 20.0, 0.1, beyond_mm=-4.0)
    seen(plain, 0.3, 20.0, 0.1, for_s=50.0)
    assert settled_pace(expected, 20.0, 0.1) == settled_pace(plain, 20.0, 0.1) == 1.0
    for speed_mm_s in (0.0, 20.0):
        assert expected.at(speed_mm_s, 0.1) == pytest.approx(4.0, rel=0.01)
    seen(expected, 0.3, 20.0, 0.1, for_s=60.0)  # it is within reach again
    assert expected.at(20.0, 0.1) < 0.4
