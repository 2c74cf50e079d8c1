"""The last check on axes that are coupled, and the straight line on which they brake."""

from dataclasses import replace
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.coupling import AxisSum, Condition, CoupledLimit
from safety.limits import CountLimits, CoupledViolation, at_rest, braking_together_s
from safety.permit import PermittedStep, is_genuine, permit
from tests.safety.examples import examples

LIMITS = CountLimits(-100_000, 100_000, 20_000, 200_000, 2_000)
STEP_NS = 25_000_000
ORDER = CoupledLimit("order", AxisSum(((0, 1.0), (1, -1.0))), -1000.0, 1000.0)
GUARD = CoupledLimit(
    "guard", AxisSum(((1, 1.0),)), 0.0, inf, (Condition(AxisSum(((0, 1.0),)), 2000, 500, None),)
)


def ask(
    start: tuple[int, int],
    end: tuple[int, int],
    *,
    coupled: tuple[CoupledLimit, ...] = (ORDER,),
    limits: tuple[CountLimits, CountLimits] = (LIMITS, LIMITS),
) -> PermittedStep | list[str]:
    """The permit of a step that has gone on like this for a while, or what is wrong with it."""
    result = permit(
        from_counts=start,
        to_counts=end,
        measured_counts=start,
        velocities_before=[(b - a) * 40.0 for a, b in zip(start, end, strict=True)],
        begins_ns=0,
        duration_ns=STEP_NS,
        limits=limits,
        coupled=coupled,
    )
    return result if isinstance(result, PermittedStep) else [str(one) for one in result]


BROKEN = ["coupled limit order: the way does not keep to it"]


def test_how_long_it_takes_to_brake_together() -> None:
    weak = replace(LIMITS, max_acceleration=50_000)
    assert braking_together_s([20_000.0, -10_000.0], [LIMITS, LIMITS]) == 0.1
    assert braking_together_s([20_000.0, -10_000.0], [LIMITS, weak]) == 0.2
    assert braking_together_s([0.0, 0.0], [LIMITS, LIMITS]) == 0.0
    assert at_rest(100, 2000.0, 0.1) == 200
    assert at_rest(100, -2000.0, 0.1) == 0
    assert at_rest(100, -25.0, 0.1) == 99
    assert at_rest(100, 2000.0, 0.1, 0.05) == 300
    assert at_rest(100, -2000.0, 0.1, 0.05) == -100


def test_axes_that_are_coupled_brake_on_one_line() -> None:
    beside = CoupledLimit("beside", AxisSum(((0, 0.25), (1, -1.0))), -60.0, 60.0)
    step = ask((0, 0), (400, 100), coupled=(beside,))
    assert isinstance(step, PermittedStep)
    assert is_genuine(step)
    assert step.rest_counts == (1040, 260)  # 16,000 counts/s and 4,000 in 0.08 s
    assert step.decelerations == pytest.approx((200_000, 50_000))
    for share in (0.1, 0.5, 0.9, 1.0, 2.0):
        first, second = step.targets(STEP_NS + round(share * 80_000_000))
        assert abs(first - 4 * second) <= 8
    assert step.velocity(1, STEP_NS + 40_000_000) == pytest.approx(2000)
    assert step.unchanged_ns(1, STEP_NS + 100_000_000) == pytest.approx(STEP_NS + 20_000_000)
    loose = CoupledLimit("loose", AxisSum(((0, 1.0),)), -90_000.0, 90_000.0)
    for coupled in ((beside, loose), (loose, beside)):  # one limit that is near is enough
        near = ask((0, 0), (400, 100), coupled=coupled)
        assert isinstance(near, PermittedStep)
        assert near.rest_counts == (1040, 260)
    back = ask((0, 0), (-401, -101), coupled=(beside,))
    assert isinstance(back, PermittedStep)
    assert back.decelerations == pytest.approx((200_000, 200_000 * 101 / 401))
    assert back.rest_counts == (-1044, -263)


@pytest.mark.parametrize("highest", [None, 1043.9, 1044.1])
def test_far_from_coupled_limits_each_brakes_as_hard_as_it_may(highest: float | None) -> None:
    """Far is where a limit is kept wherever each axis is until it is at rest."""
    ahead = CoupledLimit("ahead", AxisSum(((0, 1.0), (1, 1e-9))), -1000.0, highest or 0.0)
    step = ask((0, 0), (400, 100), coupled=() if highest is None else (ahead,))
    if highest == 1043.9:
        assert step == ["coupled limit ahead: the way does not keep to it"]
        return
    assert isinstance(step, PermittedStep)
    assert step.rest_counts == (1040, 140)
    assert list(step.decelerations) == [200_000, 200_000]


def test_who_stands_would_brake_as_hard_as_it_may() -> None:
    step = ask((0, 0), (200, 0))
    assert isinstance(step, PermittedStep)
    assert list(step.decelerations) == [200_000, 200_000]
    step = ask((0, 0), (0, 0))
    assert isinstance(step, PermittedStep)
    assert list(step.decelerations) == [200_000, 200_000]


@pytest.mark.parametrize(
    ("start", "end", "is_kept"),
    [
        ((0, 0), (100, 0), True),
        ((700, 0), (800, 0), True),
        # 100 a step come to rest 40 further.
        ((852, 0), (952, 0), True),
        ((853, 0), (953, 0), False),
        ((-852, 0), (-952, 0), True),
        ((-853, 0), (-953, 0), False),
        # Together along the bound.
        ((992, 0), (1092, 100), True),
        ((992, 0), (1093, 100), False),
        # Within rounding of it, and outside.
        ((996, 0), (996, 0), True),
        ((996, 0), (995, 0), False),
        ((996, 0), (992, 0), True),
        ((1200, 0), (1199, 0), True),
        ((1200, 0), (1201, 0), False),
    ],
)
def test_coupled_limits_are_checked_to_the_count(
    start: tuple[int, int], end: tuple[int, int], is_kept: bool
) -> None:
    result = ask(start, end)
    assert isinstance(result, PermittedStep) if is_kept else result == BROKEN


def test_all_that_is_broken_is_told() -> None:
    assert ask((992, 0), (2100, -1), coupled=(ORDER, GUARD)) == [
        "axis 0: velocity 44320 is beyond 20000",
        *BROKEN,
        "coupled limit guard: the way does not keep to it",
    ]
    assert CoupledViolation("order").limit == "order"


def test_braking_together_ends_inside_the_travel() -> None:
    narrow = replace(LIMITS, lowest=-300, highest=300)

    def at(start: int, end: int) -> PermittedStep | list[str]:
        """Along a limit that leaves little room beside that line."""
        share = (end - start) / 400
        beside = CoupledLimit("beside", AxisSum(((0, share), (1, -1.0)), start), -60.0, 60.0)
        return ask((0, start), (400, end), coupled=(beside,), limits=(LIMITS, narrow))

    # 100 a step, and in the time of the other axis 160 more.
    assert isinstance(at(40, 140), PermittedStep)
    assert at(41, 141) == ["axis 1: highest place of rest 301 is beyond 300"]
    assert isinstance(at(-40, -140), PermittedStep)
    assert at(-41, -141) == ["axis 1: lowest place of rest -301 is beyond -300"]
    # From beyond it may come back.
    assert isinstance(at(600, 500), PermittedStep)
    assert isinstance(at(-600, -500), PermittedStep)


@examples(200)
@given(
    start=st.tuples(st.integers(-1000, 1000), st.integers(-1000, 1000)),
    change=st.tuples(st.integers(-500, 500), st.integers(-500, 500)),
    moments=st.lists(st.integers(-5, 400), min_size=1, max_size=20),
)
def test_nothing_of_a_permit_is_outside_at_any_moment(
    start: tuple[int, int], change: tuple[int, int], moments: list[int]
) -> None:
    if abs(start[0] - start[1]) > 1000:
        return
    step = ask(start, (start[0] + change[0], start[1] + change[1]))
    if isinstance(step, PermittedStep):
        for moment in moments:
            first, second = step.targets(moment * 1_000_000)
            assert abs(first - second) <= 1000


FAR = CoupledLimit("far", AxisSum(((0, 1.0), (1, -1.0))), -1e6, 1300.0)
GOES_ON = replace(LIMITS, goes_on_s=0.05)
"""Two steps; with 200 counts a step 400 more, beside 160 of braking."""


def test_of_axes_that_go_on_without_a_word_the_way_is_known_to_be_free() -> None:
    going_on = (GOES_ON, GOES_ON)
    for sign in (1, -1):
        inside, outside = (0, -sign * 230), (0, -sign * 240)  # and 200 + 400 + 160, and rounding
        for start, free in ((inside, True), (outside, False)):
            end = (start[0] + sign * 200, start[1])
            step = ask(start, end, limits=going_on)
            assert isinstance(step, PermittedStep) if free else step == BROKEN
            assert isinstance(ask(start, end), PermittedStep), "who is told places stops at the end"


def test_braking_itself_does_not_go_on() -> None:
    step = ask((0, 0), (200, 0), limits=(GOES_ON, GOES_ON))
    assert isinstance(step, PermittedStep)
    assert step.rest_counts == (360, 0)


def test_axes_that_go_on_far_from_their_limit_brake_apart() -> None:
    """Until their going on comes to it, too."""
    for start, together in ((-5000, False), (600, True)):
        step = ask((start, 0), (start + 200, 50), limits=(GOES_ON, GOES_ON), coupled=(FAR,))
        assert isinstance(step, PermittedStep)
        assert (step.decelerations[1] < 200_000) == together
