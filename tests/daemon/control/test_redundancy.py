"""How redundant axes are resolved where options leave it open."""

from functools import cache

import numpy as np
import pytest

from config.loader import load_robot
from config.robot import Robot
from config.tasks.controllers import TipFollowing
from daemon.control.controller import ControllerError
from daemon.control.redundancy import Redundancy
from daemon.control.tip_following import damped_solution
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS

BENDS_MM, LENGTHENS_MM = 280.0, 14.0


@cache
def robot(name: str) -> Robot:
    return load_robot(SHIPPED_ROBOTS / f"{name}.yaml").robot


def redundancy(name: str, **options: object) -> Redundancy:
    return Redundancy(TipFollowing.model_validate(options), AxisRanges.of(robot(name)))


def jacobian(of: Redundancy) -> Vector:
    """(3, m) of a body that all axes bend, and that they hardly lengthen together."""
    waves = np.linspace(0.0, 2.0 * np.pi, of.unit.size, endpoint=False)
    rows = np.stack([np.cos(waves), np.sin(waves), np.ones(waves.size)])
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    return np.asarray(np.array([[BENDS_MM], [BENDS_MM], [LENGTHENS_MM]]) * rows / of.unit)


@pytest.mark.parametrize("name", ["tendon_arm", "three_tendon_arm"])
def test_what_only_all_tendons_together_would_do_is_not_asked_of_them(name: str) -> None:
    tendons = redundancy(name)
    scaled = jacobian(tendons) * tendons.unit
    damping_mm = tendons.damping_mm(jacobian(tendons))
    bent = damped_solution(scaled, np.array([1.0, 0.0, 0.0]), damping_mm)
    lengthened = damped_solution(scaled, np.array([0.0, 0.0, 1.0]), damping_mm)
    np.testing.assert_allclose(scaled @ bent, [1.0, 0.0, 0.0], atol=1e-9)
    assert np.linalg.norm(lengthened) < np.linalg.norm(bent)
    assert tendons.posture_gain_per_s == 1.0


def test_other_axes_may_all_go_together() -> None:
    arm = redundancy("soft_arm")
    scaled = jacobian(arm) * arm.unit
    lengthened = damped_solution(scaled, np.array([0.0, 0.0, 1.0]), arm.damping_mm(jacobian(arm)))
    np.testing.assert_allclose(scaled @ lengthened, [0.0, 0.0, 1.0], atol=1e-9)
    assert arm.posture_gain_per_s == 0.1


def test_what_options_say_counts_for_tendons_too() -> None:
    stated = redundancy("tendon_arm", damping_mm=3.0, posture_gain_per_s=0.0)
    assert stated.damping_mm(jacobian(stated)) == 3.0
    assert stated.posture_gain_per_s == 0.0


def test_weights_for_another_robot_are_refused() -> None:
    with pytest.raises(ControllerError, match="axis_weights are 2, and the robot has 6 axes"):
        redundancy("soft_arm", axis_weights=[1.0, 2.0])
