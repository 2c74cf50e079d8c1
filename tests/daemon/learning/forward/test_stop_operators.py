"""What friction keeps back where a body turns: of a motion that goes on nothing more, of one that
turns a part, and small turns leave no trace."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.learning.forward.stop_operators import StopOperators, free_places, stretched
from drivers.pose import Vector

SHARES = np.array([0.0, 0.3, 0.9])
AXES = 3
PLACES = st.lists(
    st.lists(st.floats(0.0, 1.0), min_size=AXES, max_size=AXES), min_size=2, max_size=12
)
MOST = 0.9 * 0.17 * 0.625 * float(np.exp(1.6 * 0.6))
"""Of the travel: the largest share, with the mean of the reaches, at the lower end."""


def together(*places: float) -> Vector:
    """(n, AXES) of axes that all go alike."""
    return np.repeat(np.array(places)[:, None], AXES, axis=1)


def followed(places: Vector) -> Vector:
    """(n, k, m) free places, by each share."""
    stops = StopOperators(SHARES)
    return np.array([stops.follow(place) for place in places])


def test_where_axes_rest_first_nothing_is_held_back() -> None:
    free = followed(together(0.7, 0.7))
    np.testing.assert_array_equal(free, np.full_like(free, 0.7))


@given(PLACES)
def test_a_body_without_friction_is_where_its_axes_are(places: list[list[float]]) -> None:
    u = np.array(places)
    np.testing.assert_allclose(followed(u)[:, 0], u, atol=1e-9)


@given(PLACES)
def test_no_more_is_held_back_than_the_stops_reach(places: list[list[float]]) -> None:
    u = np.array(places)
    assert np.abs(followed(u) - u[:, None]).max() <= MOST


@given(PLACES, st.integers(2, 7))
def test_it_does_not_matter_how_fast_or_in_how_many_steps(
    places: list[list[float]], parts: int
) -> None:
    u = np.array(places)
    between = np.linspace(0.0, 1.0, parts, endpoint=False)[:, None, None]
    steps = np.swapaxes(u[:-1] + between * np.diff(u, axis=0), 0, 1).reshape(-1, AXES)
    at_once = followed(u)[-1]
    np.testing.assert_allclose(followed(np.concatenate([steps, u[-1:]]))[-1], at_once, atol=0.02)


def test_a_way_without_turns_moves_the_body_as_if_there_were_no_friction() -> None:
    free = followed(together(*np.linspace(0.1, 0.9, 81)))
    np.testing.assert_allclose(np.diff(free, axis=0)[-20:, 1], 0.01, atol=0.001)


@pytest.mark.parametrize("share", [1, 2])
def test_after_a_turn_less_of_a_motion_shows_until_all_has_slipped(share: int) -> None:
    free = followed(together(0.2, 0.7, 0.69, 0.1, 0.09))
    turned = (free[2] - free[1])[share] / -0.01
    np.testing.assert_allclose(turned, 1.0 / (1.0 + SHARES[share]), atol=0.15)
    np.testing.assert_allclose((free[4] - free[3])[share], -0.01, atol=0.003)


def test_a_small_excursion_leaves_no_trace() -> None:
    """What they were before a loop they are after it: hysteresis wipes out small turns."""
    before, away, after = followed(together(0.1, 0.6, 0.57, 0.6))[1:]
    assert np.abs(away - before)[1:].min() > 0.01
    np.testing.assert_allclose(after, before, atol=1e-3)


def test_what_stretches_all_of_a_body_drags_more_than_what_bends_it() -> None:
    start = np.full(AXES, 0.5)
    stretching, bending = np.array([0.01, 0.01, 0.01]), np.array([0.02, -0.01, -0.01])
    shows = [
        (followed(np.array([start, start + way]))[1, 2] - start) / way
        for way in (stretching, bending)
    ]
    assert shows[0].max() < shows[1].min() - 0.05
    np.testing.assert_allclose(stretched(stretching), stretching)
    np.testing.assert_allclose(stretched(bending), 0.55 * bending)


def test_friction_holds_less_of_an_axis_back_where_its_gas_is_pressed_together() -> None:
    held = [abs(float(followed(together(at, at + 0.01))[1, 2, 0]) - at - 0.01) for at in (0.2, 0.8)]
    assert held[1] < 0.65 * held[0]


def test_what_the_next_motion_takes_is_known_before_it_is_made() -> None:
    """But for where a stop is just about to slip."""
    random, number, known = np.random.default_rng(3), 2, list[bool]()
    for _ in range(200):
        stops, place = StopOperators(SHARES), np.zeros(AXES)
        for place in random.uniform(0.0, 1.0, (random.integers(2, 10), AXES)):
            stops.follow(place)
        way = 1e-6 * random.choice([-1.0, 1.0], AXES)
        needed = stops.needed(0.5 + 0.5 * np.sign(stretched(way)), number)
        free = stops.follow(place)[number]
        moved = stops.follow(place + way)[number] - free
        known.append(bool(np.abs(needed @ moved - way).max() < 1e-8))
    assert np.mean(known) > 0.97


def test_before_anything_is_seen_axes_go_as_far_as_the_body() -> None:
    np.testing.assert_array_equal(StopOperators(SHARES).needed(np.ones(AXES), 1), np.eye(AXES))


def test_the_places_of_a_table_are_those_of_axes_that_are_followed() -> None:
    places = np.random.default_rng(2).uniform(0.0, 1.0, (30, AXES))
    np.testing.assert_allclose(free_places(places, 0.9), followed(places)[:, 2], atol=1e-9)
