"""The last check on the counts that will be sent, and who may make a permit."""

import pickle
from copy import copy, deepcopy
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.limits import CountLimits, CoupledViolation, Violation
from safety.permit import PermittedHoming, PermittedStep, is_genuine, permit, permit_homing
from tests.safety.examples import examples

LIMITS = CountLimits(
    lowest=0, highest=100_000, max_velocity=20_000, max_acceleration=200_000, max_lag=2_000
)
PERIOD_NS = 25_000_000
BEGINS_NS = 7_000_000_000


def ask(
    start: int,
    end: int,
    *,
    measured: int | None = None,
    velocity_before: float = 0.0,
    limits: CountLimits = LIMITS,
) -> PermittedStep | tuple[Violation | CoupledViolation, ...]:
    return permit(
        from_counts=[start],
        to_counts=[end],
        measured_counts=[start if measured is None else measured],
        velocities_before=[velocity_before],
        begins_ns=0,
        duration_ns=PERIOD_NS,
        limits=[limits],
    )


def broken(result: PermittedStep | tuple[Violation | CoupledViolation, ...]) -> list[str]:
    return [] if isinstance(result, PermittedStep) else [violation.limit for violation in result]


def test_a_permit_cannot_be_made_elsewhere() -> None:
    with pytest.raises(TypeError, match="only the gate"):
        PermittedStep(object(), (0,), (0,), 0, 1, [LIMITS], together=False)
    with pytest.raises(TypeError, match="only the gate"):
        PermittedHoming(object(), 0, LIMITS, 0, 1)


def some_permits() -> list[PermittedStep | PermittedHoming]:
    step = ask(500, 600)
    assert isinstance(step, PermittedStep)
    return [step, permit_homing(3, LIMITS)]


@pytest.mark.parametrize("kind", [0, 1])
def test_a_permit_is_neither_copied_nor_pickled_nor_changed(kind: int) -> None:
    permitted = some_permits()[kind]
    for copied in (copy, deepcopy):
        with pytest.raises(TypeError, match="cannot be copied"):
            copied(permitted)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        with pytest.raises(TypeError, match="cannot be pickled"):
            pickle.dumps(permitted, protocol)
    for name in (*type(permitted).__slots__, "more"):
        with pytest.raises(AttributeError, match=f"cannot be changed: {name}"):
            setattr(permitted, name, 1)
        with pytest.raises(AttributeError, match=f"cannot be changed: {name}"):
            delattr(permitted, name)
    assert is_genuine(permitted)


@pytest.mark.parametrize("kind", [PermittedStep, PermittedHoming])
def test_nothing_can_be_derived_from_a_permit(kind: type) -> None:
    with pytest.raises(TypeError, match="nothing can be derived"):
        type("Forged", (kind,), {})


@pytest.mark.parametrize("kind", [0, 1])
def test_a_permit_that_was_forged_or_forced_is_known(kind: int) -> None:
    permitted = some_permits()[kind]
    forged = object.__new__(type(permitted))
    assert is_genuine(forged) is False
    for name in type(permitted).__slots__:
        object.__setattr__(forged, name, getattr(permitted, name))
    assert is_genuine(forged) is False
    for name in type(permitted).__slots__:
        permitted = some_permits()[kind]
        object.__setattr__(permitted, name, -1)
        assert is_genuine(permitted) is False, name
    permitted = some_permits()[kind]
    object.__delattr__(permitted, type(permitted).__slots__[0])
    assert is_genuine(permitted) is False
    assert is_genuine("a permit") is False  # type: ignore[arg-type]
    assert is_genuine([]) is False  # type: ignore[arg-type]


def test_a_homing_is_no_faster_than_the_limits() -> None:
    permitted = permit_homing(3, LIMITS)
    assert (permitted.axis, permitted.max_velocity, permitted.max_acceleration) == (
        3,
        20_000,
        200_000,
    )


@pytest.mark.parametrize(
    ("t_ns", "fresh"),
    [
        (-1, False),
        (0, True),
        (PERIOD_NS // 2, True),
        (PERIOD_NS // 2 + 1, False),
        (PERIOD_NS, False),
    ],
)
def test_a_step_is_fresh_for_half_of_its_time(t_ns: int, fresh: bool) -> None:
    step = permit(
        from_counts=[500],
        to_counts=[600],
        measured_counts=[500],
        velocities_before=[0.0],
        begins_ns=BEGINS_NS,
        duration_ns=PERIOD_NS,
        limits=[LIMITS],
    )
    assert isinstance(step, PermittedStep)
    assert step.is_fresh(BEGINS_NS + t_ns) is fresh


@pytest.mark.parametrize("share", [-1.0, 0.0, 0.3, 0.5, 1.0, 1.5])
def test_the_targets_of_all_axes_are_those_of_each(share: float) -> None:
    step = permit(
        from_counts=[50_000, 20_000],
        to_counts=[50_100, 19_933],
        measured_counts=[50_000, 20_000],
        velocities_before=[0.0, 0.0],
        begins_ns=BEGINS_NS,
        duration_ns=PERIOD_NS,
        limits=[LIMITS, LIMITS],
    )
    assert isinstance(step, PermittedStep)
    t_ns = BEGINS_NS + round(share * PERIOD_NS)
    assert step.targets(t_ns) == (step.target(0, t_ns), step.target(1, t_ns))


@pytest.mark.parametrize("change", [-500, -7, -1, 0, 1, 7, 500])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.45, 0.55, 0.99, 1.0])
def test_a_target_is_the_whole_count_nearest_to_even_motion_up_as_down(
    change: int, share: float
) -> None:
    step = permit(
        from_counts=[50_000],
        to_counts=[50_000 + change],
        measured_counts=[50_000],
        velocities_before=[change * 1e9 / PERIOD_NS],
        begins_ns=BEGINS_NS,
        duration_ns=PERIOD_NS,
        limits=[LIMITS],
    )
    assert isinstance(step, PermittedStep)
    told = step.target(0, BEGINS_NS + round(share * PERIOD_NS)) - 50_000
    assert abs(told - share * change) <= 0.5


@pytest.mark.parametrize(
    ("start", "end", "measured", "velocity_before", "limit"),
    [
        (50_000, 50_100, 50_000, 0.0, None),
        (99_990, 100_000, 99_990, 0.0, None),
        (99_990, 100_001, 99_990, 0.0, "highest position"),
        (10, 0, 10, 0.0, None),
        (10, -1, 10, 0.0, "lowest position"),
        (50_000, 50_500, 50_000, 20_000.0, None),
        (50_000, 50_501, 50_000, 20_000.0, None),
        (50_000, 50_502, 50_000, 20_000.0, "velocity"),
        (50_000, 49_498, 50_000, -20_000.0, "velocity"),
        (50_000, 50_127, 50_000, 0.0, None),
        (50_000, 50_128, 50_000, 0.0, "acceleration"),
        (50_000, 50_000, 50_000, 20_000.0, "acceleration"),
        (50_000, 50_000, 52_000, 0.0, None),
        (50_000, 50_000, 52_001, 0.0, "distance from measured"),
        (50_000, 50_000, 47_999, 0.0, "distance from measured"),
    ],
)
def test_each_limit_is_checked_to_the_count(
    start: int, end: int, measured: int, velocity_before: float, limit: str | None
) -> None:
    found = broken(ask(start, end, measured=measured, velocity_before=velocity_before))
    assert found == ([limit] if limit else [])


def test_an_axis_outside_its_travel_may_come_back_but_not_go_further() -> None:
    assert broken(ask(101_000, 100_950)) == []
    assert broken(ask(101_000, 101_001)) == ["highest position"]
    assert broken(ask(-500, -450)) == []
    assert broken(ask(-500, -501)) == ["lowest position"]


def test_all_broken_limits_of_all_axes_are_named() -> None:
    result = permit(
        from_counts=[0, 0],
        to_counts=[-5000, 100_001],
        measured_counts=[0, 0],
        velocities_before=[0.0, 0.0],
        begins_ns=0,
        duration_ns=PERIOD_NS,
        limits=[LIMITS, LIMITS],
    )
    assert not isinstance(result, PermittedStep)
    assert {violation.axis for violation in result if isinstance(violation, Violation)} == {0, 1}
    assert "lowest position -5000 is beyond 0" in str(result[0])


@pytest.mark.parametrize("velocity", [float("nan"), float("inf")])
def test_what_is_not_finite_is_not_permitted(velocity: float) -> None:
    assert broken(ask(500, 500, velocity_before=velocity)) == ["acceleration"]


@pytest.mark.parametrize("wrong", [1.0, True, None])
def test_targets_are_whole_counts(wrong: object) -> None:
    with pytest.raises(ValueError, match="whole counts"):
        ask(500, wrong)  # type: ignore[arg-type]


def test_a_step_has_one_number_per_axis_and_a_duration() -> None:
    changes: list[dict[str, object]] = [
        {"from_counts": []},
        {"velocities_before": []},
        {"duration_ns": 0},
        {"limits": [LIMITS, replace(LIMITS)]},
    ]
    for change in changes:
        arguments: dict[str, object] = {
            "from_counts": [0],
            "to_counts": [0],
            "measured_counts": [0],
            "velocities_before": [0.0],
            "begins_ns": 0,
            "duration_ns": 1,
            "limits": [LIMITS],
        }
        with pytest.raises(ValueError, match="a step needs"):
            permit(**{**arguments, **change})  # type: ignore[arg-type]


@examples(100)
@given(
    start=st.integers(0, 100_000),
    change=st.integers(-500, 500),
    at=st.floats(-1.0, 12.0),
)
def test_a_step_stays_between_its_start_and_where_it_comes_to_rest(
    start: int, change: int, at: float
) -> None:
    step = ask(start, start + change, velocity_before=change / 0.025)
    if isinstance(step, PermittedStep):
        target, rest = step.target(0, round(at * PERIOD_NS)), step.rest_counts[0]
        assert min(start, rest) <= target <= max(start, rest)
        assert (target - start) * change >= 0
        assert LIMITS.lowest <= rest <= LIMITS.highest
        assert abs(rest - start - change) <= (change / 0.025) ** 2 / 400_000


@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_is_even_and_then_brakes(sign: int) -> None:
    step = ask(1000, 1000 + 100 * sign)
    assert isinstance(step, PermittedStep)
    half, brakes_ns = PERIOD_NS // 2, 20_000_000
    times = (-5, 0, half, PERIOD_NS, PERIOD_NS + brakes_ns // 2, PERIOD_NS + brakes_ns, 10**12)
    assert [step.target(0, t) for t in times] == [
        1000 + sign * way for way in (0, 0, 50, 100, 130, 140, 140)
    ]
    assert [step.velocity(0, t) for t in times] == pytest.approx(
        [0, sign * 4000, sign * 4000, sign * 4000, sign * 2000, 0, 0]
    )
    assert step.rest_counts == (1000 + sign * 140,)
    assert list(step.decelerations) == [200_000]
    assert [step.unchanged_ns(0, t) for t in times] == [
        0,
        0,
        half,
        PERIOD_NS,
        PERIOD_NS,
        PERIOD_NS,
        10**12 - brakes_ns,
    ]


@pytest.mark.parametrize(
    ("start", "end", "rest"),
    [(99_900, 99_995, 100_000), (100, 5, 0), (100_500, 100_450, 100_440), (-500, -450, -440)],
)
def test_braking_after_a_step_ends_inside_the_travel(start: int, end: int, rest: int) -> None:
    step = ask(start, end, velocity_before=(end - start) / 0.025)
    assert isinstance(step, PermittedStep)
    assert step.rest_counts == (rest,)
    assert step.target(0, 10 * PERIOD_NS) == rest


def test_an_axis_outside_its_travel_that_stands_stays_where_it_is() -> None:
    for place in (100_500, -500):
        step = ask(place, place)
        assert isinstance(step, PermittedStep)
        assert step.rest_counts == (place,)
        assert step.target(0, 10 * PERIOD_NS) == place


@pytest.mark.parametrize("end", [2**31, -(2**31) - 1])
def test_counts_that_a_drive_cannot_have_are_not_permitted(end: int) -> None:
    beyond = ask(end, end)
    assert broken(beyond) == ["32-bit counts", "32-bit counts"]
    back = ask(end, end - 1 if end > 0 else end + 1)
    assert broken(back) == ["32-bit counts"]
    inside = end - 1 if end > 0 else end + 1
    assert broken(ask(inside, inside)) == []


@pytest.mark.parametrize(
    "limits",
    [
        (1, 0, 1, 1, 1),
        (-(2**31) - 1, 0, 1, 1, 1),
        (0, 2**31, 1, 1, 1),
        (0, 1, 0, 1, 1),
        (0, 1, 1, 0, 1),
        (0, 1, 1, 1, 0),
        (0, 1, -1, 1, 1),
    ],
)
def test_what_is_no_limit_is_refused(limits: tuple[int, int, int, int, int]) -> None:
    with pytest.raises(ValueError, match=r"32 bits|above 0"):
        CountLimits(*limits)


def test_limits_may_be_as_wide_as_the_counts_and_as_narrow_as_nothing() -> None:
    CountLimits(-(2**31), 2**31 - 1, 1, 1, 1)
    CountLimits(7, 7, 1, 1, 1)


def test_a_velocity_is_that_of_the_step_whenever_it_begins() -> None:
    fast = CountLimits(0, 2_000_000_000, 2_000_000_000, 2_000_000_000, 2_000_000_000)
    step = permit(
        from_counts=[0],
        to_counts=[2_000_000_000],
        measured_counts=[0],
        velocities_before=[0.0],
        begins_ns=7_000_000_000,
        duration_ns=1_000_000_000,
        limits=[fast],
    )
    assert isinstance(step, PermittedStep)
    assert step.velocity(0, 7_500_000_000) == 2_000_000_000
    assert step.target(0, 7_500_000_000) == 1_000_000_000


def test_how_long_a_velocity_has_not_changed_counts_from_the_steps_own_beginning() -> None:
    step = permit(
        from_counts=[1000],
        to_counts=[1100],
        measured_counts=[1000],
        velocities_before=[0.0],
        begins_ns=BEGINS_NS,
        duration_ns=PERIOD_NS,
        limits=[LIMITS],
    )
    assert isinstance(step, PermittedStep)
    assert [step.unchanged_ns(0, BEGINS_NS + t) for t in (-7, 0, 7, PERIOD_NS, 2 * PERIOD_NS)] == [
        0,
        0,
        7,
        PERIOD_NS,
        PERIOD_NS + PERIOD_NS - 20_000_000,
    ]
    assert step.velocity(0, BEGINS_NS - 1) == 0.0
    assert step.velocity(0, BEGINS_NS) == 4000.0
