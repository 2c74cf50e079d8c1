"""The shaft: how it follows, and what stands in its way."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.devices.drive.axis.shaft import Shaft
from sim_backends.devices.drive.axis.trajectory import Piece

MS = 1_000_000
LAG_S = 0.004


def shaft(low: float = -1e9, high: float = 1e9) -> Shaft:
    made = Shaft(0.0, low, high, LAG_S)
    made.set_limit(400.0)
    made.energise()
    return made


def integrated(demand_velocity: Callable[[float], float], seconds: float) -> float:
    """Position of a first-order lag, by small steps."""
    demand = position = 0.0
    step_s = 2e-6
    for index in range(round(seconds / step_s)):
        demand += demand_velocity((index + 0.5) * step_s) * step_s
        position += (demand - position) / LAG_S * step_s
    return position


def test_it_follows_as_a_first_order_lag() -> None:
    made = shaft()
    made.follow([Piece(0.05, 0.0, 10_000.0), Piece(0.05, 500.0, 0.0)], None)
    made.advance(80 * MS)
    expected = integrated(lambda t_s: min(500.0, 10_000.0 * t_s), 0.08)
    assert made.position == pytest.approx(expected, abs=0.01)
    assert made.following_error == pytest.approx(500.0 * LAG_S, rel=0.01)


@given(st.lists(st.integers(1, 30 * MS), min_size=1, max_size=20))
def test_it_makes_no_difference_how_often_it_is_asked(steps: list[int]) -> None:
    one, other = shaft(), shaft()
    for made in (one, other):
        made.follow([Piece(0.05, 0.0, 10_000.0), Piece(0.05, 500.0, -10_000.0)], 25.0)
    for step in steps:
        one.advance(one.t_ns + step)
    other.advance(one.t_ns)
    assert one.position == pytest.approx(other.position, abs=1e-6)
    assert one.demand == pytest.approx(other.demand, abs=1e-6)


def test_a_profile_ends_exactly_where_it_should_and_comes_to_rest() -> None:
    made = shaft()
    made.follow([Piece(0.1, 0.0, 1000.0), Piece(0.1, 100.0, -1000.0)], 10.0)
    made.advance(1000 * MS)
    assert made.demand == 10.0
    assert made.position == pytest.approx(10.0, abs=1e-6)
    assert not made.moving
    assert made.velocity == pytest.approx(0.0, abs=1e-3)


def test_straight_to_a_target_in_one_period_and_wait_there() -> None:
    made = shaft()
    made.interpolate(100.0, 10 * MS)
    made.advance(5 * MS)
    assert made.demand == pytest.approx(50.0)
    made.advance(50 * MS)
    assert made.demand == 100.0
    assert made.position == pytest.approx(100.0, abs=0.01)


def test_without_torque_it_stands() -> None:
    made = shaft()
    made.interpolate(100.0, 10 * MS)
    made.advance(5 * MS)
    made.release()
    stood = made.position
    made.advance(100 * MS)
    assert made.position == made.demand == stood
    assert made.torque_nmm == 0.0


@pytest.mark.parametrize(("target", "stop", "side"), [(-100.0, -30.0, -1), (100.0, 40.0, 1)])
def test_a_mechanical_stop_stops_it_and_the_motor_pushes(
    target: float, stop: float, side: int
) -> None:
    made = shaft(-30.0, 40.0)
    made.interpolate(target, 10 * MS)
    made.advance(100 * MS)
    assert made.position == stop
    assert made.pushing == side
    assert made.torque_nmm == side * 400.0
    assert made.velocity == 0.0
    made.interpolate(0.0, 10 * MS)
    made.advance(300 * MS)
    assert made.position == pytest.approx(0.0, abs=1e-3)
    assert made.pushing == 0


def test_jammed_it_stays_where_it_is_until_it_is_free() -> None:
    made = shaft()
    made.interpolate(100.0, 10 * MS)
    made.advance(5 * MS)
    made.block(True)
    stuck = made.position
    made.advance(50 * MS)
    assert made.position == stuck
    assert made.following_error == pytest.approx(100.0 - stuck)
    made.block(False)
    made.advance(150 * MS)
    assert made.position == pytest.approx(100.0, abs=0.01)


@pytest.mark.parametrize("load", [250.0, -250.0])
def test_the_motor_holds_its_load(load: float) -> None:
    made = shaft()
    made.set_load(load)
    assert made.torque_nmm == load
    made.interpolate(100.0, 10 * MS)
    made.advance(100 * MS)
    assert made.position == pytest.approx(100.0, abs=0.01)


def test_against_too_much_load_it_stalls_but_can_give_way() -> None:
    made = shaft()
    made.set_load(500.0)  # pushes down, with more than the motor has
    made.interpolate(100.0, 10 * MS)
    made.advance(50 * MS)
    assert made.position == 0.0
    assert made.torque_nmm == 400.0
    made.interpolate(-100.0, 10 * MS)
    made.advance(150 * MS)
    assert made.position == pytest.approx(-100.0, abs=0.01)
    made.set_load(100.0)
    made.interpolate(50.0, 10 * MS)
    made.advance(300 * MS)
    assert made.position == pytest.approx(50.0, abs=0.01)


def test_a_lower_torque_limit_makes_the_same_load_too_much() -> None:
    made = shaft()
    made.set_load(300.0)
    made.set_limit(200.0)
    made.interpolate(100.0, 10 * MS)
    made.advance(50 * MS)
    assert made.position == 0.0


def test_a_hand_turns_it_within_its_stops() -> None:
    made = shaft(-30.0, 40.0)
    made.release()
    made.drag_to(25.0)
    assert made.position == made.demand == 25.0
    made.drag_to(100.0)
    assert made.position == 40.0


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("go"), st.floats(-200, 200)),
            st.tuples(st.just("load"), st.floats(-600, 600)),
            st.tuples(st.just("block"), st.floats(-1, 1)),
            st.tuples(st.just("wait"), st.floats(0.1, 50)),
        ),
        max_size=40,
    )
)
def test_it_never_leaves_its_stops_nor_gives_more_torque_than_it_has(
    events: list[tuple[str, float]],
) -> None:
    made = shaft(-100.0, 100.0)
    for what, amount in events:
        if what == "go":
            made.interpolate(amount, 10 * MS)
        elif what == "load":
            made.set_load(amount)
        elif what == "block":
            made.block(amount > 0)
        else:
            made.advance(made.t_ns + round(amount * MS))
        assert -100.0 <= made.position <= 100.0
        assert abs(made.torque_nmm) <= 400.0
