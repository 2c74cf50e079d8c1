"""A step that leads too near to something goes along it, and nothing else is changed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daemon.control.avoidance import avoid
from drivers.pose import Vector
from safety.risk_source import Clearance

DT_S = 0.025
FAST = np.array([5.0, 5.0])
HERE = np.zeros(2)


def towards_x(clearance_mm: float) -> Clearance:
    """A wall that the first axis leads to."""
    return Clearance((0.0, 0.0), clearance_mm, (-2.0, 0.0))


def test_far_from_everything_a_step_stays_as_it_is() -> None:
    assert avoid(np.array([0.1, 0.1]), HERE, towards_x(9.0), FAST, DT_S) is None


def test_away_from_it_a_step_stays_as_it_is_however_near_it_is() -> None:
    assert avoid(np.array([-0.1, 0.1]), HERE, towards_x(0.6), FAST, DT_S) is None


def test_near_it_what_leads_along_is_left_and_what_leads_there_is_not() -> None:
    step = avoid(np.array([0.1, 0.1]), HERE, towards_x(0.5), FAST, DT_S)
    assert step == pytest.approx([0.0, 0.1])


def test_there_is_always_a_tenth_of_the_room_left_to_come_nearer() -> None:
    step = avoid(np.array([1.0, 0.0]), HERE, towards_x(2.5), FAST, DT_S)
    assert step == pytest.approx([0.1 * 2.0 / 2.0, 0.0])


def test_where_it_is_too_near_it_is_led_away() -> None:
    step = avoid(np.array([0.0, 0.1]), HERE, towards_x(-0.5), FAST, DT_S)
    assert step == pytest.approx([-0.1 * 1.0 / 2.0, 0.1])


def test_the_room_is_that_of_the_place_where_the_step_begins() -> None:
    further = avoid(np.array([0.1, 0.0]), np.array([0.5, 0.0]), towards_x(1.5), FAST, DT_S)
    assert further == pytest.approx([0.0, 0.0])


def test_the_faster_axis_is_turned_aside_more() -> None:
    clearance = Clearance((0.0, 0.0), 0.5, (-1.0, -1.0))
    step = avoid(np.array([0.1, 0.1]), HERE, clearance, np.array([10.0, 5.0]), DT_S)
    assert step is not None
    assert step - 0.1 == pytest.approx([-0.16, -0.04])


def test_where_no_axis_gains_room_the_gate_alone_decides() -> None:
    nowhere = Clearance((0.0, 0.0), 0.1, (-0.1, 0.0))
    assert avoid(np.array([0.1, 0.0]), HERE, nowhere, FAST, DT_S) is None


numbers = st.floats(-1.0, 1.0)


@given(
    arrays(float, 3, elements=numbers),
    arrays(float, 3, elements=st.floats(-5.0, 5.0)),
    st.floats(-2.0, 10.0),
)
def test_room_never_gets_less_faster_than_it_may(
    delta_u: Vector, slope: Vector, clearance_mm: float
) -> None:
    clearance = Clearance((0.0, 0.0, 0.0), clearance_mm, tuple(slope.tolist()))
    step = avoid(delta_u, np.zeros(3), clearance, np.full(3, 5.0), DT_S)
    least = -0.1 * (clearance_mm - 0.5)
    if step is not None:
        assert float(slope @ step) == pytest.approx(least, abs=1e-9)
        assert float(slope @ delta_u) < least
    elif np.linalg.norm(slope) > 0.2:
        assert float(slope @ delta_u) >= least
