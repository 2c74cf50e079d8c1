"""From options to a controller."""

from typing import assert_never

from config.controllers import (
    Broyden,
    ConstantCurvature,
    ControllerOptions,
    ForwardJacobian,
    RewardWeighted,
)
from config.exploration import WaypointExploration
from config.robot import Robot
from daemon.control.broyden import BroydenController
from daemon.control.constant_curvature import ConstantCurvatureController
from daemon.control.controller import Controller
from daemon.control.forward_jacobian import ForwardJacobianController
from daemon.control.reward_weighted import RewardWeightedController
from daemon.control.waypoint_exploration import WaypointExplorationController


def make_controller(options: ControllerOptions, robot: Robot, seed: int) -> Controller:
    """The controller that `options` describe, for the axes of `robot`.

    seed: for whatever a controller does at random. Raises ControllerError where the
    options do not fit the robot.
    """
    match options:
        case Broyden():
            return BroydenController(options, robot)
        case ConstantCurvature():
            return ConstantCurvatureController(options, robot)
        case ForwardJacobian():
            return ForwardJacobianController(options, robot, seed)
        case RewardWeighted():
            return RewardWeightedController(options, robot, seed)
        case WaypointExploration():
            return WaypointExplorationController(options, robot, seed)
        case _:
            assert_never(options)
