"""Steps of axes that are coupled: what is cut, of which axes, and how they brake."""

from dataclasses import replace
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.coupled_shaping import CoupledStep
from safety.coupling import AxisSum, Condition, CoupledLimit
from safety.limits import CountLimits
from safety.shaping import AxisMotion, acceleration_range
from tests.safety.examples import examples
from tests.safety.gate.gate_rig import LIMITS, STEP_NS

WIDE = replace(LIMITS, lowest=-100_000)
# Axis 0 goes no more than 1000 counts before axis 1, and no more than 1000 behind; 8 of rounding.
ORDER = CoupledLimit("order", AxisSum(((0, 1.0), (1, -1.0))), -1000.0, 1000.0)
# Axis 1 stays above 0 while axis 2 is within 500 of 2000.
GUARD = CoupledLimit(
    "guard", AxisSum(((1, 1.0),)), 0.0, inf, (Condition(AxisSum(((2, 1.0),)), 2000, 500, None),)
)

SUM = CoupledLimit("sum", AxisSum(((0, 1.0), (1, 1.0))), -1000.0, 1000.0)
# Half a unit to a count of axis 0, two of axis 1.
GEARED = CoupledLimit("geared", AxisSum(((0, 0.5), (1, -2.0))), -1000.0, 1000.0)
# As a guard in halves: axis 0 stays before axis 1 while one of two sums is in its band.
HALVES = CoupledLimit(
    "halves",
    AxisSum(((0, 0.5), (1, -0.5))),
    0.0,
    inf,
    (
        Condition(AxisSum(((2, 0.5),)), 1000.0, 250.0, None),
        Condition(AxisSum(((0, 0.5),)), 0.0, 300.0, None),
    ),
)


def step(
    start: tuple[int, ...],
    last: tuple[float, ...] | None = None,
    coupled: tuple[CoupledLimit, ...] = (ORDER,),
    *,
    limits: tuple[CountLimits, ...] | None = None,
    unchanged_ns: tuple[float, ...] | None = None,
) -> CoupledStep:
    """Axes whose last step, as long as this one, had the changes `last`."""
    count = len(start)
    last = last or (0.0,) * count
    unchanged_ns = unchanged_ns or (STEP_NS,) * count
    motions = [
        AxisMotion(at, change * 40.0, STEP_NS, unchanged)
        for at, change, unchanged in zip(start, last, unchanged_ns, strict=True)
    ]
    return CoupledStep(motions, limits or (WIDE,) * count, coupled)


def shaped(one: CoupledStep, *changes: int) -> tuple[list[int], list[str]]:
    limited: list[str] = []
    return one.shaped(changes, limited), limited


# Braking together.


def test_all_come_to_rest_at_the_same_time_on_one_line() -> None:
    course = step((1000, 2000, 3000)).course([500, -250, 0])
    assert course.changes == [500, -250, 0]
    assert course.end == [1500, 1750, 3000]
    assert course.rest == [2500, 1250, 3000]
    assert course.stretch == pytest.approx(3.0)


def test_the_slowest_to_brake_decides_how_long_it_lasts() -> None:
    weak = replace(WIDE, max_acceleration=50_000)
    course = step((0, 0), limits=(WIDE, weak)).course([500, 250])
    assert course.stretch == pytest.approx(5.0)  # 10,000 counts/s in 0.2 s
    assert course.rest == [2500, 1250]


def test_who_stands_is_at_rest() -> None:
    course = step((5, 6)).course([0, 0])
    assert (course.rest, course.stretch) == ([5, 6], 1.0)


@pytest.mark.parametrize(
    ("last", "since", "braked"),
    [
        ((0, 0), 1.0, [0, 0]),
        ((500, 250), 1.0, [375, 187]),
        ((500, -250), 1.0, [375, -187]),
        ((-400, 0), 1.0, [-275, 0]),
        ((500, 250), 0.5, [438, 218]),
        ((500, 250), 0.0, [500, 250]),
        ((500, 250), 9.0, [375, 187]),
        ((100, 50), 1.0, [0, 0]),
    ],
)
def test_braking_takes_the_same_share_of_all(
    last: tuple[float, float], since: float, braked: list[int]
) -> None:
    one = step((0, 0), last, unchanged_ns=(since * STEP_NS,) * 2)
    assert one._braking_together() == braked


def test_who_stands_does_not_tell_how_long_it_is_since_the_others_braked() -> None:
    one = step((0, 0), (500.0, 0.0), unchanged_ns=(STEP_NS, 0.0))
    assert one._braking_together() == [375, 0]
    one = step((0, 0), (500.0, 100.0), unchanged_ns=(STEP_NS, STEP_NS / 2))
    assert one._braking_together() == [437, 87]


# What is cut.


def test_what_keeps_to_all_limits_is_not_touched() -> None:
    assert shaped(step((0, 0)), 100, -100) == ([100, -100], [])
    assert shaped(step((900, 0), (100.0, 100.0)), 100, 100) == ([100, 100], [])


def test_of_what_leads_out_all_the_same_share_is_cut() -> None:
    # 992 less 692 is 300, and 1.44 changes lead to rest: 208 for both.
    changes, limited = shaped(step((692, 0), (100.0, -100.0)), 110, -110)
    assert limited == ["coupled limit: order"]
    assert changes == [104, -104]
    one = step((692, 0))
    assert one.course(changes).rest[0] - one.course(changes).rest[1] <= 992


def test_who_does_not_lead_out_goes_on() -> None:
    for third in (120, -120):
        changes, limited = shaped(step((992, 0, 0)), 100, 0, third)
        assert (changes, limited) == ([0, 0, third], ["coupled limit: order"])


def test_along_a_bound_both_go_on() -> None:
    at_bound = step((992, 0), (100.0, 100.0))
    assert shaped(at_bound, 100, 100) == ([100, 100], [])
    changes, limited = shaped(at_bound, 110, 100)
    assert (changes, limited) == ([100, 100], ["coupled limit: order"])


def test_the_lower_bound_is_one_too() -> None:
    changes, limited = shaped(step((-992, 0, 0)), -100, 0, 5)
    assert (changes, limited) == ([0, 0, 5], ["coupled limit: order"])
    assert shaped(step((-992, 0)), 100, 0) == ([100, 0], [])
    changes, limited = shaped(step((-692, 0), (-100.0, 100.0)), -110, 110)
    assert (changes, limited) == ([-104, 104], ["coupled limit: order"])


def test_a_cut_never_breaks_what_acceleration_leaves() -> None:
    # At 400 a step no less than 275 is possible, and it has to be begun in time.
    one = step((0, 0), (400.0, 0.0))
    changes, limited = shaped(one, 525, 0)
    assert limited == ["coupled limit: order"]
    assert 275 <= changes[0] < 525
    assert one.course(changes).rest[0] <= 992


def test_what_cannot_brake_sooner_leaves_it_to_the_others() -> None:
    # Axis 1 backwards at 400 a step cannot be cut below 275, but axis 0 can.
    one = step((-40, 40), (100.0, -400.0))
    changes, limited = shaped(one, 200, -525)
    assert limited == ["coupled limit: order"]
    course = one.course(changes)
    assert course.rest[0] - course.rest[1] <= 992
    assert -525 <= changes[1] <= -275
    assert all(type(change) is int for change in changes)


@pytest.mark.parametrize(
    ("limit", "start", "last", "wanted", "done"),
    [
        # Axis 1 cannot be cut enough: axis 0 gives up an eighth of what it was cut to, not more.
        (ORDER, (2178, 2338), (0, 461), (-108, 428), [-39, 336]),
        # Outside, and too fast to be inside after this step: what is left is braking.
        (ORDER, (-970, -510), (-475, -36), (-463, 3), [-350, -26]),
        (ORDER, (-767, 2104), (-37, 170), (41, 194), [0, 45]),
        (ORDER, (1820, 2181), (-42, 493), (-69, 489), [-5, 368]),
    ],
)
def test_where_a_cut_is_not_enough_it_is_blended_with_braking(
    limit: CoupledLimit,
    start: tuple[int, int],
    last: tuple[float, float],
    wanted: tuple[int, int],
    done: list[int],
) -> None:
    assert shaped(step(start, last, (limit,)), *wanted)[0] == done


@pytest.mark.parametrize(
    ("limit", "start", "last", "wanted", "done"),
    [
        # What leads out is counted in the sum's unit, and cut by the same share of each axis.
        (GEARED, (767, -306, 0), (-4, 0, 0), (-98, -62, 0), [-98, -21, 0]),
        (GEARED, (232, 555, 0), (0, 0, 0), (-1, -2, -56), [0, -2, -56]),
        # To the count: what is exactly used up is not too much, and half a count is none.
        (SUM, (837, 159, 0), (7, 0, 0), (13, -4, -48), [0, -4, -48]),
        (SUM, (1117, -126, 0), (0, 0, 0), (54, 0, 0), [0, 0, 0]),
        (HALVES, (-115, -126, 2478), (0, 0, 0), (-14, 1, 0), [-2, 0, 0]),
        (HALVES, (59, 66, 2505), (0, 5, 0), (-50, 0, -48), [-50, 0, 0]),
        (HALVES, (-276, -260, 1769), (0, 0, 0), (-4, 1, -24), [0, 0, -24]),
        # Nothing leads out of the guard, but its bound is within rounding: less is taken there.
        (GUARD, (0, 2, 1499), (0, 0, 0), (0, 1, 2), [0, 0, 2]),
    ],
)
def test_what_is_cut_is_known_to_the_count(
    limit: CoupledLimit,
    start: tuple[int, int, int],
    last: tuple[float, float, float],
    wanted: tuple[int, int, int],
    done: list[int],
) -> None:
    assert shaped(step(start, last, (limit,)), *wanted)[0] == done


def test_what_is_between_braking_and_a_cut_is_whole_counts() -> None:
    between = step((0, 0))._between([0, 10], [100, -9], 0.5)
    assert between == [50, 1]
    assert all(type(change) is int for change in between)


def test_two_limits_are_kept_at_once() -> None:
    other = CoupledLimit("other", AxisSum(((1, 1.0), (2, 1.0))), -inf, 8.0)
    changes, limited = shaped(step((992, 0, 0), coupled=(ORDER, other)), 100, 90, 110)
    one = step((992, 0, 0), coupled=(ORDER, other))
    course = one.course(changes)
    assert course.rest[0] - course.rest[1] <= 992
    assert course.rest[1] + course.rest[2] <= 0
    assert sorted(limited) == ["coupled limit: order", "coupled limit: other"]


def test_the_end_of_travel_counts_for_braking_together() -> None:
    narrow = replace(WIDE, lowest=-1000, highest=1000)
    for sign in (1, -1):
        beside = CoupledLimit("beside", AxisSum(((0, 0.12 * sign), (1, -1.0))), -1e6, 1e6)
        beside = beside._replace(lowest=-850 * sign - 60.0, highest=-850 * sign + 60.0)
        limits = (WIDE, narrow)
        # Axis 0 brakes in 0.1 s: axis 1 with it, 3 changes from where it starts.
        one = step((0, 850 * sign), (500.0, 50.0 * sign), (beside,), limits=limits)
        assert shaped(one, 500, 60 * sign) == ([500, 50 * sign], ["braking distance: axis 1"])
        assert shaped(one, 500, 50 * sign) == ([500, 50 * sign], [])
        # From beyond the end it may come back.
        beside = beside._replace(lowest=-1500 * sign - 60.0, highest=-1500 * sign + 60.0)
        out = step((0, 1500 * sign), (500.0, 0.0), (beside,), limits=limits)
        assert shaped(out, 400, 60 * sign)[0][1] == 0
        assert "braking distance: axis 1" in shaped(out, 400, 60 * sign)[1]


def test_at_the_end_of_travel_not_one_count_goes_beyond() -> None:
    narrow = replace(WIDE, lowest=-1000, highest=1000)
    along = step((992, 0, 1000), (100.0, 100.0, 0.0), limits=(WIDE, WIDE, narrow))
    assert shaped(along, 100, 100, 1) == ([100, 100, 0], ["braking distance: axis 2"])
    along = step((992, 0, -1000), (100.0, 100.0, 0.0), limits=(WIDE, WIDE, narrow))
    assert shaped(along, 100, 100, -1) == ([100, 100, 0], ["braking distance: axis 2"])


def test_who_stands_beyond_the_end_of_travel_is_in_nobodys_way() -> None:
    narrow = replace(WIDE, lowest=-1000, highest=1000)
    for outside in (1500, -1500):
        start = (992, 0, outside)
        along = step(start, (100.0, 100.0, 0.0), limits=(WIDE, WIDE, narrow))
        assert shaped(along, 100, 100, 0) == ([100, 100, 0], [])
        assert along._keeps([100, 100, 0])


def test_far_from_all_limits_axes_brake_by_themselves() -> None:
    loose = CoupledLimit("loose", ORDER.sum, -1e6, 1e6)
    narrow = replace(WIDE, lowest=-1000, highest=1000)
    # Together with axis 0, axis 1 would not stop before the end of its travel: by itself it does.
    near_end = step((0, 850), (500.0, 50.0), (loose,), limits=(WIDE, narrow))
    assert shaped(near_end, 500, 60) == ([500, 60], [])
    far = step((0, 0), (500.0, 250.0), (loose,))
    assert far.braking() == [375, 125]
    assert far.rest([400, 100]) == [1040, 140]
    near = step((0, 0), (400.0, 400.0))
    assert near.rest([400, 400]) == [1040, 1040]
    beside = CoupledLimit("beside", AxisSum(((0, 0.5), (1, -1.0))), -60.0, 60.0)
    near = step((0, 0), (500.0, 250.0), (beside,))
    assert near.braking() == [375, 187]
    assert near.rest([400, 200]) == [1040, 520]


def test_a_guard_is_kept_on_the_side_where_the_axes_are() -> None:
    # Inside the band, 300 above the bound: axis 2 is free, axis 1 stops before the bound.
    changes, limited = shaped(step((0, 300, 2000), coupled=(GUARD,)), 0, -125, 120)
    assert (changes, limited) == ([0, -125, 120], [])
    changes, limited = shaped(step((0, 104, 2000), coupled=(GUARD,)), 0, -125, 120)
    assert limited == ["coupled limit: guard"]
    assert changes[2] == 120
    assert -100 <= changes[1] * (1 + 120 / 250) <= 0
    # Beside the band and below the bound: axis 1 is free, axis 2 stops before the band.
    changes, limited = shaped(step((0, -300, 1400), coupled=(GUARD,)), 0, -125, 120)
    assert limited == ["coupled limit: guard"]
    assert changes[1] == -125
    assert 0 < changes[2] * 1.5 <= 100 - 4


def test_where_both_sides_are_open_the_one_that_takes_less_is_kept_to() -> None:
    # 100 above the bound, 300 beside the band: down at 125 is cut less than towards it at 20.
    changes, limited = shaped(step((0, 104, 1196), coupled=(GUARD,)), 0, -125, 20)
    assert (changes, limited) == ([0, -125, 20], [])
    changes, limited = shaped(step((0, 104, 1476), coupled=(GUARD,)), 0, -80, 120)
    assert limited == ["coupled limit: guard"]
    assert changes[2] == 120  # of axis 2 nearly all would have to be taken
    assert -80 < changes[1] < 0
    changes, limited = shaped(step((0, 24, 1396), coupled=(GUARD,)), 0, -120, 80)
    assert limited == ["coupled limit: guard"]
    assert changes[1] == -120  # of axis 1 nearly all
    assert 0 < changes[2] < 80


def test_from_outside_only_what_leads_in_is_left() -> None:
    outside = step((1500, 0, 0))
    assert shaped(outside, -100, 0, 7) == ([-100, 0, 7], [])
    assert shaped(outside, 100, 0, 7) == ([0, 0, 7], ["coupled limit: order"])
    assert shaped(outside, 100, 100, 7) == ([100, 100, 7], [])
    assert shaped(outside, -100, -120, 7)[0] == [-100, -100, 7]
    within = step((0, -300, 1900), coupled=(GUARD,))
    assert shaped(within, 0, 100, -100) == ([0, 100, -100], [])
    assert shaped(within, 0, 100, 100) == ([0, 100, 0], ["coupled limit: guard"])
    assert shaped(within, 0, -100, -100) == ([0, 0, -100], ["coupled limit: guard"])


def test_within_rounding_of_a_bound_what_does_not_lead_away_is_no_motion() -> None:
    near = step((996, 0, 0))
    assert shaped(near, -2, 0, 7) == ([0, 0, 7], ["coupled limit: order"])
    assert shaped(near, -4, 0, 7) == ([-4, 0, 7], [])
    changes, _ = shaped(near, 100, 100, 7)
    assert changes[1:] == [100, 7]
    assert 90 <= changes[0] <= 96
    # On the very bound as well, which is inside.
    assert shaped(step((1000, 0)), 100, 100)[0] == [92, 100]
    assert shaped(step((-1000, 0)), -100, -100)[0] == [-92, -100]


def test_what_is_told_is_told_once() -> None:
    limited = ["coupled limit: order"]
    step((992, 0)).shaped([100, 0], limited)
    assert limited == ["coupled limit: order"]


@examples(200)
@given(
    start=st.tuples(st.integers(-900, 900), st.integers(-40, 40), st.integers(0, 4000)),
    wanted=st.lists(
        st.tuples(st.integers(-600, 600), st.integers(-600, 600), st.integers(-600, 600)),
        min_size=1,
        max_size=30,
    ),
    early=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5),
)
def test_however_it_is_driven_braking_is_always_possible(
    start: tuple[int, int, int],
    wanted: list[tuple[int, int, int]],
    early: list[float],
) -> None:
    """Steps one after the other, the frames early by any share; all keep to the limits."""
    limits = (WIDE,) * 3
    coupled = (ORDER, GUARD)
    if abs(start[0] - start[1]) > 990 or (start[1] < 8 and 1490 < start[2] < 2510):
        return
    at = list(start)
    motions = [AxisMotion(one, 0.0, STEP_NS, STEP_NS) for one in at]
    for number, changes in enumerate(wanted):
        one = CoupledStep(motions, limits, coupled)
        # As the gate has them: within the axes' own acceleration.
        boxes = [acceleration_range(motion, WIDE) for motion in motions]
        possible = [max(a, min(b, w)) for w, (a, b) in zip(changes, boxes, strict=True)]
        done = one.shaped(possible, [])
        for change, (lowest, highest) in zip(done, boxes, strict=True):
            assert lowest <= change <= highest
        rest = one.rest(done)
        assert abs(rest[0] - rest[1]) <= 1000
        assert rest[1] >= 0 or not 1500 < rest[2] < 2500
        share = 1.0 - early[number % len(early)]
        motions = [
            AxisMotion(motion.start + int(change * share), change * 40.0, STEP_NS, share * STEP_NS)
            for motion, change in zip(motions, done, strict=True)
        ]


# Axes that are told velocities, and nothing any more.


GOES_ON = replace(WIDE, goes_on_s=0.1)


def test_how_far_axes_go_that_nobody_tells_anything_any_more() -> None:
    course = step((1000, 2000), limits=(GOES_ON, WIDE)).course([500, -250])
    assert course.end == [1500, 1750]
    assert course.rest == [4500, 1250]  # 20,000 counts/s for 0.1 s, and braking in 0.1 s
    assert course.stretch == pytest.approx(7.0)


@given(
    st.integers(-900, 900),
    st.integers(-500, 500),
    st.lists(st.tuples(st.integers(-500, 500), st.integers(-500, 500)), min_size=1, max_size=30),
)
@examples(100)
def test_wherever_the_stream_is_cut_coupled_axes_come_to_rest_inside(
    apart: int, along: int, wanted: list[tuple[int, int]]
) -> None:
    """Step after step: going on together, and then braking, each by itself or on one line."""
    at, last = (along + apart, along), (0.0, 0.0)
    for changes in wanted:
        one = step(at, last, limits=(GOES_ON, GOES_ON))
        reached = [
            max(round(before) - 125, min(round(before) + 125, change))
            for before, change in zip(last, changes, strict=True)
        ]
        done, _ = shaped(one, *reached)
        at, last = (at[0] + done[0], at[1] + done[1]), (float(done[0]), float(done[1]))
        velocity = [change * 40.0 for change in done]
        brakes_s = max(abs(v) for v in velocity) / GOES_ON.max_acceleration
        for going_s in (0.0, 0.05, 0.1):
            first, second = (a + v * going_s for a, v in zip(at, velocity, strict=True))
            assert abs(first - second) <= 1000.0
        apart_rest, line_rest = (
            [
                a + v * (0.1 + lasts_s / 2.0)
                for a, v, lasts_s in zip(at, velocity, each, strict=True)
            ]
            for each in ([abs(v) / GOES_ON.max_acceleration for v in velocity], [brakes_s] * 2)
        )
        assert min(abs(one - other) for one, other in (apart_rest, line_rest)) <= 1000.0
