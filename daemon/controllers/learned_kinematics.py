"""A learnt kinematic model, inverted at every step: damped least squares over its Jacobian.

Fagogenis, Bergeles and Dupont (IROS 2016), eqs. 6 and 7, with the reference's own motion fed
forward. They compare the reference with what the model says of the axes; the tracker only teaches
the model. Here the tracker may close the loop as well.
"""

from pathlib import Path
from typing import Final

import numpy as np

from config.paths import named_model
from config.robot import Robot
from config.tasks.controllers import LearnedKinematics
from daemon.array_files import ModelError
from daemon.control.axis_speeds import Foresight
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.task import POSITION
from daemon.control.tip_following import TipFollower
from daemon.learning.forward.pose_kinematics import (
    BodyCoordinates,
    PoseAdaptation,
    PoseKinematics,
)
from daemon.learning.forward.pose_model import PoseModel
from daemon.learning.lwpr.model import Lwpr
from drivers.pose import Vector

_SEARCH_STEPS: Final = 60
_SEARCH_STEP_MM: Final = 10.0
_FOUND_MM: Final = 1.0


class LearnedKinematicsController:
    """A `Controller`."""

    steers_direction = True

    name = "learned_kinematics"

    def __init__(self, options: LearnedKinematics, robot: Robot) -> None:
        """Raises ControllerError for a model that cannot be loaded, or is of another robot."""
        self._options = options
        self._follower = TipFollower(options, robot)
        self._adaptation: PoseAdaptation | None = None
        try:
            self.load(named_model(options.model))
        except (ModelError, OSError) as error:
            raise ControllerError(f"the model cannot be loaded: {error}") from None

    @property
    def ready(self) -> bool:
        """A model that is followed itself answers at once."""
        return self._options.feedback == "model" or self._follower.probed

    @property
    def adapted(self) -> int:
        """Samples that corrected the model since it was loaded."""
        return 0 if self._adaptation is None else self._adaptation.samples

    @property
    def foresight(self) -> Foresight:
        """What the model says of a path before it is gone."""
        return Foresight(self._axes_for, self._known_jacobian, self._follower.axis_velocity)

    def draw_to(self, posture: Vector) -> None:
        """Draw the axes to (m,) a posture from now on. Raises ValueError for no numbers."""
        self._follower.set_posture(posture)

    def reset(self, observation: Observation) -> None:
        self._follower.reset(observation)
        if self._adaptation is not None:
            self._adaptation.break_off()

    def observe(self, observation: Observation) -> None:
        direction = observation.tip_direction
        if self._adaptation is None or not observation.believed or direction is None:
            return
        self._adaptation.see(observation.u, observation.tip_mm, direction)

    def propose(self, observation: Observation) -> Proposal:
        learnt = self.learnt
        if not learnt.known(observation.u):
            raise ControllerError(
                "the model knows nothing of the body with its axes here: lead them back by hand, "
                "or learn a model that does"
            )
        position_mm, direction, jacobian = learnt.answer(observation.u)
        if not self.ready:
            return self._follower.probe(jacobian[:POSITION], observation)
        jacobian[POSITION:] *= self._options.pointing_mm_per_rad
        if self._options.feedback == "model":
            observation = observation._replace(tip_mm=position_mm, tip_direction=direction)
        step = self._follower.task_step(observation)
        return self._follower.proposal(
            self._follower.axis_step(jacobian[: len(step)], step, observation), observation
        )

    def learn(self) -> None:
        """A sample is worked in when it is seen: it takes some tens of microseconds."""
        self._follower.work_off()

    def save(self, path: Path) -> None:
        PoseModel(self.learnt.lwpr, self._model.metadata).save(path)

    def load(self, path: Path) -> None:
        model = PoseModel.load(path)
        try:
            coordinates = BodyCoordinates.from_dict(model.metadata["coordinates"])
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"{path} does not say how axes make its numbers: {error}") from None
        axes = self._follower.axes
        if coordinates.axes != axes.count:
            raise ModelError(f"{path} is for {coordinates.axes} axes, and there are {axes.count}")
        if len(coordinates.offset) != model.lwpr.settings.inputs:
            raise ModelError(f"{path} is damaged: its numbers are not those of its coordinates")
        lwpr = Lwpr.from_arrays(model.lwpr.settings, model.lwpr.to_arrays())
        self._model = model
        self.learnt = PoseKinematics(lwpr, coordinates)
        options = self._options
        if options.adaptation:
            self._adaptation = PoseAdaptation(
                self.learnt,
                np.array(axes.travel),
                options.memory_samples,
                options.sample_tip_mm,
                options.sample_travel_share,
            )

    def _axes_for(self, tip_mm: Vector) -> Vector | None:
        """(m,) searched from the posture; None: not found where the model knows anything."""
        u = self._follower.posture
        for _ in range(_SEARCH_STEPS):
            if not self.learnt.known(u):
                return None
            here_mm, _, jacobian = self.learnt.answer(u)
            missing = tip_mm - here_mm
            far_mm = float(np.sqrt(missing @ missing))
            if not far_mm > _FOUND_MM:
                return None if np.isnan(far_mm) else u
            step_mm = missing * min(1.0, _SEARCH_STEP_MM / far_mm)
            u = self._follower.axes_nearer(jacobian[:POSITION], step_mm, u)
        return None

    def _known_jacobian(self, tip_mm: Vector, u: Vector) -> Vector | None:
        del tip_mm
        jacobian = self.learnt.answer(u).jacobian[:POSITION] if self.learnt.known(u) else None
        return None if jacobian is None or np.isnan(jacobian).any() else jacobian


def make(options: LearnedKinematics, robot: Robot, seed: int) -> LearnedKinematicsController:
    """It does nothing at random. Raises ControllerError."""
    del seed
    return LearnedKinematicsController(options, robot)
