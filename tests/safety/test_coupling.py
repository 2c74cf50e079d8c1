"""Coupled limits: where a way of several axes may end, from where it begins."""

from math import inf, nan

import pytest

from safety.coupling import (
    AxisSum,
    Condition,
    CoupledLimit,
    broken,
    kept,
    kept_apart,
    ranges,
    room_alone,
)
from safety.limits import CountLimits
from safety.permit import permit_homing

# 4 counts of rounding on each axis that a sum is made of, and 0.5 and 0.25 per count.
DIFFERENCE = AxisSum(((0, 0.5), (1, -0.5)), 1.0)
ALONE = AxisSum(((2, 0.25),))
ROUNDING = 4.0
"""Of the difference."""
SLAB = CoupledLimit("slab", DIFFERENCE, 0.0, 100.0)


def test_a_sum_is_its_constant_and_each_axis_times_its_factor() -> None:
    assert DIFFERENCE.at([10, 4, 7]) == 4.0
    assert ALONE.at([10, 4, 8]) == 2.0
    assert DIFFERENCE.rounding == ROUNDING
    assert ALONE.rounding == 1.0


def test_a_sum_stands_where_all_its_axes_do() -> None:
    assert DIFFERENCE.stands([1, 2, 3], [1, 2, 9])
    assert not DIFFERENCE.stands([1, 2, 3], [1, 3, 3])
    assert not DIFFERENCE.stands([1, 2, 3], [2, 3, 3])  # even where the sum is the same


def turned(near: float = 10.0, within: float = 2.0, period: float | None = 20.0) -> Condition:
    return Condition(ALONE, near, within, period)


@pytest.mark.parametrize(
    ("value", "beside"),
    [
        (10.0, None),
        (8.001, None),
        (11.999, None),
        (12.0, (12.0, 28.0)),
        (8.0, (-8.0, 8.0)),
        (20.0, (12.0, 28.0)),
        (0.0, (-8.0, 8.0)),
        (-8.0, (-8.0, 8.0)),
        (-9.0, None),
        (30.5, None),
        (209.0, None),
        (212.0, (212.0, 228.0)),
        (-213.0, (-228.0, -212.0)),
    ],
)
def test_a_value_is_in_a_band_or_between_two(
    value: float, beside: tuple[float, float] | None
) -> None:
    assert turned().beside(value) == beside


@pytest.mark.parametrize(
    ("value", "beside"),
    [(10.0, None), (11.9, None), (12.0, (12.0, inf)), (8.0, (-inf, 8.0)), (-400.0, (-inf, 8.0))],
)
def test_without_a_period_there_is_one_band(
    value: float, beside: tuple[float, float] | None
) -> None:
    assert turned(period=None).beside(value) == beside


@pytest.mark.parametrize(("value", "middle"), [(10.0, 10.0), (19.9, 10.0), (20.0, 30.0), (-1, -10)])
def test_the_band_that_is_nearest(value: float, middle: float) -> None:
    assert turned().middle(value) == middle


# What is a limit at all.


def limit(
    terms: tuple[tuple[int, float], ...] = ((0, 1.0), (1, -1.0)),
    lowest: float = 0.0,
    highest: float = 100.0,
    constant: float = 0.0,
    only_while: tuple[Condition, ...] = (),
) -> CoupledLimit:
    return CoupledLimit("it", AxisSum(terms, constant), lowest, highest, only_while)


def test_what_is_a_limit_is_let_be() -> None:
    limit().check(2)
    limit(lowest=-inf).check(2)
    limit(highest=inf).check(2)
    limit(highest=16.01).check(2)
    limit(only_while=(turned(),)).check(3)
    limit(only_while=(turned(period=None),)).check(3)
    limit(only_while=(turned(within=8.99),)).check(3)
    limit(only_while=(turned(within=0.25),)).check(3)
    limit(terms=((0, 0.1), (1, -0.1)), highest=1.7).check(2)
    limit(only_while=(Condition(AxisSum(((0, 0.1),)), 0.0, 1.0, 2.9),)).check(2)
    limit(lowest=60.0, highest=100.0).check(2)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (limit(terms=()), "it: a sum is made of axes that there are"),
        (limit(terms=((2, 1.0),)), "a sum is made of axes that there are"),
        (limit(terms=((0, 1.0), (-1, 1.0))), "a sum is made of axes that there are"),
        (limit(terms=((0, 0.0),)), "it: a factor is finite and not zero"),
        (limit(terms=((0, 1.0), (1, inf))), "a factor is finite and not zero"),
        (limit(terms=((0, nan),)), "a factor is finite and not zero"),
        (limit(constant=nan), "it: a sum is finite"),
        (limit(only_while=(Condition(AxisSum(((0, 0.1),)), 0.0, 1.0, 2.8),)), "no room"),
        (limit(only_while=(Condition(AxisSum(((0, 1.0),)), 0.0, nan, None),)), "no room"),
        (limit(highest=16.0), "it: between its bounds there is no room for whole counts"),
        (limit(lowest=nan), "no room for whole counts"),
        (limit(lowest=50.0, highest=0.0), "no room for whole counts"),
        (limit(only_while=(turned(),)), "a sum is made of axes that there are"),
        (
            limit(only_while=(Condition(AxisSum(((0, 1.0),)), 0.0, 0.0, None),)),
            "it: beside a condition's bands there is no room",
        ),
        (
            limit(only_while=(Condition(AxisSum(((0, 1.0),)), 0.0, 6.0, 20.0),)),
            "beside a condition's bands there is no room",
        ),
    ],
)
def test_what_is_no_limit_is_refused(wrong: CoupledLimit, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        wrong.check(2)


# Ways, and what they keep to. The difference is half of axis 0 less half of axis 1, and one.


def place(difference: float, angle: float = 0.0) -> list[int]:
    """Counts where the sums are these."""
    return [round((difference - 1.0) / 0.5), 0, round(angle / 0.25)]


def names(limits: list[CoupledLimit], *way: list[int]) -> list[str]:
    start, end, rest = way if len(way) == 3 else (*way, way[-1])
    return [one.name for one in broken(limits, start, end, rest)]


@pytest.mark.parametrize(
    ("start", "end", "rest", "is_kept"),
    [
        (50.0, 60.0, 70.0, True),
        (50.0, 60.0, 96.0, True),
        (50.0, 60.0, 96.5, False),
        (50.0, 96.5, 90.0, False),
        (50.0, 30.0, 4.0, True),
        (50.0, 30.0, 3.5, False),
        (50.0, 3.5, 30.0, False),
        # Within what rounding may do of a bound: back from there, and no nearer.
        (98.0, 97.0, 96.0, False),
        (98.0, 96.0, 90.0, True),
        (2.0, 3.0, 3.5, False),
        (2.0, 4.0, 5.0, True),
        # Outside: no further out.
        (105.0, 105.5, 104.0, False),
        (105.0, 104.5, 104.0, True),
        (105.0, 104.0, 105.5, False),
        (-5.0, -5.5, -4.0, False),
        (-5.0, -4.5, -4.0, True),
        (-5.0, -4.0, -5.5, False),
        (105.0, 50.0, 3.0, False),
    ],
)
def test_ways_end_inside_or_no_further_out(
    start: float, end: float, rest: float, is_kept: bool
) -> None:
    assert names([SLAB], place(start), place(end), place(rest)) == ([] if is_kept else ["slab"])


def test_who_stands_breaks_nothing_wherever_that_is() -> None:
    for difference in (-5.0, 0.0, 2.0, 98.0, 100.0, 105.0):
        assert names([SLAB], place(difference), place(difference, 40.0)) == []
        moved = place(difference)
        assert not names([SLAB], place(difference), moved, moved)


def test_who_stops_at_the_end_of_a_step_has_still_moved() -> None:
    assert names([SLAB], place(98.0), place(98.0), place(98.5)) == ["slab"]
    assert names([SLAB], place(98.0), place(98.5), place(98.0)) == ["slab"]


def test_outside_axes_may_go_together() -> None:
    start = place(105.3)
    along = [start[0] + 31, start[1] + 31, start[2]]
    assert names([SLAB], start, along) == []
    assert names([SLAB], start, [along[0] + 1, along[1], along[2]]) == ["slab"]
    start = place(-5.3)
    assert names([SLAB], start, [start[0] + 31, start[1] + 31, 0]) == []
    assert names([SLAB], start, [start[0] + 30, start[1] + 31, 0]) == ["slab"]


# A limit that counts only in a band: out of the band, or within the bounds.

GUARD = CoupledLimit("guard", DIFFERENCE, 20.0, inf, (turned(),))


@pytest.mark.parametrize(
    ("start", "end", "is_kept"),
    [
        # Within the bounds any angle is right ...
        ((30.0, 10.0), (25.0, 11.0), True),
        ((30.0, 0.0), (25.0, 10.0), True),
        ((30.0, 10.0), (23.5, 10.0), False),
        # ... and beside the band any difference,
        ((5.0, 0.0), (1.0, 7.0), True),
        ((5.0, 0.0), (1.0, 7.5), False),
        ((5.0, 15.0), (1.0, 13.0), True),
        ((5.0, 15.0), (1.0, 12.5), False),
        ((5.0, 15.0), (1.0, 27.0), True),
        ((5.0, 15.0), (1.0, 27.5), False),
        # on either side of every band, but not across.
        ((5.0, 0.0), (1.0, 15.0), False),
        ((5.0, 200.0), (1.0, 205.0), True),
        # Who is within both goes either way,
        ((30.0, 0.0), (5.0, 5.0), True),
        ((30.0, 0.0), (30.0, 10.0), True),
        # and not both at once.
        ((30.0, 0.0), (5.0, 10.0), False),
        # From the one into the other is a way of two steps.
        ((30.0, 10.0), (5.0, 15.0), False),
        ((5.0, 0.0), (30.0, 10.0), False),
    ],
)
def test_a_guard_is_kept_by_difference_or_by_angle(
    start: tuple[float, float], end: tuple[float, float], is_kept: bool
) -> None:
    found = names([GUARD], place(*start), place(*end))
    assert found == ([] if is_kept else ["guard"])


@pytest.mark.parametrize(
    ("end", "is_kept"),
    [
        ((12.0, 10.5), True),
        ((10.0, 11.0), True),
        ((12.0, 11.0), True),
        ((12.0, 10.25), False),
        ((9.5, 11.0), False),
        ((12.0, 9.0), False),
    ],
)
def test_outside_a_guard_neither_difference_nor_angle_gets_worse(
    end: tuple[float, float], is_kept: bool
) -> None:
    assert names([GUARD], place(10.0, 10.5), place(*end)) == ([] if is_kept else ["guard"])


def test_out_of_a_band_the_nearer_edge_is_the_way() -> None:
    assert names([GUARD], place(10.0, 9.5), place(10.0, 9.0)) == []
    assert names([GUARD], place(10.0, 9.5), place(10.0, 10.0)) == ["guard"]
    assert names([GUARD], place(10.0, 10.0), place(10.0, 11.0)) == []
    assert names([GUARD], place(10.0, 10.0), place(10.0, 9.0)) == ["guard"]


OTHER = AxisSum(((1, 1.0),))
TWICE = CoupledLimit(
    "twice", AxisSum(((0, 1.0),)), 20.0, inf, (turned(), Condition(OTHER, 0.0, 30.0, None))
)


def test_with_several_conditions_it_is_enough_that_one_is_not_met() -> None:
    inside = [0, 0, 0]
    assert names([TWICE], inside, [0, 0, 20]) == []  # beside the first band
    assert names([TWICE], [0, 40, 40], [0, 50, 40]) == []  # beside the second
    assert names([TWICE], [0, 40, 0], [0, 50, 40]) == []  # which one, the way tells
    assert names([TWICE], [0, 40, 0], [0, 0, 20]) == []
    assert names([TWICE], [0, 40, 0], [0, 0, 40]) == ["twice"]
    outside = [0, 4, 41]
    assert names([TWICE], outside, [1, 5, 42]) == []
    for worse in ([-1, 5, 42], [1, 3, 42], [1, 5, 40]):
        assert names([TWICE], outside, worse) == ["twice"]


def test_what_is_broken_is_told_in_order_and_nothing_else() -> None:
    wide = CoupledLimit("wide", DIFFERENCE, -1000.0, 1000.0)
    other = CoupledLimit("other", DIFFERENCE, -inf, 50.0)
    assert names([SLAB, wide, other], place(10.0), place(99.0)) == ["slab", "other"]


def test_of_several_ranges_one_is_enough_and_all_of_it() -> None:
    start, end = place(30.0, 0.0), place(30.0, 10.0)
    allowed = ranges(GUARD, start)
    assert len(allowed) == 2
    assert kept(allowed, start, end, end)
    assert not kept(allowed[1:], start, end, end)
    assert not kept([allowed[0] + allowed[1]], start, end, end)


# Each axis by itself.


def test_a_span_is_that_of_all_corners() -> None:
    assert DIFFERENCE.span([10, 4, 0], [20, 8, 0]) == (2.0, 9.0)
    assert DIFFERENCE.span([10, 4, 0], [4, 0, 9]) == (1.0, 6.0)
    assert DIFFERENCE.span([10, 4, 0], [10, 4, 50]) == (4.0, 4.0)
    assert ALONE.span([0, 0, 8], [0, 0, 9]) == (2.0, 2.25)


@pytest.mark.parametrize(
    ("first", "second", "is_kept"),
    [
        ((100, 0), (188, 4), True),
        ((100, 0), (190, 0), True),
        ((100, 0), (191, 91), False),  # the first might be there before the second begins
        ((100, 0), (106, 6), True),
        ((8, 2), (8, 2), True),
        ((8, 2), (8, 3), False),
        ((10, 2), (10, 4), True),
        ((10, 2), (10, 5), False),
        ((10, 2), (9, 2), True),
        ((10, 2), (7, 2), False),
    ],
)
def test_apart_every_corner_is_inside(
    first: tuple[int, int], second: tuple[int, int], is_kept: bool
) -> None:
    start, rest = (*first, 0), (*second, 77)
    assert kept_apart(ranges(SLAB, start), start, rest) is is_kept


def test_apart_one_side_of_a_guard_is_enough() -> None:
    start = place(30.0, 0.0)
    assert kept_apart(ranges(GUARD, start), start, place(30.0, 10.0))
    assert kept_apart(ranges(GUARD, start), start, place(5.0, 5.0))
    assert not kept_apart(ranges(GUARD, start), start, place(5.0, 10.0))


# One axis alone, as it looks for its zero.


def test_an_axis_alone_has_the_room_that_the_others_leave() -> None:
    # 0.5 (a - b) + 1 from 2 to 98, which is 4 less than the bounds on either side.
    assert room_alone([SLAB], 0, [50, 10, 0]) == (16.0, 200.0)
    assert room_alone([SLAB], 1, [50, 10, 0]) == (-140.0, 44.0)
    assert room_alone([SLAB], 2, [50, 10, 0]) == (-inf, inf)
    assert room_alone([], 0, [50, 10, 0]) == (-inf, inf)


@pytest.mark.parametrize("counts", [[None, 10, 0], [50, None, 0], [None, None, None]])
def test_of_axes_without_a_zero_limits_say_nothing(counts: list[int | None]) -> None:
    assert room_alone([SLAB], 0, counts) == (-inf, inf)
    assert room_alone([GUARD], 2, counts) == (-inf, inf)


def test_where_it_is_already_an_axis_may_be() -> None:
    assert room_alone([SLAB], 0, [300, 10, 0]) == pytest.approx((16.0, 300.0), abs=1e-4)
    assert room_alone([SLAB], 0, [207, 10, 0]) == (16.0, 207.0)
    assert room_alone([SLAB], 0, [9, 10, 0]) == (9.0, 200.0)


def test_of_several_limits_the_narrowest_counts() -> None:
    other = CoupledLimit("other", DIFFERENCE, -inf, 50.0)
    assert room_alone([SLAB, other], 0, [50, 10, 0]) == (16.0, 100.0)
    assert room_alone([other, SLAB], 0, [50, 10, 0]) == (16.0, 100.0)
    lower = CoupledLimit("lower", DIFFERENCE, 10.0, inf)
    assert room_alone([lower, SLAB], 0, [50, 10, 0]) == (36.0, 200.0)


def test_a_guard_leaves_the_wider_of_its_sides() -> None:
    # Within the bounds: any angle. Beside the band and below them: up to it.
    assert room_alone([GUARD], 2, [98, 0, 0]) == (-inf, inf)
    assert room_alone([GUARD], 2, [9, 0, 0]) == (-28.0, 28.0)
    assert room_alone([GUARD], 0, [98, 0, 0]) == (-inf, inf)
    assert room_alone([GUARD], 0, [98, 0, 40]) == (46.0, inf)


# What the permit says of it is in whole counts.


def test_a_homing_is_permitted_as_far_as_coupled_limits_leave_it() -> None:
    limits = CountLimits(-1000, 1000, 5, 7, 9)
    free = permit_homing(1, limits)
    assert (free.lowest, free.highest) == (-(2**31), 2**31 - 1)
    assert (free.axis, free.max_velocity, free.max_acceleration) == (1, 5, 7)
    held = permit_homing(0, limits, [50, 10, 0], [SLAB])
    assert (held.lowest, held.highest) == (16, 200)
    thirds = CoupledLimit("thirds", AxisSum(((0, 0.3),)), -2.0, 7.0)
    held = permit_homing(0, limits, [2, 10, 0], [thirds])
    assert (held.lowest, held.highest) == (-2, 19)
    half = CoupledLimit("half", DIFFERENCE, 2.0, inf)
    held = permit_homing(0, limits, [50, 10, 0], [half])
    assert (held.lowest, held.highest) == (20, 2**31 - 1)
    far = CoupledLimit("far", DIFFERENCE, -1e12, 1e12)
    held = permit_homing(0, limits, [50, 10, 0], [far])
    assert (held.lowest, held.highest) == (-(2**31), 2**31 - 1)


def test_on_its_very_bound_a_guard_is_kept() -> None:
    other = CoupledLimit("other", DIFFERENCE, -inf, 20.0, (turned(),))
    for guard in (GUARD, other):
        assert names([guard], place(20.0, 10.5), place(20.0, 10.25)) == []


def test_apart_who_is_outside_may_not_get_worse_in_anything() -> None:
    start = place(10.0, 10.5)
    assert kept_apart(ranges(GUARD, start), start, place(12.0, 11.0))
    assert not kept_apart(ranges(GUARD, start), start, place(12.0, 10.0))
    assert not kept_apart(ranges(GUARD, start), start, place(9.0, 11.0))


def test_apart_who_stands_may_be_anywhere() -> None:
    start = place(98.0)
    assert kept_apart(ranges(SLAB, start), start, place(98.0, 40.0))
