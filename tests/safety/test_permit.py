"""The last check on the counts that will be sent, and who may make a permit."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.limits import CountLimits, Violation
from safety.permit import PermittedHoming, PermittedStep, permit, permit_homing
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
) -> PermittedStep | tuple[Violation, ...]:
    return permit(
        from_counts=[start],
        to_counts=[end],
        measured_counts=[start if measured is None else measured],
        velocities_before=[velocity_before],
        begins_ns=0,
        duration_ns=PERIOD_NS,
        limits=[limits],
    )


def broken(result: PermittedStep | tuple[Violation, ...]) -> list[str]:
    return [] if isinstance(result, PermittedStep) else [violation.limit for violation in result]


def test_a_permit_cannot_be_made_elsewhere() -> None:
    with pytest.raises(TypeError, match="only the gate"):
        PermittedStep(object(), (0,), (0,), 0, 1)
    with pytest.raises(TypeError, match="only the gate"):
        PermittedHoming(object(), 0)
    assert permit_homing(3).axis == 3


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


def test_a_permit_cannot_be_subclassed_into_something_else() -> None:
    step = ask(500, 600)
    assert isinstance(step, PermittedStep)
    with pytest.raises(AttributeError):
        step.more = 1  # type: ignore[attr-defined]


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
    assert {violation.axis for violation in result} == {0, 1}
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
    at=st.floats(-1.0, 2.0),
)
def test_between_its_ends_a_step_stays_between_its_ends(start: int, change: int, at: float) -> None:
    step = ask(start, start + change, velocity_before=change / 0.025)
    if isinstance(step, PermittedStep):
        target = step.target(0, round(at * PERIOD_NS))
        assert min(start, start + change) <= target <= max(start, start + change)


def test_a_step_is_even_and_ends_at_rest() -> None:
    step = ask(1000, 1100)
    assert isinstance(step, PermittedStep)
    assert [step.target(0, t) for t in (-5, 0, PERIOD_NS // 2, PERIOD_NS, 2 * PERIOD_NS)] == [
        1000,
        1000,
        1050,
        1100,
        1100,
    ]
    assert [step.velocity(0, t) for t in (-5, 0, PERIOD_NS)] == [0, 4000, 0]


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
