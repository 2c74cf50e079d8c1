"""Small random motions: near where they began, in all directions, for as long as asked."""

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.exploration import MotorBabbling
from daemon.control.controller import Observation
from daemon.controllers.exploration.motor_babbling import Babbling
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S, ROBOT

AXES = AxisRanges.of(ROBOT)
OPTIONS = MotorBabbling(reach_share=0.05, duration_s=10.0)
TIP = np.array([0.0, 0.0, 185.0])


def at(u: Vector) -> Observation:
    return Observation(0, DT_S, u, u, TIP, np.zeros(3), TIP, np.zeros(3))


def babbled(start: Vector, options: MotorBabbling = OPTIONS, seed: int = 1) -> Vector:
    """(n, 6) where the axes were, until it was done."""
    babbling, u = Babbling(options, AXES, seed), start
    babbling.reset()
    places = [u]
    while not babbling.done:
        u = u + babbling.propose(at(u))
        places.append(u)
    assert babbling.note == ""
    assert not babbling.propose(at(u)).any()
    return np.array(places)


def test_it_lasts_as_long_as_asked_for() -> None:
    assert len(babbled(np.full(6, 25.0))) == pytest.approx(10.0 / DT_S, abs=2)


def test_it_stays_near_where_it_began_and_moves_all_axes() -> None:
    places = babbled(np.full(6, 25.0))
    reach = 50.0 * (OPTIONS.reach_share + OPTIONS.dither_share)
    assert (np.abs(places - 25.0) <= reach + 0.5).all()
    assert (np.ptp(places, axis=0) > 2.0).all()


def test_its_steps_go_in_all_directions() -> None:
    steps = np.diff(babbled(np.full(6, 25.0)), axis=0)
    power = np.linalg.svd(steps, compute_uv=False) ** 2
    assert power[-1] > 0.02 * power[0]


@pytest.mark.parametrize("start", [0.0, 50.0])
def test_at_the_end_of_the_travel_it_uses_the_side_that_has_room(start: float) -> None:
    places = babbled(np.full(6, start))
    assert (places >= -1e-9).all()
    assert (places <= 50.0 + 1e-9).all()
    assert (np.ptp(places, axis=0) > 2.0).all()


def test_a_pause_does_not_count_and_the_rest_is_made_up_for() -> None:
    babbling, u = Babbling(OPTIONS, AXES, 1), np.full(6, 25.0)
    babbling.reset()
    for _ in range(100):
        u = u + babbling.propose(at(u))
    assert babbling.note == "tries small motions: 2 of 10 s"
    babbling.reset()
    elsewhere = u + 10.0
    assert np.abs(babbling.propose(at(elsewhere))).max() < 0.1
    assert not babbling.done


def test_the_seed_decides() -> None:
    start = np.full(6, 25.0)
    np.testing.assert_array_equal(babbled(start), babbled(start))
    assert not np.array_equal(babbled(start), babbled(start, seed=2))


def test_it_stays_within_coupled_limits() -> None:
    """At 25.5 mm out, against the pair: nothing that a gate would have to cut, but for dither."""
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    axes = AxisRanges.of(robot)
    for start in ([0.0, 0.0, 3.1, 0.0, -28.0], [0.0, 0.0, 1.9, 0.0, -40.0]):
        babbling = Babbling(OPTIONS, axes, seed=1)
        goals = np.array([babbling._draw(np.array(start)) for _ in range(50)])
        assert axes.coupled.inside(goals).all()
        assert all(axes.coupled.way_inside(np.array(start), goal) for goal in goals)
        spread = np.ptp(goals, axis=0)
        assert (spread > [0.05, 0.05, 0.05, 0.5, 0.5]).all(), "in rad and in mm"


def test_where_nothing_near_is_inside_it_stays() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    outside = np.array([0.0, 0.0, 3.1, 0.0, -42.0])
    axes = AxisRanges.of(robot)
    options = MotorBabbling(reach_share=0.001, duration_s=10.0)
    np.testing.assert_array_equal(Babbling(options, axes, seed=1)._draw(outside), outside)


def test_tendons_do_not_pull_all_together() -> None:
    """That would tear them, or let them hang loose: 8 N for a millimetre, and 4 N to begin with."""
    robot = load_robot(SHIPPED_ROBOTS / "three_tendon_arm.yaml").robot
    axes = AxisRanges.of(robot)
    babbling, u = Babbling(OPTIONS, axes, seed=1), np.zeros(3)
    babbling.reset()
    places = []
    for _ in range(300):
        u = u + babbling.propose(at(u))
        places.append(u)
    assert np.abs(np.mean(places, axis=1)).max() < 0.05
    assert (np.ptp(places, axis=0) > 0.8).all()
    apart = axes.less_together(np.array([3.0, 0.0, 0.0]), 0.5)
    np.testing.assert_allclose(apart, [2.5, -0.5, -0.5])


def test_pistons_do_as_they_like() -> None:
    motion = np.arange(6.0)
    np.testing.assert_array_equal(AXES.less_together(motion, 0.0), motion)
