"""The map between a robot's axes and its coordinates, both ways."""

import numpy as np

from config.loader import load_robot
from daemon.robot.coordinates import Coordinates
from tests import SHIPPED_ROBOTS, SOFT_ARM

TUBES = Coordinates.of(load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot)


def test_the_tubes_axes_are_the_papers_sums() -> None:
    roll, a21, a31, insertion, d31 = 0.3, 0.7, -2.9, 4.0, 61.0
    u = TUBES.axes(np.array([roll, a21, a31, insertion, d31]))
    np.testing.assert_allclose(u, [roll, roll + a21, roll + a31, insertion, insertion + d31 - 53.5])


def test_the_base_rolls_with_all_rotations_at_once() -> None:
    roll = np.array([0.01, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(TUBES.axis_steps(roll), [0.01, 0.01, 0.01, 0.0, 0.0])


def test_there_and_back_is_the_same_and_turns_count_on() -> None:
    u = np.random.default_rng(1).uniform(-20.0, 20.0, (50, 5))
    np.testing.assert_allclose(TUBES.axes(TUBES.of_axes(u)), u, atol=1e-12)
    np.testing.assert_allclose(TUBES.axis_steps(TUBES.steps_of_axes(u)), u, atol=1e-12)
    assert TUBES.of_axes(np.array([0.0, 7.0, 0.0, 0.0, 0.0]))[1] == 7.0


def test_slopes_by_axes_are_those_of_the_same_function() -> None:
    random = np.random.default_rng(2)
    slopes = random.normal(size=(3, 5))
    step = random.normal(size=5)
    np.testing.assert_allclose(
        TUBES.slopes_by_axes(slopes) @ step, slopes @ TUBES.steps_of_axes(step), atol=1e-12
    )


def test_a_robot_without_coordinates_has_its_axes_for_them() -> None:
    robot = load_robot(SOFT_ARM).robot
    same = Coordinates.of(robot)
    u = np.arange(float(len(robot.axes)))
    assert same.names == tuple(axis.name for axis in robot.axes)
    assert same.units == tuple(axis.unit for axis in robot.axes)
    assert same.periods == (None,) * same.count
    for mapped in (same.axes(u), same.of_axes(u), same.axis_steps(u), same.slopes_by_axes(u)):
        np.testing.assert_array_equal(mapped, u)
