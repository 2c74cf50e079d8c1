"""What is said of long work: nothing that has no basis, and nothing that jumps about."""

from itertools import pairwise

import pytest

from daemon.host.progress import Milestones, Pace, duration


def worked(pace: Pace, each_s: float, parts: int, begin_s: float = 0.0) -> float:
    """So many parts, one after the other, are done in `each_s`. Returns when that is over."""
    now_s = begin_s
    for _ in range(parts):
        now_s += each_s
        pace.reach(pace.done + 1.0, now_s)
    return now_s


def test_there_is_no_time_to_go_before_there_is_a_basis_for_it() -> None:
    pace = Pace("learning", 100.0, now_s=0.0)
    assert pace.line(0.0) == "learning, 0%"
    pace.reach(50.0, 1.0)
    pace.reach(51.0, 2.0)
    assert pace.to_go_s(2.0) is None, "too soon"
    assert pace.to_go_s(4.0) is not None
    slow = Pace("learning", 100.0, now_s=0.0)
    slow.reach(1.0, 20.0)
    assert slow.to_go_s(20.0) is None, "one part is no pace"
    slow.reach(1.5, 40.0)
    assert slow.to_go_s(40.0) is None, "too small a share"


def test_even_work_is_foretold() -> None:
    pace = Pace("learning", 100.0, now_s=1000.0)
    now_s = worked(pace, 2.0, 25, 1000.0)
    assert pace.to_go_s(now_s) == pytest.approx(150.0, rel=0.05)
    assert pace.line(now_s) == "learning, 25%, about 2 min to go"
    assert pace.elapsed_s(now_s) == 50.0


def test_what_was_there_before_is_not_taken_for_speed() -> None:
    pace = Pace("runs", 100.0, now_s=0.0, done=80.0)
    now_s = worked(pace, 10.0, 5)
    assert pace.share == 0.85
    assert pace.to_go_s(now_s) == pytest.approx(150.0, rel=0.05)


def test_the_pace_is_that_of_late() -> None:
    pace = Pace("learning", 100.0, now_s=0.0)
    now_s = worked(pace, 0.1, 50)
    for _ in range(30):
        now_s += 10.0
        pace.reach(pace.done + 1.0, now_s)
        pace.to_go_s(now_s)
    assert pace.to_go_s(now_s) == pytest.approx(200.0, rel=0.15)


def test_standing_still_makes_it_longer() -> None:
    pace = Pace("learning", 100.0, now_s=0.0)
    now_s = worked(pace, 1.0, 50)
    before_s = pace.to_go_s(now_s)
    assert before_s is not None
    assert before_s == pytest.approx(50.0, rel=0.1)
    for late_s in range(1, 121):
        after_s = pace.to_go_s(now_s + late_s)
    assert after_s is not None
    assert after_s > 2.0 * before_s


def test_what_is_shown_does_not_jump() -> None:
    pace = Pace("learning", 1000.0, now_s=0.0)
    now_s = worked(pace, 0.1, 100)
    shown = [pace.to_go_s(now_s)]
    for number in range(200):  # every tenth part takes ten times as long
        now_s += 1.0 if number % 10 == 0 else 0.1
        pace.reach(pace.done + 1.0, now_s)
        shown.append(pace.to_go_s(now_s))
    known = [seconds for seconds in shown if seconds is not None]
    jumps = [abs(after - before) for before, after in pairwise(known)]
    assert max(jumps) < 0.25 * max(known)


def test_done_work_takes_no_time_and_work_is_never_undone() -> None:
    pace = Pace("learning", 10.0, now_s=0.0)
    now_s = worked(pace, 1.0, 10)
    pace.reach(3.0, now_s)
    pace.reach(99.0, now_s)
    assert pace.share == 1.0
    assert pace.to_go_s(now_s) == 0.0
    assert pace.line(now_s) == "learning, 100%"


def test_work_of_unknown_length_says_how_long_it_has_taken() -> None:
    pace = Pace("getting ready", 0.0, now_s=0.0)
    pace.reach(5.0, 7.0)
    assert pace.share is None
    assert pace.line(12.0) == "getting ready, 12 s so far"


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (0.0, "a few seconds"),
        (7.4, "a few seconds"),
        (9.0, "about 10 s"),
        (42.0, "about 40 s"),
        (57.0, "about 55 s"),
        (58.0, "about 1 min"),
        (100.0, "about 2 min"),
        (59.4 * 60, "about 59 min"),
        (59.6 * 60, "about 1 h"),
        (80 * 60, "about 1 h 20 min"),
        (7.96 * 3600, "about 8 h"),
    ],
)
def test_a_duration_is_no_more_exact_than_a_guess(seconds: float, told: str) -> None:
    assert duration(seconds) == told


def test_lines_that_stay_come_with_each_tenth_and_each_half_minute() -> None:
    tenths = Milestones(0.0)
    due = [share for share in range(101) if tenths.due(share / 100, 2.0 * share)]
    assert due == [10, 20, 30, 40, 50, 60, 70, 80, 90, 100]
    slow = Milestones(0.0)
    assert [t for t in range(200) if slow.due(0.001 * t / 200, float(t))] == [
        30,
        60,
        90,
        120,
        150,
        180,
    ]
    short = Milestones(0.0)
    assert not any(short.due(share / 100, 0.099 * share) for share in range(101))
    unknown = Milestones(0.0)
    assert [t for t in range(70) if unknown.due(None, float(t))] == [30, 60]
