"""What moves counts wherever it may be: never as farther away than it is, shape by shape."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safety.risk.contact import ContactModel
from safety.risk.model.mixture import FloatArray
from safety.risk.model.shape_basis import SingleArray
from safety.risk.moving_obstacles import (
    NEAR_MM,
    NOTHING_MOVES,
    MovingBall,
    MovingClearance,
    Swept,
)
from safety.risk.shape_kernels import Skin
from tests.safety.examples import examples
from tests.safety.risk.test_contact import at, phi, rod, wall

NODES, SPACING_MM = 9, 12.0
RADIUS = np.linspace(6.0, 3.0, NODES).astype(np.float32)
SAFE = (RADIUS + np.linspace(0.2, 1.0, NODES)).astype(np.float32)
SKIN = Skin(RADIUS, SAFE, np.float32(1.0))
ARC: FloatArray = np.arange(0.0, SPACING_MM * NODES, SPACING_MM)

PLACES = st.tuples(st.floats(-40, 40, width=32), st.floats(-40, 40, width=32),
                   st.floats(-30, 130, width=32))  # fmt: skip
SPEEDS = st.tuples(*[st.floats(-80.0, 80.0, width=32)] * 3)
BALLS = st.lists(st.builds(MovingBall, PLACES, st.floats(1.0, 15.0, width=32), SPEEDS), max_size=4)


def shapes(seed: int, count: int = 40) -> SingleArray:
    """(count, 3·NODES) of bent bodies whose nodes are SPACING_MM apart."""
    random = np.random.default_rng(seed)
    bends = np.cumsum(random.normal(0.0, 0.12, (count, NODES, 2)), axis=1)
    along = np.dstack([np.sin(bends[..., 0]), np.sin(bends[..., 1]), np.ones(bends.shape[:2])])
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    places = np.cumsum(SPACING_MM * along, axis=1)
    return np.ascontiguousarray(places.reshape(count, -1), np.float32)


def truth(balls: list[tuple[MovingBall, float]], positions: SingleArray) -> FloatArray:
    """(S,) by looking at many places of the body at many times."""
    nodes = positions.reshape(len(positions), NODES, 3).astype(np.float64)
    shares = np.linspace(0.0, 1.0, 13)[:, None, None]
    places = (nodes[:, None, :-1] * (1.0 - shares) + nodes[:, None, 1:] * shares).reshape(
        len(nodes), -1, 3
    )
    radius = np.tile(np.maximum(RADIUS[:-1], RADIUS[1:]), 13)
    best = np.full(len(nodes), np.inf)
    for ball, for_s in balls:
        for t_s in np.linspace(0.0, for_s, 25):
            centre = np.array(ball.centre_mm) + t_s * np.array(ball.velocity_mm_s)
            away = np.linalg.norm(places - centre, axis=2) - radius - ball.radius_mm
            best = np.minimum(best, away.min(axis=1))
    return best


@examples(150)
@given(BALLS, st.floats(0.05, 0.6), st.integers(0, 500))
def test_no_shape_is_said_to_be_farther_from_what_moves_than_it_is(
    balls: list[MovingBall], for_s: float, seed: int
) -> None:
    positions, timed = shapes(seed), [(ball, for_s) for ball in balls]
    found = MovingClearance(SKIN, ARC, len(positions)).look(Swept.of(timed), positions)
    away = truth(timed, positions)
    if found is None:
        assert away.min() > NEAR_MM - 1e-3
        return
    near, node, safe = found
    assert (near <= np.minimum(away, NEAR_MM) + 1e-3).all()
    # Nor nearer: places and times were looked at some mm and tenths of a mm apart.
    close = away < NEAR_MM - 2.0
    assert (near[close] >= away[close] - 1.6).all()
    assert (safe <= near + 1e-4).all()
    assert (safe >= near - 1.0 - 1e-3).all(), "a body is taken to be 1 mm thicker, and no more"
    assert ((node >= 0) & (node < NODES)).all()


def test_a_ball_counts_where_it_is_and_wherever_it_is_led() -> None:
    straight = np.zeros((1, 3 * NODES), np.float32)
    straight[0, 2::3] = ARC
    look = MovingClearance(SKIN, ARC, 1).look
    still = Swept.of([(MovingBall((20.0, 0.0, 0.0), 5.0), 0.5)])
    found = look(still, straight)
    assert found is not None and found[0][0] == pytest.approx(20.0 - 5.0 - 6.0)
    comes = Swept.of([(MovingBall((40.0, 0.0, 0.0), 5.0, (-40.0, 0.0, 0.0)), 0.5)])
    found = look(comes, straight)
    assert found is not None and found[0][0] == pytest.approx(20.0 - 5.0 - 6.0)
    assert look(Swept.of([(MovingBall((40.0, 0.0, 0.0), 5.0), 0.5)]), straight) is None
    assert look(NOTHING_MOVES, straight) is None


def test_it_is_looked_for_as_far_as_is_asked_for() -> None:
    straight = np.zeros((1, 3 * NODES), np.float32)
    straight[0, 2::3] = ARC
    away = Swept.of([(MovingBall((40.0, 0.0, 0.0), 5.0), 0.5)])
    clearance = MovingClearance(SKIN, ARC, 1)
    clearance.look_as_far_as(40.0)
    found = clearance.look(away, straight)
    assert found is not None and found[0][0] == pytest.approx(29.0)
    clearance.look_as_far_as(0.0)
    assert clearance.far_mm == NEAR_MM


@pytest.mark.parametrize(
    ("ball", "told"),
    [
        (MovingBall((0.0, 0.0), 1.0), "three numbers"),
        (MovingBall((0.0, 0.0, math.nan), 1.0), "finite"),
        (MovingBall((0.0, 0.0, 0.0), math.inf), "finite"),
        (MovingBall((0.0, 0.0, 2e4), 1.0), "away"),
        (MovingBall((0.0, 0.0, 0.0), 2e4), "large"),
        (MovingBall((0.0, 0.0, 0.0), 0.0), "positive"),
        (MovingBall((0.0, 0.0, 0.0), 1.0, (900.0, 900.0, 0.0)), "faster"),
        (MovingBall((0.0, 0.0, 0.0), 1.0, (0.0, 0.0)), "three numbers"),
    ],
)
def test_what_cannot_be_a_ball_says_why(ball: MovingBall, told: str) -> None:
    assert told in ball.fault()
    assert MovingBall((1.0, 2.0, 3.0), 4.0, (5.0, 6.0, 7.0)).fault() == ""


def test_the_nearest_place_of_what_moves_is_told() -> None:
    swept = Swept.of([(MovingBall((10.0, 0.0, 0.0), 2.0, (0.0, 100.0, 0.0)), 0.5)])
    away, at = swept.nearest(np.array([0.0, 20.0, 0.0]))
    assert away == pytest.approx(8.0)
    np.testing.assert_allclose(at, [8.0, 20.0, 0.0], atol=1e-9)
    assert NOTHING_MOVES.nearest(np.zeros(3))[0] == np.inf


# In the risk itself: the rod of the contact's own tests, of radius 5, along z to 100.


def moving(x_mm: float, vx_mm_s: float = 0.0, z_mm: float = 50.0) -> Swept:
    """A ball of radius 5 at x, led on for a second."""
    return Swept.of([(MovingBall((x_mm, 0.0, z_mm), 5.0, (vx_mm_s, 0.0, 0.0)), 1.0)])


def test_a_ball_is_touched_as_likely_as_the_body_is_there() -> None:
    model, sigma = ContactModel(rod(), wall(), None, samples=4000), 2.0
    model.take_moving(moving(-14.0))
    risk = model.risk(at(0.0, sigma_mm=sigma))
    # A ball, and not a wall: a body that is shifted aside passes it a little sooner.
    assert risk.probability == pytest.approx(phi(-4.0 / sigma), abs=0.012)
    assert risk.upper_limit > risk.probability
    assert risk.worst.nearest_mm == pytest.approx([-9.0, 0.0, 50.0], abs=2.0)
    model.take_moving(NOTHING_MOVES)
    assert model.risk(at(0.0, sigma_mm=sigma)).touching == 0


def test_the_last_question_is_asked_anew_when_something_has_moved() -> None:
    model, here = ContactModel(rod(), wall(), None), at(0.0)
    assert model.risk(here).probability == 0.0
    model.take_moving(moving(8.0))
    assert model.risk(here).probability == 1.0
    assert model.along([here, at(-0.5)]).on_the_way.probability == 1.0
    model.take_moving(NOTHING_MOVES)
    assert model.risk(here).probability == 0.0


def test_a_way_past_what_moves_counts_all_of_it() -> None:
    model = ContactModel(rod(), wall(), None)
    model.take_moving(moving(0.0))
    passed = model.along([at(-16.0), at(16.0)]).on_the_way
    assert passed.upper_limit == 1.0, "each end is clear, and what is between is not"
    beside = model.along([at(-16.0, 16.0), at(16.0, 16.0)]).on_the_way
    short = model.along([at(-16.0), at(-15.0)]).on_the_way
    assert short.upper_limit < 0.01
    assert beside.probability == 0.0


def test_what_comes_towards_the_body_counts_before_it_is_there() -> None:
    model = ContactModel(rod(), wall(), None)
    model.take_moving(moving(-60.0, 30.0))
    assert model.risk(at(0.0)).probability == 0.0
    model.take_moving(moving(-60.0, 55.0))
    assert model.risk(at(0.0)).probability == 1.0
    model.take_moving(moving(-60.0, -55.0))
    assert model.risk(at(0.0)).probability == 0.0


def test_a_draw_that_changes_its_component_is_swept_as_what_it_was() -> None:
    """As beside a wall: it arrives as what it was, and is then what it has become."""
    from safety.risk.model.mixture import Mixture

    factors = [np.eye(2) / 1e-3] * 2
    one = Mixture.checked([1.0, 1e-9], [[-20.0, 0.0], [20.0, 0.0]], factors)
    other = Mixture.checked([1e-9, 1.0], [[-19.0, 0.0], [20.0, 0.0]], factors)
    model = ContactModel(rod(), wall(), None)
    model.take_moving(moving(0.0))
    assert model.along([one, other]).on_the_way.upper_limit < 0.01
    model.take_moving(moving(-9.5))
    assert model.along([one, other]).on_the_way.upper_limit == 1.0
    model.take_moving(moving(10.5))
    assert model.along([one, other]).on_the_way.upper_limit == 1.0


def test_where_a_way_begins_is_known_as_far_as_it_was_looked_for() -> None:
    """What was asked of the beginning before it was looked farther is no more than it was."""
    model, here = ContactModel(rod(), wall(), None), at(-26.0)
    model.take_moving(moving(-3.0))  # 13 mm off
    assert model.along([at(-26.5), here]).on_the_way.upper_limit < 0.01
    model.look_as_far_as(60.0)
    assert model.along([here, at(20.0)]).on_the_way.upper_limit == 1.0


def test_what_moves_is_a_reason_to_turn_aside_by_the_whole_body() -> None:
    model, here = ContactModel(rod(), wall(), None), at(0.0)
    assert not model.near_moving(here)
    model.take_moving(moving(18.0))
    assert model.near_moving(here)
    assert model.clearance_mm(here, 0.05) == pytest.approx(8.0, abs=0.01)
    assert not model.near_moving(at(-8.0))
