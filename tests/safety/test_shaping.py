"""How far one axis may go in one step."""

from dataclasses import replace
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety import shaping
from safety.limits import CountLimits
from safety.shaping import AxisMotion
from tests.safety.examples import examples

# 500 counts per step at the highest velocity; from step to step 125 more, or less.
LIMITS = CountLimits(
    lowest=0, highest=100_000, max_velocity=20_000, max_acceleration=200_000, max_lag=2_000
)
STEP_NS = 25_000_000


def motion(
    last_change: float = 0.0, *, start: int = 50_000, unchanged_ns: int = STEP_NS
) -> AxisMotion:
    """An axis whose last step, as long as this one, had `last_change`."""
    return AxisMotion(start, last_change * 40.0, STEP_NS, unchanged_ns)


def test_the_highest_velocity_gives_the_largest_change() -> None:
    assert shaping.largest_change(LIMITS, STEP_NS) == 500
    assert shaping.largest_change(LIMITS, STEP_NS - 1) == 499


def test_braking_grows_with_the_square_of_time() -> None:
    assert shaping.braking(LIMITS, STEP_NS) == 125.0
    assert shaping.braking(LIMITS, 2 * STEP_NS) == 500.0


def test_a_motion_coasts_at_its_velocity() -> None:
    assert motion(300.0).coasts == 300.0
    assert AxisMotion(0, 100.0, 2_000_000_000, 1).coasts == 200.0


@pytest.mark.parametrize(
    ("wanted", "last_change", "since", "allowed"),
    [
        (0, 0, 1.0, 0),
        (125, 0, 1.0, 125),
        (126, 0, 1.0, 125),
        (-126, 0, 1.0, -125),
        (500, 300, 1.0, 425),
        (0, 300, 1.0, 175),
        (-500, -300, 1.0, -425),
        (0, -300, 1.0, -175),
        (0, 100, 1.0, 0),
        (-500, 100, 1.0, -25),
        (500, -100, 1.0, 25),
        # Half the time has passed: half the change.
        (500, 0, 0.5, 62),
        (-500, 0, 0.5, -62),
        (500, 300, 0.5, 362),
        (0, 300, 0.5, 238),
        (0, -300, 0.5, -238),
        (-500, 100, 0.5, 38),
        (-500, 50, 0.5, -12),
        (500, -100, 0.5, -38),
        (500, -50, 0.5, 12),
        # No time has passed: no change.
        (500, 300, 0.0, 300),
        (0, 300, 0.0, 300),
        # More time than the step has: no more gain than the step allows.
        (500, 0, 9.0, 125),
    ],
)
def test_acceleration(wanted: int, last_change: int, since: float, allowed: int) -> None:
    at = motion(last_change, unchanged_ns=round(since * STEP_NS))
    assert shaping.within_acceleration(wanted, at, LIMITS) == allowed


@pytest.mark.parametrize(("last_change", "allowed"), [(0.6, 0), (3.4, 3), (-3.4, -3)])
def test_where_no_whole_count_is_allowed_the_slower_one_is_taken(
    last_change: float, allowed: int
) -> None:
    weak = CountLimits(0, 100_000, 20_000, 160, 2_000)  # 0.1 counts per step and step
    assert shaping.within_acceleration(0, motion(last_change), weak) == allowed


@pytest.mark.parametrize(
    ("wanted", "start", "allowed"),
    [
        (500, 50_000, 500),
        (500, 100_000 - 1500, 500),
        (500, 100_000 - 1499, 499),
        (500, 100_000, 0),
        (1, 100_000, 0),
        (500, 99_999, 1),
        (500, 99_998, 1),
        (500, 99_997, 2),
        (-500, 1500, -500),
        (-500, 1499, -499),
        (-500, 1, -1),
        (-500, 0, 0),
        (500, 0, 500),
        (-500, 100_000, -500),
        # Outside: only back.
        (500, 100_500, 0),
        (-500, 100_500, -500),
        (-500, -500, 0),
        (500, -500, 500),
        (7, 100_500, 0),
        (-7, -500, 0),
    ],
)
def test_the_ends_of_travel_are_braked_for(wanted: int, start: int, allowed: int) -> None:
    assert shaping.within_travel(wanted, motion(start=start), LIMITS) == allowed


def test_travel_need_not_begin_at_zero() -> None:
    limits = replace(LIMITS, lowest=-1000, highest=-500)
    assert shaping.within_travel(-500, motion(start=-999), limits) == -1
    assert shaping.within_travel(500, motion(start=-501), limits) == 1
    assert shaping.within_travel(-500, motion(start=-500), limits) == -250
    assert shaping.within_travel(500, motion(start=-1000), limits) == 250


@examples(100)
@given(
    distance=st.integers(0, 200_000),
    slower=st.floats(0.01, 1e5),
    goes_on=st.one_of(st.just(0.0), st.floats(0.0, 40.0)),
)
def test_what_is_stoppable_leaves_the_way_to_stop(
    distance: int, slower: float, goes_on: float
) -> None:
    change = shaping._stoppable(distance, slower, goes_on)
    assert 0 <= change <= distance
    if change > 1:
        way = change * (1 + goes_on) + change * change / (2 * slower)
        assert way <= distance * (1 + 1e-9)
        more = change + 1
        assert more * (1 + goes_on) + more * more / (2 * slower) > distance * (1 - 1e-9)


@pytest.mark.parametrize(
    ("wanted", "measured", "allowed"),
    [
        (500, 50_000, 500),
        (500, 48_500, 500),
        (500, 48_499, 499),
        (500, 48_000, 0),
        (500, 40_000, 0),
        (1, 48_000, 0),
        (-500, 40_000, -500),
        (-500, 51_500, -500),
        (-500, 51_501, -499),
        (-500, 52_000, 0),
        (-500, 60_000, 0),
        (500, 60_000, 500),
    ],
)
def test_a_target_stays_near_the_measured_position(
    wanted: int, measured: int, allowed: int
) -> None:
    assert shaping.within_lag(wanted, motion(), measured, LIMITS) == allowed


@pytest.mark.parametrize(
    ("tension_n", "pulling", "releasing"),
    [
        (10.0, True, True),
        (20.0, True, True),
        (20.1, False, True),
        (1.0, True, True),
        (0.9, True, False),
        (None, False, False),
        (nan, False, False),
        (inf, False, False),
        (-inf, False, False),
    ],
)
@pytest.mark.parametrize("up_pulls", [True, False])
def test_a_tendon_is_neither_torn_nor_dropped(
    tension_n: float | None, pulling: bool, releasing: bool, up_pulls: bool
) -> None:
    def moved(change: int) -> int:
        return shaping.within_tension(change, tension_n, (1.0, 20.0), up_pulls)

    pulls = 1 if up_pulls else -1
    assert moved(pulls) == (pulls if pulling else 0)
    assert moved(-pulls) == (-pulls if releasing else 0)
    assert moved(0) == 0


@pytest.mark.parametrize(
    ("change", "rests_at"), [(0, 50_000.0), (250, 50_500.0), (-250, 49_500.0), (500, 51_500.0)]
)
def test_where_an_axis_stops_if_it_brakes_after_the_step(change: int, rests_at: float) -> None:
    assert shaping.stops_at(change, motion(), LIMITS) == rests_at


GOES_ON = replace(LIMITS, goes_on_s=0.1)
"""Four steps, and so five with the step itself: v·0.125 s + v²/2a of the travel."""


@pytest.mark.parametrize(
    ("wanted", "start", "allowed"),
    [
        (500, 50_000, 500),
        (500, 100_000 - 3500, 500),
        (500, 100_000 - 3499, 499),
        (-500, 3500, -500),
        (-500, 3499, -499),
        (500, 100_000, 0),
        (500, 99_999, 1),
        (500, 100_500, 0),
        (-500, 100_500, -500),
    ],
)
def test_an_axis_that_goes_on_without_a_word_is_left_the_way_for_it(
    wanted: int, start: int, allowed: int
) -> None:
    assert shaping.within_travel(wanted, motion(start=start), GOES_ON) == allowed
