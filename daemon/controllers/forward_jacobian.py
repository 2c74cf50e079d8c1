"""The learnt forward model, inverted at every step: the peer of the local inverse controllers."""

import numpy as np

from config.robot import Robot
from config.tasks.controllers import ForwardJacobian
from daemon.array_files import Arrays
from daemon.control.controller import Observation, Proposal
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.learnt_jacobian import TipJacobian
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.lwpr.model import with_memory
from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector


class ForwardJacobianController(LearningController):
    """A `Controller`."""

    name = "forward_jacobian"

    def __init__(self, options: ForwardJacobian, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._memory_samples = options.memory_samples
        super().__init__(options, robot, seed)

    def _take_over(
        self, model: PretrainedModel | None, jacobian: TipJacobian, learnt: Arrays
    ) -> None:
        del model, learnt
        if self._memory_samples is not None and jacobian.forward is not None:
            jacobian.forward = with_memory(jacobian.forward, self._memory_samples)

    def _follow(self, observation: Observation) -> Proposal:
        jacobian = self._jacobian.at(self._follower.due_mm(observation), observation.u)
        step, jacobian = self._task(observation, jacobian)
        return Proposal(self._follower.axis_step(jacobian, step, observation))

    def _work_in(self, sample: MotionSample) -> None:
        self._jacobian.learn(sample)
        forward = self._jacobian.forward
        if self._memory_samples is not None and forward is not None:
            forward.update(
                np.concatenate([sample.tip_mm, sample.u, sample.delta_u]), sample.delta_tip_mm
            )

    def _go_on(self) -> None:
        """Nothing waits but samples."""

    def _forget_samples(self) -> None:
        """There is nothing of them but in the Jacobian."""

    def draw_to(self, posture: Vector) -> None:
        """Draw the axes to (m,) a posture from now on. Raises ValueError for no numbers."""
        self._follower.set_posture(posture)

    def _posture_changed(self) -> None:
        """The follower has it, and nobody else needs it."""

    def _learnt_arrays(self) -> Arrays:
        return {}
