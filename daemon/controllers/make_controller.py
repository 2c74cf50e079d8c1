"""From options to a controller.

What a controller is made of is imported when one is asked for: some come with half of scipy. A
daemon whose robot moves meanwhile has them all from the beginning.
"""

from importlib import import_module
from typing import Final, assert_never

import numpy as np

from config.robot import Robot
from config.tasks.controllers import (
    Broyden,
    ConstantCurvature,
    ControllerOptions,
    ForwardJacobian,
    LearnedKinematics,
    RewardWeighted,
)
from config.tasks.exploration import WaypointExploration
from daemon.control import tip_following
from daemon.control.controller import Controller
from daemon.learning.forward.forward_model import forward_settings, slopes_by_step
from daemon.learning.inverse import engines
from daemon.learning.lwpr.model import Lwpr, with_memory
from daemon.learning.samples.motion import MotionSample, MotionTable

_MODULES: Final = (
    "broyden",
    "constant_curvature",
    "forward_jacobian",
    "learned_kinematics",
    "reward_weighted",
    "waypoint_exploration",
)


def import_all() -> None:
    """After this, no controller has to be waited for."""
    for name in _MODULES:
        import_module(f"daemon.controllers.{name}")


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
        case LearnedKinematics():
            from daemon.controllers.learned_kinematics import LearnedKinematicsController

            return LearnedKinematicsController(options, robot)
        case RewardWeighted():
            from daemon.controllers.reward_weighted import RewardWeightedController

            return RewardWeightedController(options, robot, seed)
        case WaypointExploration():
            from daemon.controllers.waypoint_exploration import WaypointExplorationController

            return WaypointExplorationController(options, robot, seed)
        case _:
            assert_never(options)


# Everything that controllers compile, compiled before the robot moves.
#
# Kernels are compiled when they are first called, which takes seconds, or fetched from a cache on
# disk, which takes tenths of one. A control step can wait for neither, and a bus cycle not for
# the import of a controller that is asked for.


_SAMPLES = 3
_MEMORY = 100.0


def warm_up() -> None:
    """Import every controller, and run every kernel once that one uses.

    Takes seconds where nothing is compiled yet.
    """
    import_all()
    tip_following.warm_up()
    engines.warm_up()
    _warm_up_forward_model()


def _warm_up_forward_model() -> None:
    samples = [
        MotionSample(np.full(3, float(k)), np.full(1, float(k)), np.ones(1), np.ones(3))
        for k in range(_SAMPLES)
    ]
    motions = MotionTable.of(samples, range(_SAMPLES), axes=1)
    model = Lwpr(forward_settings(motions, np.ones(1), metric=1.0))
    for x, y in zip(motions.inputs, motions.delta_tip_mm, strict=True):
        model.update(x, y)
    model = with_memory(Lwpr.from_arrays(model.settings, model.to_arrays()), _MEMORY)
    model.update(motions.inputs[0], motions.delta_tip_mm[0])
    model.predict(motions.inputs[0])
    model.activation(motions.inputs[0])
    slopes_by_step(model, motions.tip_mm[0], motions.u[0])
