"""Designed motions tell most in their time, begin where axes are, and stay where they may be."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.control import Workspace
from config.loader import load_robot
from config.robot import Robot
from config.tasks.exploration import DesignedExploration, WaypointExploration
from daemon.controllers.exploration.designed_exploration import (
    DesignedExplorationController,
    GatheredInformation,
)
from daemon.controllers.exploration.exploration_controller import ExplorationController
from daemon.controllers.exploration.waypoint_exploration import WaypointExplorationController
from daemon.robot.coupled_axes import CoupledAxes
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S, ROBOT, ClosedLoop
from tests.daemon.controllers.exploration.test_waypoint_exploration import (
    LOWEST_N,
    THREE_TENDONS,
    pulled,
    still,
)

SECONDS = 16.0
WIDE = Workspace(x_mm=(-300.0, 300.0), y_mm=(-300.0, 300.0), z_mm=(-100.0, 400.0))


def controller(
    seed: int = 1, robot: Robot = ROBOT, **options: float
) -> DesignedExplorationController:
    asked = {"kind": "designed_exploration", "duration_s": SECONDS, **options}
    return DesignedExplorationController(DesignedExploration.model_validate(asked), robot, seed)


def walked(
    control: ExplorationController, start: Vector, seconds: float = SECONDS, stands: int = -1
) -> Vector:
    """(n, m) axes of a body whose tip stays in the middle of the workspace. stands: the axis that
    something lets go no further than where it began."""
    u, tip = start, np.array([0.0, 0.0, 185.0])
    places = [u]
    control.reset(still(u, tip))
    for _ in range(round(seconds / DT_S)):
        step = control.propose(still(u, tip)).delta_u
        if stands >= 0 and (u + step)[stands] > start[stands]:
            step = np.zeros_like(step)
        u = u + step
        places.append(u)
    return np.array(places)


MIDDLE = np.full(6, 25.0)


def explored(workspace: Workspace | None) -> Vector:
    """(n, 6) axes of a body whose tip begins 174 mm above its base, and moves in proportion."""
    control = controller(robot=ROBOT.model_copy(update={"workspace": workspace}))
    first_mm, u = np.array([0.0, 0.0, 174.0]), np.zeros(6)
    per_mm = np.random.default_rng(5).normal(0.0, 3.0, (3, 6))
    control.reset(still(u, first_mm))
    places = [u]
    for _ in range(round(SECONDS / DT_S)):
        seen = still(u, first_mm + per_mm @ u)
        control.observe(seen)
        u = u + control.propose(seen).delta_u
        places.append(u)
    return np.array(places)


def test_a_workspace_is_explored_no_farther_than_a_quadratic_tells_where_a_supple_arm_is() -> None:
    far_mm, wall_mm = 0.55 * 174.0, 5.0
    aside, low, high = far_mm + wall_mm, 174.0 - far_mm - wall_mm, 174.0 + far_mm + wall_mm
    as_wide = Workspace(x_mm=(-aside, aside), y_mm=(-aside, aside), z_mm=(low, high))
    expected = explored(as_wide)
    np.testing.assert_allclose(explored(WIDE), expected)
    np.testing.assert_allclose(explored(None), expected)


@pytest.mark.parametrize(("axes", "lasts_s"), [(3, 16.0), (6, 16.0), (7, 20.7), (10, 38.5)])
def test_it_lasts_longer_the_more_axes_there_are_unless_it_is_told_how_long(
    axes: int, lasts_s: float
) -> None:
    options = DesignedExploration(kind="designed_exploration")
    assert options.lasts_s(axes) == pytest.approx(lasts_s, abs=0.1)
    assert options.model_copy(update={"duration_s": 9.0}).lasts_s(axes) == 9.0


def told(places: Vector) -> float:
    """Logarithm of the determinant of what motions tell of a quadratic's coefficients."""
    x = (places - 25.0) / 25.0
    d, at = np.diff(x, axis=0) / DT_S, 0.5 * (x[1:] + x[:-1])
    first, second = np.triu_indices(6)
    rows = np.hstack([d, d[:, first] * at[:, second] + at[:, first] * d[:, second]])
    return float(np.linalg.slogdet(rows.T @ rows * DT_S + 1e-6 * np.eye(rows.shape[1]))[1])


def test_they_tell_more_than_random_waypoints_of_the_same_part_of_the_travel() -> None:
    options = WaypointExploration(kind="waypoint_exploration", travel_share=0.4)
    for seed in (1, 2, 3):
        designed = told(walked(controller(seed), MIDDLE))
        random = WaypointExplorationController(options, ROBOT, seed)
        # The logarithm of 27 coefficients' information: 20 are half as much again of each, twice.
        assert designed > told(walked(random, MIDDLE)) + 20.0


def test_they_last_as_long_as_asked_for_and_say_so() -> None:
    control = controller(duration_s=3.0)
    u, tip, notes = MIDDLE, np.array([0.0, 0.0, 185.0]), []
    control.reset(still(u, tip))
    steps = 0
    while not control.ready:
        proposal = control.propose(still(u, tip))
        u, steps = u + proposal.delta_u, steps + 1
        notes.append(proposal.note)
        assert steps < 1000
    assert steps == pytest.approx(3.0 / DT_S, abs=1)
    assert list(dict.fromkeys(notes)) == [
        *(f"tries motions: {second} of 3 s" for second in (0, 1, 2, 3)),
        "",
    ]
    np.testing.assert_array_equal(control.propose(still(u, tip)).delta_u, np.zeros(6))


@pytest.mark.parametrize("start", [0.0, 25.0, 50.0])
def test_they_begin_where_the_axes_are_and_come_to_the_middle_of_the_travel(start: float) -> None:
    places = walked(controller(), np.full(6, start))
    assert np.abs(places[: round(1.5 / DT_S)] - start).max() < 17.0
    late = places[round(0.7 * SECONDS / DT_S) :]
    assert (np.abs(late - 25.0) < 0.4 * 25.0 + 1.0).all()
    assert (np.ptp(late, axis=0) > 5.0).all()


def test_no_axis_leaves_its_travel_or_is_faster_than_it_may_be_and_most_are_always_busy() -> None:
    places = walked(controller(travel_share=1.0), MIDDLE)
    assert ((places >= -1e-9) & (places <= 50.0 + 1e-9)).all()
    speeds = np.abs(np.diff(places, axis=0)) / DT_S
    assert speeds.max() <= 10.0 + 1e-9
    assert speeds.mean() > 4.5


def test_the_tip_stays_in_its_workspace_and_goes_through_much_of_it() -> None:
    loop, tips = ClosedLoop(controller()), []
    loop.start()
    while not loop.controller.ready:
        loop.step(loop.tip_mm, np.zeros(3))
        tips.append(loop.body.tip.position_mm)
    box = ROBOT.workspace
    assert box is not None
    lowest, highest = np.array([box.x_mm, box.y_mm, box.z_mm]).T
    assert (np.array(tips) >= lowest).all()
    assert (np.array(tips) <= highest).all()
    assert (np.ptp(tips, axis=0) > (50.0, 50.0, 20.0)).all()


def test_the_same_seed_goes_the_same_way_and_another_one_does_not() -> None:
    one, same, other = (walked(controller(seed), MIDDLE, 4.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.allclose(one, other)


def test_a_line_that_something_stands_in_the_way_of_is_given_up_and_others_are_gone() -> None:
    places = walked(controller(duration_s=40.0), MIDDLE, 40.0, stands=0)
    assert places[:, 0].max() <= 25.0
    assert (np.ptp(places, axis=0)[1:] > 8.0).all()


def test_no_tendon_goes_slack() -> None:
    tensions, _ = pulled(controller(robot=THREE_TENDONS, duration_s=15.0, travel_share=0.8))
    assert tensions.min() > LOWEST_N
    assert (np.ptp(tensions, axis=0) > 0.8).all()


def test_lines_keep_to_coupled_limits() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    exploration, coupled = controller(robot=robot, travel_share=1.0), CoupledAxes.of(robot)
    exploration._start = exploration._home = np.array([0.0, 0.0, 1.9, 8.0, -40.0])
    for _ in range(100):
        goal = exploration._draw()
        assert coupled.way_inside(exploration._start, goal)
        exploration._start = goal


shares = st.floats(-1.0, 1.0)


@given(
    st.lists(st.tuples(shares, shares, shares), min_size=3, max_size=8),
    st.floats(0.3, 3.0),
)
def test_what_a_line_would_tell_is_what_it_tells(
    corners: list[tuple[float, float, float]], time_s: float
) -> None:
    known, places = GatheredInformation(3), np.array(corners)
    for start, end in itertools.pairwise(places[:-1]):
        known.add(start, end, time_s)
    before = np.linalg.slogdet(known._matrix)[1]
    gain = known.gain(places[-2], places[-1:], np.array([time_s]))[0]
    known.add(places[-2], places[-1], time_s)
    assert gain == pytest.approx(np.linalg.slogdet(known._matrix)[1] - before, abs=1e-6)
    assert gain >= -1e-9
