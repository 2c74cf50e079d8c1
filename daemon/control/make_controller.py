"""From options to a controller."""

from typing import assert_never

from config.controllers import Broyden, ConstantCurvature, ControllerOptions
from config.robot import Robot
from daemon.control.broyden import BroydenController
from daemon.control.constant_curvature import ConstantCurvatureController
from daemon.control.controller import Controller


def make_controller(
    options: ControllerOptions,
    robot: Robot,
    seed: int,  # noqa: ARG001
) -> Controller:
    """The controller that `options` describe, for the axes of `robot`.

    seed: for whatever a controller does at random. These here do nothing at random.
    Raises ControllerError where the options do not fit the robot.
    """
    match options:
        case Broyden():
            return BroydenController(options, robot)
        case ConstantCurvature():
            return ConstantCurvatureController(options, robot)
        case _:
            assert_never(options)
