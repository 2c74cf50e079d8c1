"""What controllers have in common that learn: a start, samples, a Jacobian, and files.

Without a model the first motions are babbling, from which the Jacobian is fitted; where the tip
shall point somewhere as well, what turns it is found in such motions with a model, too. Samples are
worked in when there is time, not in the step that completes them.
"""

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np

from config.paths import named_model
from config.robot import Robot
from config.tasks.controllers import Learner
from daemon.array_files import Arrays, ModelError
from daemon.control.axis_speeds import Foresight
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.lag.body_lag import known_lag
from daemon.control.lag.lagged_axes import LaggedAxes
from daemon.control.task import POSITION, points
from daemon.control.tip_following import TipFollower
from daemon.controllers.exploration.first_learning import FirstLearning
from daemon.controllers.exploration.tendon_pulls import TendonPulls
from daemon.controllers.learning_samples import LearningSamples, sampling_with
from daemon.controllers.learnt_jacobian import (
    LearntJacobian,
    TipJacobian,
    learnt_foresight,
)
from daemon.controllers.model_files import LearntFile, load_learnt, save_learnt
from daemon.controllers.pointing_jacobian import PointingJacobian
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.motion_samples import SamplingSettings
from drivers.pose import Vector

_UNKNOWN_BODY = SamplingSettings(lag_s=0.1)
"""So late first motions are taken to come until they tell otherwise, unless options say how late.
In them axes turn round all the time: of a body that is 0.3 s late, taken for prompt, they tell a
Jacobian a third as large as its own, and turned."""
_WAITING_AT_MOST = 3
_LATE = 0.5
"""From where so much of a lag is led by prediction, what a load makes of the body is told by the
jump alone. Motions that are learnt from at once tell it too late: the first of a slow body's loads
then takes twice as long to be made up for."""
_WITHOUT_MODEL = 0.5
"""So much shorter are samples where nothing but they tells how the Jacobian changes on the way: on
the soft arm's figure of eight and rectangle, with and without a load, errors are a third less."""
_OF_ANOTHER_BODY = "the model is of another body: "
_SHORTEST_LED_S = 0.2
"""Of a sample where the lag is found on the way, to some hundredths of a second: at 40 mm/s one of
2 mm would tell more of those than of the axes, and cycles of 0.3 mm would now and then be 10 mm."""


class LearningController(ABC):
    """A `Controller` but for what it does with its samples and its Jacobian."""

    name: str
    steers_direction = True

    def __init__(self, options: Learner, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._options = options
        self._robot = robot
        self._seed = seed
        self._points = False
        """Whether the reference has ever said where to point: a hand does so when it likes."""
        self._of_another_body = False
        """Whether the body was seen to be another one than the model's, which is left out."""
        self._know_nothing(TipFollower(options, robot))
        self._tendon_pulls = TendonPulls.of(robot, self._follower.axes)
        self._unseen: Observation | None = None
        """The last one, of which nothing is learnt yet."""
        self._asked = True
        """Whether a step was asked for since the last frame: of a robot that is held none is."""
        self._axes = LaggedAxes(self._range)
        self._jumps = 0
        """Of the tip, that the Jacobian was told of."""
        if options.model is not None:
            self._load_first(named_model(options.model))
        elif not options.learning:
            raise ControllerError(f"{self.name} has no model and shall not learn one: give `model`")

    def _know_nothing(self, follower: TipFollower) -> None:
        """Of a body that is led by it."""
        self._follower = follower
        self._range = follower.axes.scale
        self._jacobian = self._new_jacobian()
        self._pointing = PointingJacobian(self._options, self._range)
        self._first = FirstLearning(self._options, follower.axes, self._seed, _UNKNOWN_BODY.lag_s)
        self._model: PretrainedModel | None = None
        self._take_for_late(_UNKNOWN_BODY)
        self._waiting: deque[MotionSample] = deque()

    @property
    def ready(self) -> bool:
        return self._tendon_pulls is None and self._learnt and self._follower.probed

    @property
    def _learnt(self) -> bool:
        """Whether the first motions have told how the body answers, or need not."""
        return self._jacobian.known and (self._pointing.known or not self._points)

    @property
    def foresight(self) -> Foresight | None:
        """What the forward model says of a path before it is gone; None: there is none."""
        if self._model is None:
            return None
        return learnt_foresight(self._model, self._jacobian, self._follower)

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
        if self._shall_do_without_model:
            self._leave_model_out()
        self._unseen, self._asked = None, True
        self._samples.break_off()
        self._axes.break_off()
        self._pointing.break_off()
        self._points = self._points or self._shall_point(observation)
        self._first.begin(enough=self._learnt)
        if self._tendon_pulls is not None:
            self._tendon_pulls.begin()
        before = self._follower.posture
        self._follower.reset(observation)
        if not np.array_equal(self._follower.posture, before):
            self._posture_changed()

    def observe(self, observation: Observation) -> None:
        """Learnt from when there is time, at the latest with the next one: a frame waits for its
        step, and one tells little of the body. First motions are those that were asked for: what
        is seen of a robot that is held meanwhile is none of them, and may be hours of frames."""
        self._work_off()
        if not (self.ready or self._points) and self._shall_point(observation):
            self._points = True
            self._first.go_on()  # of which all tells what turns the tip
            self.reset(observation)
        asked, self._asked = self._asked, False
        learns = self._options.learning and self._follower.probed
        if learns if self._learnt else asked and not self._first.looks_back:
            self._unseen = observation

    def _work_off(self) -> bool:
        """What was put off. Whether anything was."""
        observation, self._unseen = self._unseen, None
        self._follower.work_off()
        if observation is not None:
            self._take_in(observation)
        elif self._first.looks_back:
            self._look_back()
        else:
            return False
        return True

    def _look_back(self) -> None:
        """What of that is done at once: first motions of a body that is not as late as they were
        taken to be are learnt from anew."""
        first = self._first
        if not first.asked:
            if first.ask():
                self._samples = self._sampler(replace(_UNKNOWN_BODY, lag_s=0.0))
                self._pointing = PointingJacobian(self._options, self._range)
            return
        for observation in first.again():
            if observation is None:
                self._samples.break_off()
            else:
                self._see_first(observation)

    def _see_first(self, observation: Observation) -> None:
        """One of the first motions again, `u` as the tip shows it."""
        if self._points and observation.believed:
            self._pointing.observe(observation)
        sample = self._samples.add(observation)
        if sample is not None:
            self._first.samples.append(sample)

    def _take_in(self, observation: Observation) -> None:
        self._first.see(observation)
        if self._options.leads and observation.believed:
            lag = self._follower.leading.lag
            t_s = observation.t_ns * 1e-9
            self._axes.see(t_s, observation.u, observation.targets)
            free = self._follower.free(observation.u)
            shown = self._axes.after(t_s, free, lag.lag_s, lag.dead_share)
            observation = observation._replace(u=shown)
        if self._points and observation.believed:
            self._pointing.observe(observation)
        self._jacobian.believed = self._follower.learnable
        leading = self._follower.leading
        if leading.jumps != self._jumps:
            self._jumps = leading.jumps
            if leading.late < _LATE:
                self._jacobian.body_changed()
        sample = self._samples.add(observation)
        if sample is None or not self._options.learning:
            return
        if not self._jacobian.known:
            self._first.samples.append(sample)
            return
        self._waiting.append(sample)
        if len(self._waiting) > _WAITING_AT_MOST:
            self._work_in_next()

    def propose(self, observation: Observation) -> Proposal:
        if (pulls := self._tendon_pulls) is not None:
            if not pulls.done:
                return Proposal(pulls.propose(observation), pulls.note, 0)
            self._tendon_pulls, self._follower.axes = None, pulls.axes
            self._first.go_within(pulls.axes)
        self._asked = True
        observation = observation._replace(u=self._follower.due_axes(observation))
        if self.ready:
            if self._shall_do_without_model:
                raise ControllerError(
                    f"{_OF_ANOTHER_BODY}resume, and small motions show how this one answers"
                )
            self._begin_to_point(observation)
            return self._follow(observation)
        if self._learnt:
            jacobian = self._jacobian.at(observation.tip_mm, observation.u)
            proposal = self._follower.probe(jacobian, observation)
            done = self._follower.probed
            if done and self._can_do_without_model and self._follower.contradicted:
                self._leave_model_out()
                self.reset(observation)
            return proposal
        if self._first.over:
            self._end_first_learning()
            return Proposal(np.zeros(len(self._range)))
        proposal = self._first.propose(observation)
        why = _OF_ANOTHER_BODY if self._of_another_body else ""
        return proposal._replace(note=why + proposal.note)

    def learn(self) -> None:
        """One sample, or a little of what else can wait: counted, whatever a clock would say."""
        if self._work_off():
            return
        if self._waiting:
            self._work_in_next()
        elif self._jacobian.known:
            self._go_on()

    def save(self, path: Path) -> None:
        if not self._jacobian.known:
            raise ModelError("there is nothing to save: nothing is learnt yet")
        self._work_off()
        while self._waiting:
            self._work_in_next()
        known = {**self._jacobian.to_arrays(), **self._pointing.to_arrays()}
        arrays = {**known, **self._learnt_arrays()}
        model, forward = self._model, self._jacobian.forward
        if model is None:  # which says how late its body is
            arrays |= self._follower.leading.lag.to_arrays()
        if model is not None and forward is not None:
            model = replace(model, lwpr=forward)
        save_learnt(path, LearntFile(self.name, model, arrays), self._robot)

    def load(self, path: Path) -> None:
        loaded = load_learnt(path, self.name, self._robot)
        try:
            self._go_on_from(loaded)
        except (ValueError, KeyError) as error:
            raise ModelError(f"{path} does not fit: {error}") from None

    def _work_in_next(self) -> None:
        """A motion that waits becomes what was told of it: of that more or less comes along each
        axis of space, and under a load along the way from rest, which is made up for where the body
        is led."""
        sample, follower = self._waiting.popleft(), self._follower
        told_mm = follower.as_told_mm(sample.delta_tip_mm, sample.tip_mm)
        self._work_in(sample._replace(delta_tip_mm=told_mm), follower.made_up_for)

    # What the kinds of controllers differ in.

    def _new_jacobian(self) -> TipJacobian:
        """What learns how the tip answers; it knows nothing yet."""
        return LearntJacobian(self._options, self._range)

    @abstractmethod
    def _take_over(
        self, model: PretrainedModel | None, jacobian: TipJacobian, learnt: Arrays
    ) -> None:
        """Go by these from now on. learnt: what `_learnt_arrays` gave once; may be empty.

        Raises ValueError, KeyError; nothing has changed then.
        """

    @abstractmethod
    def _follow(self, observation: Observation) -> Proposal:
        """The next step. The Jacobian is known."""

    @abstractmethod
    def _work_in(self, sample: MotionSample, gains: Vector) -> None:
        """Learn from it, as it was told: (3,) gains of it came, which are made up for."""

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

    @property
    def _can_do_without_model(self) -> bool:
        """A method that is followed as it was published goes on with what it has."""
        options = self._options
        return self._model is not None and options.learning and options.leads

    @property
    def _shall_do_without_model(self) -> bool:
        return self._jacobian.contradicted and self._can_do_without_model

    def _leave_model_out(self) -> None:
        """Motions went elsewhere than it says: first motions tell how this body answers. Axes on
        each other's wires, or an exploration that told nothing: who goes by such a model leads the
        tip away, and what he learns on the way never makes up for it."""
        follower, axes = TipFollower(self._options, self._robot), self._follower.axes
        follower.set_posture(self._follower.posture)
        follower.axes = axes  # which know what their tendons do against each other
        self._of_another_body = True
        self._know_nothing(follower)

    def _shall_point(self, observation: Observation) -> bool:
        return self.steers_direction and points(observation)

    def _begin_to_point(self, observation: Observation) -> None:
        """Raises ControllerError where a tip that is led shall point for the first time, and nobody
        knows what turns it: small motions in the middle of others' would come as a surprise."""
        if self._points or not self._shall_point(observation):
            return
        self._points = True
        if not self._pointing.known:
            raise ControllerError(
                "what turns the tip is not known yet: resume, and small motions show it"
            )

    def _task(self, observation: Observation, jacobian: Vector) -> tuple[Vector, Vector]:
        """(3,) mm that the tip shall move, and (3, m) `jacobian`; (6,) and (6, m) where it shall
        turn as well."""
        step, rows = self._follower.task_step(observation), self._pointing.rows
        if len(step) == POSITION or rows is None:
            return step[:POSITION], jacobian
        return step, np.concatenate([jacobian, rows])

    def _load_first(self, path: Path) -> None:
        try:
            self.load(path)
        except (ModelError, OSError) as error:
            raise ControllerError(f"the model cannot be loaded: {error}") from None

    def _go_on_from(self, loaded: LearntFile) -> None:
        jacobian = self._new_jacobian()
        if loaded.model is not None:
            jacobian.begin(loaded.model)
        pointing = PointingJacobian(self._options, self._range)
        if loaded.arrays:
            jacobian.restore(loaded.arrays)
            pointing.restore(loaded.arrays)
        if not jacobian.known:
            raise ValueError("it knows no Jacobian")
        lag = None if loaded.model is not None else known_lag(loaded.arrays)
        self._adopt(loaded.model, jacobian, loaded.arrays)
        self._pointing = pointing
        if lag is not None and self._options.lag_s is None:
            self._take_for_as_late(*lag)

    def _adopt(self, model: PretrainedModel | None, jacobian: TipJacobian, learnt: Arrays) -> None:
        self._take_over(model, jacobian, learnt)
        self._of_another_body = self._of_another_body and model is None
        self._model, self._jacobian = model, jacobian
        self._follower.leading.modelled = model is not None
        self._follower.expect_hysteresis(jacobian.held_back)
        sampling = _UNKNOWN_BODY if model is None else model.sampling
        self._first.know_how_late()
        self._take_for_late(sampling)
        self._waiting.clear()

    def _take_for_late(self, sampling: SamplingSettings) -> None:
        """As late the body is taken to be until motions tell, whose samples are taken so."""
        self._samples = self._sampler(sampling)
        lag_s = self._options.lag_s
        self._follower.leading.lag.lag_s = sampling.lag_s if lag_s is None else lag_s

    def _take_for_as_late(self, lag_s: float, dead_share: float) -> None:
        """As motions without a model have told it."""
        self._take_for_late(replace(_UNKNOWN_BODY, lag_s=lag_s))
        self._follower.leading.lag.take_for(lag_s, dead_share)

    def _end_first_learning(self) -> None:
        """Go by the Jacobian of what was seen, or go on where it was nearly enough.

        Raises ControllerError where it was too little.
        """
        if self._points and not self._pointing.known:
            self._pointing.begin()
        if self._jacobian.known:
            return
        first = self._first
        measured = first.jacobian()
        if measured is None:
            return
        jacobian, lag = self._new_jacobian(), first.lag
        jacobian.measured(measured)
        self._adopt(None, jacobian, {})
        if lag is not None:
            # These axes were measured, and are told before that.
            self._take_for_as_late(lag.lag_s + self._axes.late_s, lag.dead_share)
        for sample in first.samples:
            self._work_in(sample, self._follower.made_up_for)
        first.samples = []

    def _sampler(self, base: SamplingSettings) -> LearningSamples:
        options = self._options
        sampling = sampling_with(base, options)
        if self._model is None:
            sampling = replace(sampling, tip_mm=_WITHOUT_MODEL * sampling.tip_mm)
        if options.leads:  # the axes come as the tip shows them
            sampling = replace(sampling, lag_s=0.0, shortest_s=_SHORTEST_LED_S)
        return LearningSamples(sampling, self._range, options.sample_noise_mm, self._jacobian)
