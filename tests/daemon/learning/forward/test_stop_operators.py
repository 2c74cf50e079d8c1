"""What sticks where axes turn: of a motion that goes on nothing more, of one that turns all."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daemon.learning.forward.stop_operators import StopOperators, sticking_of
from drivers.pose import Vector

PLACES = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=30)
MOST = 0.1875
"""The mean of the reaches."""


def stuck(*places: float) -> list[float]:
    """Changes of what sticks, of one axis that goes to these places one after the other."""
    stops = StopOperators()
    sticks = [float(stops.follow(np.array([place]))[0]) for place in places]
    return list(np.diff([0.0, *sticks]))


@given(PLACES)
def test_what_sticks_is_never_more_than_the_stops_reach(places: list[float]) -> None:
    assert np.abs(np.cumsum(stuck(*places))).max() <= MOST + 1e-12


@given(PLACES)
def test_nothing_sticks_of_more_than_the_way_nor_against_it(places: list[float]) -> None:
    ways, changes = np.diff([places[0], *places]), np.array(stuck(*places))
    assert (changes * ways >= -1e-12).all()
    assert (np.abs(changes) <= np.abs(ways) + 1e-12).all()


def test_where_an_axis_rests_first_nothing_sticks() -> None:
    assert stuck(0.7, 0.7) == [0.0, 0.0]


def test_on_a_way_without_turns_all_stops_slip_one_after_the_other() -> None:
    changes = stuck(0.0, 0.04, 0.08, 0.15, 0.5, 0.9)
    np.testing.assert_allclose(changes[:3], [0.0, 0.04, 0.0325])
    np.testing.assert_allclose(sum(changes[:5]), MOST)
    assert changes[5] == 0.0


def test_after_a_turn_all_of_a_motion_sticks_up_to_twice_the_reach() -> None:
    changes = stuck(0.0, 0.9, 0.85, 0.1)
    np.testing.assert_allclose(changes[2], -0.05)
    np.testing.assert_allclose(sum(changes[2:]), -2.0 * MOST, atol=0.02)


def test_a_small_excursion_leaves_no_trace() -> None:
    """What they were before a loop they are after it: hysteresis wipes out small turns."""
    changes = stuck(0.0, 0.6, 0.55, 0.6)
    np.testing.assert_allclose(changes[2] + changes[3], 0.0, atol=1e-12)


def test_what_the_next_motion_will_stick_is_known_before_it_is_made() -> None:
    stops = StopOperators()
    for place in (0.0, 0.7, 0.62):
        stops.follow(np.array([place]))
    for forth, step in ((1.0, 0.005), (0.0, -0.005)):
        expected = stops.sticking(np.array([forth]))[0]
        np.testing.assert_allclose(expected * step, stuck(0.0, 0.7, 0.62, 0.62 + step)[-1])


def test_motions_of_a_table_stick_as_those_of_the_axes_do() -> None:
    places = np.array([[0.0], [0.3], [0.5], [0.4], [0.45]])
    changes: Vector = sticking_of(places[:-1], np.diff(places, axis=0))
    np.testing.assert_allclose(changes[:, 0], stuck(*places[:, 0].tolist())[1:])
