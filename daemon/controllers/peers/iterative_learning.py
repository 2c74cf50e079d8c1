"""Iterative learning control on top of a feedback law, through a Jacobian that was identified.

The law is a share of the error and the reference's own motion. Where a path repeats, what the tip
was off by in a cycle corrects the reference of the next (`cycle_learning`). On a path that does not
repeat it is the law alone.
"""

import numpy as np

from config.robot import Robot
from config.tasks.controllers import Learner
from config.tasks.peers import IterativeLearning
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.lag.body_lag import parts
from daemon.control.task import within
from daemon.control.tip_following import step_time
from daemon.controllers.forward_jacobian import JacobianController
from daemon.controllers.peers.cycle_learning import ClosedLoop, CycleLearning
from daemon.controllers.peers.identified_jacobian import IdentifiedJacobian
from drivers.pose import Vector


class IterativeLearningController(JacobianController):
    """A `Controller`."""

    name = "iterative_learning"
    steers_direction = False

    def __init__(self, options: IterativeLearning, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._ilc = options
        self._cycles: CycleLearning | None = None
        self._since_s = 0.0
        """Since motion began."""
        frame = options.of_law(
            Learner,
            lead=options.probe,
            feed_forward=True,
            by_cycles=False,
            learning=options.model is None,
        )
        super().__init__(frame, robot, seed)

    @property
    def loop(self) -> ClosedLoop:
        """As the body is known."""
        options, lag = self._ilc, self._follower.leading.lag
        gain = min(options.gain_per_s, options.gain_by_lag / max(lag.lag_s, 1e-3))
        return ClosedLoop(gain, *parts(lag.lag_s, lag.dead_share), options.feed_forward)

    def reset(self, observation: Observation) -> None:
        super().reset(observation)
        self._since_s = 0.0
        if self._cycles is not None:
            self._cycles.break_off()

    def _new_jacobian(self) -> IdentifiedJacobian:
        return IdentifiedJacobian(self._range)

    def _follow(self, observation: Observation) -> Proposal:
        dt_s, loop = step_time(observation), self.loop
        velocity = observation.reference_velocity_mm_s
        numbers = (observation.tip_mm, observation.reference_mm, velocity)
        if not all(np.isfinite(one).all() for one in numbers):
            raise ControllerError("where the tip is, or shall be, is not a number")
        self._since_s += dt_s
        correction, changes = self._correction(observation, loop)
        error = observation.reference_mm + correction - observation.tip_mm
        step = min(loop.gain_per_s * dt_s, 1.0) * error
        if loop.feed_forward:
            step = step + dt_s * (velocity + changes)
        step = within(step, self._ilc.max_tip_speed_mm_s * dt_s)
        jacobian = self._jacobian.at(observation.tip_mm, observation.u)
        return Proposal(self._follower.axis_step(jacobian, step, observation))

    def _correction(self, observation: Observation, loop: ClosedLoop) -> tuple[Vector, Vector]:
        phase, reference = observation.phase, observation.reference_mm
        if phase is None:
            if self._cycles is not None:
                self._cycles.break_off()
            return np.zeros(3), np.zeros(3)
        if self._cycles is None or not self._cycles.path.fits(phase, reference):
            options = self._ilc
            self._cycles = CycleLearning(phase.cycle_s, options.caution, options.cutoff_hz)
        error: Vector | None = reference - observation.tip_mm
        set_out_s = self._ilc.set_out_s + 2.0 * (loop.dead_s + loop.lag_s)
        if not observation.believed or self._since_s < set_out_s:
            error = None
        self._cycles.take(phase, reference, error, loop)
        return self._cycles.at(phase.seconds)
