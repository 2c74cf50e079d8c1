"""The learnt forward model, inverted at every step: the peer of the local inverse controllers."""

from config.robot import Robot
from config.tasks.controllers import ForwardJacobian
from daemon.controllers.jacobian_controller import JacobianController
from daemon.controllers.learnt_jacobian import LearntJacobian


class ForwardJacobianController(JacobianController):
    """A `Controller`."""

    name = "forward_jacobian"

    def __init__(self, options: ForwardJacobian, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._memory_samples = options.memory_samples
        super().__init__(options, robot, seed)

    def _new_jacobian(self) -> LearntJacobian:
        return LearntJacobian(self._options, self._range, self._memory_samples)
