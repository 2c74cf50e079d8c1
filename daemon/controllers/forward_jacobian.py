"""The learnt forward model, inverted at every step by damped least squares and drawn to a posture:
the peer of the local inverse controllers, and what others that learn a Jacobian have in common.
"""

from config.robot import Robot
from config.tasks.controllers import ForwardJacobian
from daemon.array_files import Arrays
from daemon.control.controller import Observation, Proposal
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.learnt_jacobian import LearntJacobian, TipJacobian
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector


class JacobianController(LearningController):
    """A `Controller`, all of whose knowledge is in its Jacobian."""

    def draw_to(self, posture: Vector) -> None:
        """Draw the axes to (m,) a posture from now on. Raises ValueError for no numbers."""
        self._follower.set_posture(posture)

    def _follow(self, observation: Observation) -> Proposal:
        jacobian = self._jacobian.at(self._follower.due_mm(observation), observation.u)
        step, jacobian = self._task(observation, jacobian)
        return self._follower.proposal(
            self._follower.axis_step(jacobian, step, observation), observation
        )

    def _work_in(self, sample: MotionSample, gains: Vector) -> None:
        self._jacobian.learn(sample, gains)

    def _take_over(
        self, model: PretrainedModel | None, jacobian: TipJacobian, learnt: Arrays
    ) -> None:
        """All is in the Jacobian."""

    def _learnt_arrays(self) -> Arrays:
        return {}

    def _go_on(self) -> None:
        """Nothing waits but samples."""

    def _posture_changed(self) -> None:
        """The follower has it, and nobody else needs it."""


class ForwardJacobianController(JacobianController):
    """A `Controller` that goes by what an exploration has told of the body."""

    name = "forward_jacobian"

    def __init__(self, options: ForwardJacobian, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._memory_samples = options.memory_samples
        super().__init__(options, robot, seed)

    def _new_jacobian(self) -> LearntJacobian:
        return LearntJacobian(self._options, self._range, self._memory_samples)
