"""How long a control step lasts, by how frames come."""

from daemon.loop.frame_statistics import StepPeriod

FRAME_NS = 25_000_000


def after(*steps_ns: int) -> int:
    period = StepPeriod(FRAME_NS)
    for step_ns in steps_ns:
        period.add(step_ns)
    return period.period_ns


def test_a_tracker_that_brings_all_its_frames_has_steps_of_a_frame() -> None:
    assert after(*[FRAME_NS] * 40) == FRAME_NS
    assert after(*[FRAME_NS - 40_000, FRAME_NS + 90_000] * 20) == FRAME_NS


def test_frames_that_are_lost_now_and_then_make_no_step_longer() -> None:
    assert after(*[FRAME_NS, FRAME_NS, 4 * FRAME_NS] * 10) == FRAME_NS


def test_a_slow_line_has_steps_as_long_as_its_frames_are_apart() -> None:
    """At 9600 baud every fourth or fifth frame comes."""
    assert after(*[4 * FRAME_NS, 5 * FRAME_NS, 5 * FRAME_NS] * 10) == 5 * FRAME_NS


def test_it_is_not_believed_at_once_and_forgotten_when_all_frames_come() -> None:
    assert after(*[4 * FRAME_NS] * 8) == FRAME_NS
    assert after(*[4 * FRAME_NS] * 9) == 4 * FRAME_NS
    assert after(*[4 * FRAME_NS] * 20, *[FRAME_NS] * 5) == FRAME_NS


def test_no_step_is_longer_than_a_fifth_of_a_second() -> None:
    assert after(*[40 * FRAME_NS] * 20) == 200_000_000


def test_a_clock_that_stands_still_or_goes_back_is_no_step() -> None:
    assert after(*[4 * FRAME_NS, 0, -FRAME_NS] * 20) == 4 * FRAME_NS
