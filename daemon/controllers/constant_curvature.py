"""A controller with a fixed model: two segments, each an arc of a circle.

The robot is not one. Gravity and loads bend it otherwise, and feedback has to make up for that.
"""

from math import pi
from pathlib import Path

import numpy as np

from config.axis import LinearStepper
from config.controllers import ConstantCurvature, GasChambers
from config.robot import Robot
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.tip_following import TipFollower
from daemon.controllers.arc_kinematics import ArcKinematics
from daemon.controllers.fixed_model_file import load_model, model_metadata, save_model
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

AXES = 6


class ConstantCurvatureController:
    """A `Controller`."""

    name = "constant_curvature"
    ready = True

    def __init__(self, options: ConstantCurvature, robot: Robot) -> None:
        _check_cylinders(options, robot)
        self._metadata = model_metadata(self.name, robot)
        self._follower = TipFollower(options, robot)
        self.kinematics = ArcKinematics(options, AxisRanges.of(robot), _bore_mm2(robot))

    def reset(self, observation: Observation) -> None:
        self._follower.reset(observation)

    def observe(self, observation: Observation) -> None:
        """The model is fixed."""

    def propose(self, observation: Observation) -> Proposal:
        _, jacobian = self.kinematics.tip(observation.targets)
        tip_step = self._follower.tip_step(observation)
        return Proposal(self._follower.axis_step(jacobian, tip_step, observation))

    def learn(self, budget_s: float) -> None:
        """The model is fixed."""

    def save(self, path: Path) -> None:
        """Whose it is: there is nothing else to keep."""
        save_model(path, self._metadata, {})

    def load(self, path: Path) -> None:
        load_model(path, self._metadata, {})


def _check_cylinders(options: ConstantCurvature, robot: Robot) -> None:
    """Raises ControllerError where a piston would push out more gas than there is."""
    if not isinstance(options.chambers, GasChambers):
        return
    highest = AxisRanges.of(robot).highest
    pushed_ml = float((1e-3 * _bore_mm2(robot) * highest).max())
    if pushed_ml >= options.chambers.supply_volume_ml:
        raise ControllerError(
            f"chambers.supply_volume_ml is {options.chambers.supply_volume_ml:g}, and the pistons "
            f"push out {pushed_ml:.1f} mL at the end of their travel: give the gas in cylinder and "
            f"tube together"
        )


def _bore_mm2(robot: Robot) -> Vector:
    """(6,) piston areas. Raises ControllerError for a robot that is not such an arm."""
    if len(robot.axes) != AXES:
        raise ControllerError(
            f"constant_curvature is for {AXES} chambers, and {robot.robot} has "
            f"{len(robot.axes)} axes"
        )
    areas = []
    for axis in robot.axes:
        if not isinstance(axis, LinearStepper) or axis.bore_mm is None:
            raise ControllerError(
                f"constant_curvature is for cylinders, and {axis.name} is none: it has no bore_mm"
            )
        areas.append(pi / 4.0 * axis.bore_mm**2)
    return np.array(areas)
