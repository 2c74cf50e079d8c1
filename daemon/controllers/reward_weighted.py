"""The controller of Ho 2018: local inverse controllers, learnt by reward-weighted regression.

The wanted motion of the tip is asked of all fields' controllers, and their answers are blended. A
field's controller is at first the inverse of the forward model there (`imagined_prior`) and comes
to be what the samples of the window say, which rewards for being near the attractor choose among.

Controllers are asked for a motion as long as their samples, of which a step is a part: what they
know of drift and posture belongs to that length of time.

The step is the one nearest to their answer with which the tip goes as it was asked to by the learnt
Jacobian: they say how the axes share the motion, and regression's noise in how far they have the
tip go is taken out. Answers are trusted as far as fields are active and samples, imagined ones
among them, speak about the motion that is wanted, and as far as the learnt Jacobian does not
contradict them; for the rest the step is near the posture, as in `forward_jacobian`. There is no
integrator that could wind up. Where hardly a field is active the learnt Jacobian is a guess as
well, and the axes are drawn harder to the posture, round which the model was learnt.

The variant of the paper (`fallback: false`) takes their answer as it is.
"""

from collections import deque
from collections.abc import Callable, Mapping
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from config.tasks.controllers import RewardWeighted
from daemon.array_files import Arrays
from daemon.control.controller import Observation, Proposal
from daemon.control.task import POSITION
from daemon.control.tip_following import step_time
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.learnt_jacobian import TipJacobian
from daemon.controllers.local_law import LocalLaw, window_arrays, window_samples
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.inverse.local_controllers import InverseAnswer, LocalControllers
from daemon.learning.inverse.window import Window
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

# Local controllers for a robot that nothing was known of: fields come where the robot comes.
#
# Where no field is active a new one is made, whose controller is at first the inverse of the
# Jacobian as it is known then. Engines stand on fields that do not change. So a new field means a
# new engine; it is filled from the window in idle time, and takes over when it knows as much as
# the old one.


_BORN_BELOW = 0.3
"""A sample that no field weighs more makes one."""
_MOST_FIELDS = 500
_METRIC = 16.0
"""Of every field: it reaches a quarter of the travel."""
_REFILLED_AT_ONCE = 2


class GrowingControllers:
    """The part of a `LocalControllers` that a controller needs."""

    def __init__(
        self,
        law: LocalLaw,
        scale: Vector,
        jacobian_at: Callable[[Vector, Vector], Vector],
        capacity: int,
        posture: Vector,
    ) -> None:
        """scale: (3 + m,) what p and u count in. jacobian_at: (3, m) at (3,) p and (m,) u."""
        self.window = Window(capacity, law.settings.axes)
        self._law = law
        self._scale = scale
        self._jacobian_at = jacobian_at
        self._posture = posture
        self._centres = np.zeros((0, len(scale)))
        self._jacobians = np.zeros((0, 3, law.settings.axes))
        self._engine: LocalControllers | None = None
        self._next: LocalControllers | None = None
        self._missing: deque[MotionSample] = deque()
        """What the next engine has not seen yet, oldest first."""

    @property
    def count(self) -> int:
        """Fields, with the one that is being made."""
        return len(self._centres)

    def add(self, sample: MotionSample) -> None:
        """Take a sample in. Raises ValueError, and nothing changes then."""
        self.window.add(sample)
        if self._engine is not None:
            self._engine.add(sample)
        if self._next is not None:
            self._missing.append(sample)
        elif self._alone(sample):
            self._bear(sample)

    def solve(self, budget: int | None = None) -> None:
        """Work that can wait: bring the next engine up to date, or solve fields."""
        if self._next is None:
            if self._engine is not None:
                self._engine.solve(budget)
            return
        for _ in range(len(self._missing) if budget is None else _REFILLED_AT_ONCE):
            if self._missing:
                self._next.add(self._missing.popleft())
        if not self._missing:
            self._engine, self._next = self._next, None

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> InverseAnswer:
        """See `LocalControllers`."""
        if self._engine is None:
            return InverseAnswer(np.zeros(len(u)), 0.0, 0.0)
        return self._engine.command(delta_tip_mm, tip_mm, u)

    def set_posture(self, posture: Vector) -> None:
        """See `LocalControllers`."""
        self._posture = posture
        if self._engine is not None:
            self._engine.set_posture(posture)
        if self._next is not None:
            self._next.set_posture(posture)

    def to_arrays(self) -> dict[str, NDArray[np.float64]]:
        """For a file. From here on this goes on as what is made of them does."""
        self.solve()
        arrays = {
            "field_centres": self._centres,
            "field_jacobians": self._jacobians,
            "field_scale": self._scale,
            **window_arrays(self.window),
        }
        self.restore(arrays)
        return arrays

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, ValueError."""
        self._scale = arrays["field_scale"]
        self._centres, self._jacobians = arrays["field_centres"], arrays["field_jacobians"]
        samples = window_samples(arrays)
        self.window.clear()
        for sample in samples[-self.window.capacity :]:
            self.window.add(sample)
        self._next = None
        self._missing.clear()
        self._engine = self._made() if self.count else None
        if self._engine is not None:
            self._engine.refill(self.window)

    def _alone(self, sample: MotionSample) -> bool:
        away = np.concatenate([sample.tip_mm, sample.u]) / self._scale - self._centres
        squared = np.einsum("fd,fd->f", away, away).min(initial=np.inf)
        return self.count < _MOST_FIELDS and bool(np.exp(-0.5 * _METRIC * squared) < _BORN_BELOW)

    def _bear(self, sample: MotionSample) -> None:
        place = np.concatenate([sample.tip_mm, sample.u]) / self._scale
        jacobian = self._jacobian_at(sample.tip_mm, sample.u)
        self._centres = np.concatenate([self._centres, place[None]])
        self._jacobians = np.concatenate([self._jacobians, jacobian[None]])
        self._next = self._made()
        self._missing.extend(self.window)

    def _made(self) -> LocalControllers:
        metrics = np.tile(_METRIC * np.eye(len(self._scale)), (self.count, 1, 1))
        fields = ReceptiveFields(self._centres, metrics, self._scale)
        return self._law.on_fields(fields, self._jacobians, self._posture)


_ACTIVE = 0.01
_SUPPORTED = 1.0
"""Below this activation and support the controllers' answer is trusted in proportion."""
_SOLVED_AT_ONCE = 4
_AGREED, _CONTRADICTED = 0.6, 0.9
"""Shares of a wanted motion that the forward model may miss in the controllers' answer: up to the
one it is trusted, from the other on not at all. A load changes a body by some ten per cent. Who
answers with no motion at all would never see another sample and stay where he is."""
_KNOWN = 0.1
_DRAWN_HARDER = 8.0
"""Below this activation the axes are drawn to the posture up to so many times harder than else.
Chosen: on paths through what was explored fields are active by 0.2 and more. With three axes at
their ends the activation is 0.02 to 0.04, and the path takes more than the plain gain gives back;
6 to 20 times harder come to the same."""
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
        self.steers_direction = options.fallback
        super().__init__(options, robot, seed)

    def _take_over(
        self, model: PretrainedModel | None, jacobian: TipJacobian, learnt: Arrays
    ) -> None:
        options = self._law_options
        law = LocalLaw(options, self._follower.axes, self._follower.redundancy)
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
        tip_mm = self._follower.due_mm(observation)
        jacobian = self._jacobian.at(tip_mm, observation.u)
        task_step, task_jacobian = self._task(observation, jacobian)
        tip_step = task_step[:POSITION]
        part = step_time(observation) / options.motion_s
        if not part > 0.0:
            return Proposal(np.zeros_like(observation.targets))
        command = self._command(tip_step / part, tip_mm, observation)
        local = part * command.delta_u
        if not options.fallback:
            step = follower.other_step(jacobian, local, observation)
            return follower.proposal(step, observation, _note(command))
        trust = _trust(command) * _agreement(jacobian @ local, tip_step)
        near = trust * local + (1.0 - trust) * follower.drawn(observation, self._drawn_by(command))
        near = near + follower.drawn_further(observation)
        step = follower.axis_step(task_jacobian, task_step, observation, near)
        note = "" if trust > 0.0 else "follows by the forward model alone"
        return follower.proposal(step, observation, note)

    def _drawn_by(self, command: InverseAnswer) -> float:
        """Times the gain of the posture. Fields that are made on the way tell nothing of what is
        known round it."""
        if isinstance(self._local, GrowingControllers):
            return 1.0
        return 1.0 + _DRAWN_HARDER * max(1.0 - command.activation / _KNOWN, 0.0)

    def _command(
        self, tip_motion: Vector, tip_mm: Vector, observation: Observation
    ) -> InverseAnswer:
        assert self._local is not None
        return self._local.command(tip_motion, tip_mm, observation.u)

    def _work_in(self, sample: MotionSample, gains: Vector) -> None:
        assert self._local is not None
        self._jacobian.learn(sample, gains)
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

    def _scale(self, jacobian: TipJacobian) -> Vector:
        """(3 + m,) what p and u count in where nothing is known but one Jacobian."""
        scale = self._follower.axes.scale
        reach = jacobian.at(np.zeros(3), np.zeros(len(scale))) * scale
        p_mm = _SPREADS * float(np.sqrt((reach**2).sum() / 3.0 / 12.0))
        return np.concatenate([np.full(3, p_mm), scale])


def _trust(command: InverseAnswer) -> float:
    """How far local controllers are followed, 0 to 1."""
    return min(command.activation / _ACTIVE, command.support / _SUPPORTED, 1.0)


def _agreement(made: Vector, wanted: Vector) -> float:
    """How far (3,) mm that the forward model has an answer make are the (3,) that were wanted, 0
    to 1."""
    differs, asked = made - wanted, float(wanted @ wanted)
    if not asked > 0.0:
        return 1.0
    share = sqrt(float(differs @ differs) / asked)
    return min(max((_CONTRADICTED - share) / (_CONTRADICTED - _AGREED), 0.0), 1.0)


def _note(command: InverseAnswer) -> str:
    return "" if command.support > 0.0 else "no local controller knows anything here"
