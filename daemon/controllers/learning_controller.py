"""What controllers have in common that learn: a start, samples, a Jacobian, and files.

Without a model the first motions are babbling, from which the Jacobian is fitted. Samples are
worked in when there is time, not in the step that completes them.
"""

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np

from config.controllers import Learner
from config.robot import Robot
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.tip_following import TipFollower
from daemon.controllers.babbling import Babbling
from daemon.controllers.learning_file import Arrays, LearntFile, load_learnt, save_learnt
from daemon.controllers.learning_samples import LearningSamples, sampling_with
from daemon.controllers.learnt_jacobian import LearntJacobian
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.samples.motion_sample import MotionSample
from daemon.learning.samples.motion_samples import SamplingSettings
from daemon.npz_file import ModelError
from drivers.pose import Vector

_UNKNOWN_BODY = SamplingSettings(lag_s=0.1)
_SAMPLES_PER_AXIS = 3
"""So many must babbling give before a Jacobian is fitted."""
_WAITING_AT_MOST = 3
_WITHOUT_MODEL = 0.5
"""So much shorter are samples where nothing but they tells how the Jacobian changes on the way: on
the soft arm's figure of eight and rectangle, with and without a load, errors are a third less."""
_FIT_RIDGE = 1e-3


class LearningController(ABC):
    """A `Controller` but for what it does with its samples and its Jacobian."""

    name: str

    def __init__(self, options: Learner, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._options = options
        self._robot = robot
        self._follower = TipFollower(options, robot)
        self._travel = self._follower.axes.travel
        self._jacobian = LearntJacobian(options, self._travel)
        self._babbling = Babbling(options.babbling, self._follower.axes, seed)
        self._babbled: list[MotionSample] = []
        self._model: PretrainedModel | None = None
        self._samples = self._sampler(_UNKNOWN_BODY)
        self._waiting: deque[MotionSample] = deque()
        if options.model is not None:
            self._load_first(Path(options.model).expanduser())
        elif not options.learning:
            raise ControllerError(f"{self.name} has no model and shall not learn one: give `model`")

    @property
    def ready(self) -> bool:
        return self._jacobian.known

    @property
    def doubted(self) -> int:
        """Samples that were left out because the axes cannot have caused them."""
        return self._samples.doubted

    def set_posture(self, posture: Vector) -> None:
        """Draw the axes to (m,) another posture: here secondary objectives come in.

        Raises ValueError for what is not one.
        """
        self._follower.set_posture(posture)
        self._posture_changed()

    def reset(self, observation: Observation) -> None:
        self._samples.break_off()
        self._babbling.reset()
        before = self._follower.posture
        self._follower.reset(observation)
        if not np.array_equal(self._follower.posture, before):
            self._posture_changed()

    def observe(self, observation: Observation) -> None:
        if not self._options.learning:
            return
        sample = self._samples.add(observation)
        if sample is None:
            return
        if not self._jacobian.known:
            self._babbled.append(sample)
            return
        self._waiting.append(sample)
        if len(self._waiting) > _WAITING_AT_MOST:
            self._work_in(self._waiting.popleft())

    def propose(self, observation: Observation) -> Proposal:
        if self._jacobian.known:
            return self._follow(observation)
        if self._babbling.done:
            self._end_babbling()
            return Proposal(np.zeros(len(self._travel)))
        return Proposal(self._babbling.propose(observation), self._babbling.note)

    def learn(self, budget_s: float) -> None:
        """One sample, or a little of what else can wait: counted, whatever a clock would say."""
        del budget_s
        if self._waiting:
            self._work_in(self._waiting.popleft())
        elif self._jacobian.known:
            self._go_on()

    def save(self, path: Path) -> None:
        if not self._jacobian.known:
            raise ModelError("there is nothing to save: nothing is learnt yet")
        while self._waiting:
            self._work_in(self._waiting.popleft())
        arrays = {**self._jacobian.to_arrays(), **self._learnt_arrays()}
        model, forward = self._model, self._jacobian.forward
        if model is not None and forward is not None:
            model = replace(model, lwpr=forward)
        save_learnt(path, LearntFile(self.name, model, arrays), self._robot)

    def load(self, path: Path) -> None:
        loaded = load_learnt(path, self.name, self._robot)
        try:
            self._go_on_from(loaded)
        except (ValueError, KeyError) as error:
            raise ModelError(f"{path} does not fit: {error}") from None

    # What the kinds of controllers differ in.

    @abstractmethod
    def _take_over(
        self, model: PretrainedModel | None, jacobian: LearntJacobian, learnt: Arrays
    ) -> None:
        """Go by these from now on. learnt: what `_learnt_arrays` gave once; may be empty.

        Raises ValueError, KeyError; nothing has changed then.
        """

    @abstractmethod
    def _follow(self, observation: Observation) -> Proposal:
        """The next step. The Jacobian is known."""

    @abstractmethod
    def _work_in(self, sample: MotionSample) -> None:
        """Learn from it."""

    @abstractmethod
    def _learnt_arrays(self) -> Arrays:
        """What was learnt besides model and Jacobian."""

    @abstractmethod
    def _go_on(self) -> None:
        """Work that can wait, in small pieces."""

    @abstractmethod
    def _posture_changed(self) -> None:
        """The follower has another one."""

    # Parts of the above.

    def _load_first(self, path: Path) -> None:
        try:
            self.load(path)
        except (ModelError, OSError) as error:
            raise ControllerError(f"the model cannot be loaded: {error}") from None

    def _go_on_from(self, loaded: LearntFile) -> None:
        jacobian = LearntJacobian(self._options, self._travel)
        if loaded.model is not None:
            jacobian.begin(loaded.model.lwpr)
        if loaded.arrays:
            jacobian.restore(loaded.arrays)
        if not jacobian.known:
            raise ValueError("it knows no Jacobian")
        self._adopt(loaded.model, jacobian, loaded.arrays)

    def _adopt(
        self, model: PretrainedModel | None, jacobian: LearntJacobian, learnt: Arrays
    ) -> None:
        self._take_over(model, jacobian, learnt)
        self._model, self._jacobian = model, jacobian
        self._samples = self._sampler(_UNKNOWN_BODY if model is None else model.sampling)
        self._waiting.clear()

    def _end_babbling(self) -> None:
        """Fit a Jacobian to what was seen. Raises ControllerError where it was too little."""
        babbled = self._babbled
        if len(babbled) < _SAMPLES_PER_AXIS * len(self._travel):
            raise ControllerError(
                f"the first motions gave {len(babbled)} samples: see what holds the tip, or let "
                f"them be longer or wider (babbling)"
            )
        jacobian = LearntJacobian(self._options, self._travel)
        jacobian.measured(_fitted_jacobian(babbled, self._travel))
        self._adopt(None, jacobian, {})
        for sample in babbled:
            self._work_in(sample)
        self._babbled = []

    def _sampler(self, base: SamplingSettings) -> LearningSamples:
        options = self._options
        sampling = sampling_with(base, options)
        if self._model is None:
            sampling = replace(sampling, tip_mm=_WITHOUT_MODEL * sampling.tip_mm)
        return LearningSamples(sampling, self._travel, options.sample_noise_mm, self._jacobian)


def _fitted_jacobian(samples: list[MotionSample], travel: Vector) -> Vector:
    """(3, m) mm per mm or rad, by least squares."""
    moved = np.array([sample.delta_u for sample in samples]) / travel
    tip_moved = np.array([sample.delta_tip_mm for sample in samples])
    gram = moved.T @ moved
    ridge = _FIT_RIDGE * np.trace(gram) / len(gram)
    solution = np.linalg.solve(gram + ridge * np.eye(len(gram)), moved.T @ tip_moved)
    return np.asarray(solution.T / travel)
