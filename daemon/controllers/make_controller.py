"""From options to a controller.

What a controller is made of is imported when one is asked for: some come with half of scipy. A
daemon whose robot moves meanwhile has them all from the beginning.
"""

from importlib import import_module
from typing import Final, assert_never

from config.controllers import (
    Broyden,
    ConstantCurvature,
    ControllerOptions,
    ForwardJacobian,
    RewardWeighted,
)
from config.exploration import WaypointExploration
from config.robot import Robot
from daemon.control.controller import Controller

_MODULES: Final = (
    "broyden",
    "constant_curvature",
    "forward_jacobian",
    "reward_weighted",
    "waypoint_exploration",
)


def import_all() -> None:
    """After this, no controller has to be waited for."""
    for name in _MODULES:
        import_module(f"daemon.control.{name}")


def make_controller(options: ControllerOptions, robot: Robot, seed: int) -> Controller:
    """The controller that `options` describe, for the axes of `robot`.

    seed: for whatever a controller does at random. Raises ControllerError where the
    options do not fit the robot.
    """
    match options:
        case Broyden():
            from daemon.controllers.broyden import BroydenController

            return BroydenController(options, robot)
        case ConstantCurvature():
            from daemon.controllers.constant_curvature import ConstantCurvatureController

            return ConstantCurvatureController(options, robot)
        case ForwardJacobian():
            from daemon.controllers.forward_jacobian import ForwardJacobianController

            return ForwardJacobianController(options, robot, seed)
        case RewardWeighted():
            from daemon.controllers.reward_weighted import RewardWeightedController

            return RewardWeightedController(options, robot, seed)
        case WaypointExploration():
            from daemon.controllers.waypoint_exploration import WaypointExplorationController

            return WaypointExplorationController(options, robot, seed)
        case _:
            assert_never(options)
