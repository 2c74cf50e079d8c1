"""The controller of Ho 2018: local inverse controllers, learnt by reward-weighted regression.

The wanted motion of the tip is asked of all fields' controllers, and their answers are blended. A
field's controller is at first the inverse of the forward model there (`imagined_prior`) and comes
to be what the samples of the window say, which rewards for being near the attractor choose among.

Controllers are asked for a motion as long as their samples, of which a step is a part: what they
know of drift and posture belongs to that length of time.

Answers are trusted as far as fields are active and samples, imagined ones among them, speak about
the motion that is wanted. For the rest the learnt Jacobian stands in, as in `forward_jacobian`; so
it does for axes that have met a limit. There is no integrator that could wind up.
"""

import numpy as np

from config.controllers import RewardWeighted
from config.robot import Robot
from daemon.control.controller import Observation, Proposal
from daemon.control.tip_following import step_time
from daemon.controllers.growing_controllers import GrowingControllers
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.learning_file import Arrays
from daemon.controllers.learnt_jacobian import LearntJacobian
from daemon.controllers.local_law import LocalLaw, window_arrays, window_samples
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.inverse.local_controllers import Command, LocalControllers
from daemon.learning.samples.motion_sample import MotionSample
from drivers.pose import Vector

_ACTIVE = 0.01
_SUPPORTED = 1.0
"""Below this activation and support the controllers' answer is trusted in proportion."""
_SOLVED_AT_ONCE = 4
_SPREADS = 3.0
"""Of the tip, over the axes' whole travel: it counts in so many standard deviations."""

PAPER = {
    "feed_forward": False,
    "fallback": False,
    "unvisited": "samples",
}
"""What `paper` sets."""


class RewardWeightedController(LearningController):
    """A `Controller`."""

    name = "reward_weighted"

    def __init__(self, options: RewardWeighted, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        if options.paper:
            options = options.model_copy(update=PAPER)
        self._law_options = options
        self._local: LocalControllers | GrowingControllers | None = None
        super().__init__(options, robot, seed)

    def _take_over(
        self, model: PretrainedModel | None, jacobian: LearntJacobian, learnt: Arrays
    ) -> None:
        options = self._law_options
        law = LocalLaw(options, self._follower.axes, self._follower.unit, options.damping_mm)
        posture = self._follower.posture
        if model is None:
            growing = GrowingControllers(
                law, self._scale(jacobian), jacobian.at, options.window, posture
            )
            if learnt:
                growing.restore(learnt)
            self._local = growing
            return
        fixed = law.on_model(model, posture)
        if learnt:
            fixed.refill(window_samples(learnt))
        self._local = fixed

    def _follow(self, observation: Observation) -> Proposal:
        follower, options = self._follower, self._law_options
        tip_step = follower.tip_step(observation)
        part = step_time(observation) / options.motion_s
        if not part > 0.0:
            return Proposal(np.zeros_like(observation.targets))
        command = self._command(tip_step / part, observation)
        local = part * command.delta_u
        if not options.fallback:
            return Proposal(follower.within_limits(local, observation), _note(command))
        trust = _trust(command)
        jacobian = self._jacobian.at(observation.tip_mm, observation.u)
        near = trust * local + (1.0 - trust) * follower.drawn(observation)
        wanted = trust * (jacobian @ local) + (1.0 - trust) * tip_step
        step = follower.axis_step(jacobian, wanted, observation, near)
        return Proposal(step, "" if trust > 0.0 else "follows by the forward model alone")

    def _command(self, tip_motion: Vector, observation: Observation) -> Command:
        assert self._local is not None
        return self._local.command(tip_motion, observation.tip_mm, observation.u)

    def _work_in(self, sample: MotionSample) -> None:
        assert self._local is not None
        self._jacobian.learn(sample)
        self._local.add(sample)

    def _go_on(self) -> None:
        assert self._local is not None
        self._local.solve(_SOLVED_AT_ONCE)

    def _posture_changed(self) -> None:
        if self._local is not None:
            self._local.set_posture(self._follower.posture)

    def _learnt_arrays(self) -> Arrays:
        if isinstance(self._local, GrowingControllers):
            return dict(self._local.to_arrays())
        assert self._local is not None
        arrays = window_arrays(self._local.window)
        self._local.refill(window_samples(arrays))  # as whoever loads this does
        return dict(arrays)

    def _scale(self, jacobian: LearntJacobian) -> Vector:
        """(3 + m,) what p and u count in where nothing is known but one Jacobian."""
        travel = self._follower.axes.travel
        reach = jacobian.at(np.zeros(3), np.zeros(len(travel))) * travel
        p_mm = _SPREADS * float(np.sqrt((reach**2).sum() / 3.0 / 12.0))
        return np.concatenate([np.full(3, p_mm), travel])


def _trust(command: Command) -> float:
    """How far local controllers are followed, 0 to 1."""
    return min(command.activation / _ACTIVE, command.support / _SUPPORTED, 1.0)


def _note(command: Command) -> str:
    return "" if command.support > 0.0 else "no local controller knows anything here"
