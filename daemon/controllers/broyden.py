"""A controller without a model: it measures the Jacobian, and corrects it by what it sees.

A sample for the correction ends only when axes and tip have gone far enough: from one frame to the
next there is mostly noise.
"""

from collections import deque
from contextlib import suppress
from itertools import chain
from math import isfinite, sqrt
from pathlib import Path
from typing import Final

import numpy as np

from config.robot import Robot
from config.tasks.controllers import Broyden
from daemon.array_files import Arrays, ModelError, read_as
from daemon.control.controller import Observation, Proposal
from daemon.control.jacobian_estimate import FIRST_STD_MM, JacobianEstimate
from daemon.control.lag.body_lag import KNOWN_LAG, BodyLag, known_lag
from daemon.control.lag.lagged_axes import LaggedAxes
from daemon.control.task import POSE, POSITION, points, task_of
from daemon.control.tip_following import TipFollower
from daemon.controllers.exploration.excursions import Excursions, Frame
from daemon.controllers.exploration.first_motions import BodysLag, FirstMotions
from daemon.controllers.exploration.tendon_pulls import TendonPulls
from daemon.controllers.model_files import load_model, model_metadata, save_model
from drivers.pose import Vector

_LAG_FRAMES_AT_ONCE = 3
"""Of the first motions, in spare time, so that they are all told within a second or two ..."""
_SHOWN_AT_ONCE = 30
"""... once they were looked at, within some tenths."""
_COMES_IN_RESTS: Final = 0.5
"""Lag, over the time in which the body settles: of a later one rests do not show all that comes."""
_WELL_SEEN: Final = 0.8
"""Share of the tip's motion that is the axes': where less is, motions are made anew, so much wider
that it should be. 3 mm of a piston move the tip of a short, stiff arm by 0.15 mm, which makes 0.13;
of most arms it is above 0.9."""
_WIDEST: Final = 0.25
"""Of each axis' range."""
_COUNTED = "pointing_mm_per_rad"
"""In a file: as how many mm a radian counts in its rows of the direction."""


class BroydenController:
    """A `Controller`."""

    steers_direction = True

    name = "broyden"

    def __init__(self, options: Broyden, robot: Robot) -> None:
        self._options = options
        self._metadata = model_metadata(self.name, robot)
        self._follower = TipFollower(options, robot)
        self._scale = self._follower.axes.scale
        self._tendon_pulls = TendonPulls.of(robot, self._follower.axes)
        """None: they are known by now, or so few that nothing has to be known."""
        self._excursions = Excursions(options, self._follower.axes)
        self._estimate: JacobianEstimate | None = None
        self._anchor: tuple[Vector, Vector] | None = None
        self._axes = LaggedAxes(self._scale)
        self._motions = FirstMotions(self._scale, 0.0) if options.leads else None
        """None: how late the body is, is known, or not asked."""
        self._widened = False
        """Whether the first motions were made anew, wider."""
        self._shown = LaggedAxes(self._scale)
        self._axes_shown: list[Vector] = []
        """Of the first motions, as the tip shows them."""
        self._seen: deque[Frame] = deque()
        """Frames of the first motions that have not told yet how late the body is."""
        self._first_lag = BodyLag()
        self._first = np.zeros((POSITION, len(self._scale)))
        """(3, m) Jacobian that the first motions have shown; (6, m) with directions."""
        self._last_seen_s = 0.0
        self._points = False
        """Whether the reference has ever said where to point: a hand does so when it likes."""

    @property
    def ready(self) -> bool:
        return self._tendon_pulls is None and self._estimate is not None and not self._looks_back

    @property
    def jacobian(self) -> Vector | None:
        """(3, m) mm per mm or rad, (6, m) with the direction; None before it is measured."""
        return None if self._estimate is None else self._estimate.jacobian / self._scale

    def draw_to(self, posture: Vector) -> None:
        """Draw the axes to (m,) a posture from now on. Raises ValueError for no numbers."""
        self._follower.set_posture(posture)

    def reset(self, observation: Observation) -> None:
        self._follower.reset(observation)
        self._excursions.reset()
        if self._tendon_pulls is not None:
            self._tendon_pulls.begin()
        self._axes.break_off()
        self._anchor = None
        if self._motions is not None:
            self._motions.break_off()

    def observe(self, observation: Observation) -> None:
        measured = chain(observation.u.tolist(), observation.tip_mm.tolist())
        if not (observation.believed and all(map(isfinite, measured))):
            return
        if points(observation) and not self._points:
            self._begin_to_point()
        u, t_s = observation.u, observation.t_ns * 1e-9
        if self._options.leads:
            self._axes.see(t_s, u, observation.targets)
        if self._estimate is None:
            self._see_excursions(observation)
            return
        if self._options.leads:
            lag = self._follower.leading.lag
            u = self._axes.after(t_s, u, lag.lag_s, lag.dead_share)
        coordinates = len(self._estimate.jacobian)
        seen = task_of(observation, coordinates, self._options.pointing_mm_per_rad)
        if seen is None:
            return
        here = (u / self._scale, seen)
        if self._anchor is None:
            self._anchor = here
            return
        moved, tip_moved = here[0] - self._anchor[0], here[1] - self._anchor[1]
        if (
            float(moved @ moved) >= self._options.sample_travel_share**2
            and float(tip_moved @ tip_moved) >= self._options.sample_tip_mm**2
        ):
            self._estimate.correct(moved, tip_moved)
            self._anchor = here

    def _see_excursions(self, observation: Observation) -> None:
        motions, excursions = self._motions, self._excursions
        excursions.observe(observation)
        if motions is not None:
            motions.see(observation)
        if not excursions.done or (motions is not None and self._goes_wider(motions)):
            return
        self._show(excursions.jacobian)
        if motions is None:
            return
        if not (motions.ask() and motions.lag.lag_s > _COMES_IN_RESTS * self._options.settle_s):
            self._motions = None
            self._seen = deque(excursions.all_frames)

    def _goes_wider(self, motions: FirstMotions) -> bool:
        """Whether what came of the first motions is too much noise; then others are to be made.
        Tendons would strain each other, or go slack."""
        before, axes = self._options.explore_share, self._follower.axes
        explained = motions.share_explained()
        if explained >= _WELL_SEEN or self._widened or before >= _WIDEST or axes.opposed:
            return False
        times = sqrt(_WELL_SEEN / (1.0 - _WELL_SEEN) * (1.0 - explained) / max(explained, 0.01))
        options = self._options.model_copy(update={"explore_share": min(times * before, _WIDEST)})
        self._widened = True
        self._motions, self._excursions = FirstMotions(self._scale, 0.0), Excursions(options, axes)
        return True

    def propose(self, observation: Observation) -> Proposal:
        if (pulls := self._tendon_pulls) is not None:
            if not pulls.done:
                return Proposal(pulls.propose(observation), pulls.note, 0)
            self._tendon_pulls, self._follower.axes = None, pulls.axes
            self._excursions = Excursions(self._options, pulls.axes)
        if self._estimate is None:
            return Proposal(self._excursions.propose(observation), self._excursions.note, 0)
        if self._looks_back:
            note = "works out how late the body follows"
            return Proposal(np.zeros(len(self._scale)), note, 0)
        jacobian = self._estimate.jacobian / self._scale
        step = self._follower.task_step(observation)
        rows = min(len(jacobian), len(step))
        return self._follower.proposal(
            self._follower.axis_step(jacobian[:rows], step[:rows], observation), observation
        )

    def learn(self) -> None:
        """What the first motions tell of the body's lag, and of the Jacobian of so late a body, a
        little at a time."""
        self._follower.work_off()
        if self._motions is not None and self._motions.asked:
            self._look_again(self._motions.lag)
        for _ in range(min(_LAG_FRAMES_AT_ONCE, len(self._seen))):
            t_s, u, seen = self._seen.popleft()
            told_mm = self._first[:POSITION] @ (u / self._scale)
            self._first_lag.add(t_s, t_s - self._last_seen_s, told_mm, seen[:POSITION])
            self._last_seen_s = t_s
            if not self._seen:
                # These axes were measured, and are told before that.
                late_s = self._first_lag.lag_s + self._axes.late_s
                self._follower.leading.lag.lag_s = late_s
                better = self._first.copy()
                better[:POSITION] *= self._first_lag.gains[:, None]
                self._show(better)

    @property
    def _looks_back(self) -> bool:
        """Whether the first motions are over, and what they show is still to be looked at."""
        return bool(self._seen) or (self._motions is not None and self._motions.asked)

    def _look_again(self, lag: BodysLag) -> None:
        """At the first motions, with the axes as the tip of so late a body shows them: then they
        tell the Jacobian, and that how late it is, finer than they did without one."""
        frames, shown = self._excursions.all_frames, self._axes_shown
        for t_s, u, _ in frames[len(shown) : len(shown) + _SHOWN_AT_ONCE]:
            shown.append(self._shown.after(t_s, u, *lag))
        if len(shown) == len(frames):
            self._motions = None
            self._first_lag = BodyLag(lag.lag_s)
            self._seen = deque(frames)
            self._show(self._excursions.jacobian_of_late(np.array(shown)))

    def save(self, path: Path) -> None:
        if self._estimate is None:
            raise ModelError("there is nothing to save: the Jacobian is not measured yet")
        estimate = self._estimate
        arrays = {"jacobian": estimate.jacobian, "covariance": estimate.covariance}
        if len(estimate.jacobian) == POSE:
            arrays[_COUNTED] = np.array(self._options.pointing_mm_per_rad)
        if self._options.leads:
            arrays |= self._follower.leading.lag.to_arrays()
        save_model(path, self._metadata, arrays)

    def load(self, path: Path) -> None:
        arrays = self._read(path)
        jacobian, now = arrays["jacobian"], self._options.pointing_mm_per_rad
        counted = float(arrays.get(_COUNTED, np.array(now)))  # there are files that do not say
        if not counted > 0.0:
            raise ModelError(f"{path} is damaged: {_COUNTED} is {counted:g}, and must be above 0")
        with read_as(path, "a model of this kind"):
            lag = known_lag(arrays)
        jacobian[POSITION:] *= now / counted
        self._begin(jacobian, arrays["covariance"])
        if lag is not None:
            self._follower.leading.lag.take_for(*lag)

    def _read(self, path: Path) -> Arrays:
        """With the direction's rows, if it has them. Raises ModelError or OSError."""
        count = len(self._scale)
        place = {"jacobian": (POSITION, count), "covariance": (count, count)}
        pose = {**place, "jacobian": (POSE, count)}
        optional = {_COUNTED: (), KNOWN_LAG: (2,)}
        with suppress(ModelError):
            return load_model(path, self._metadata, pose, optional)
        return load_model(path, self._metadata, place, optional)

    def _begin_to_point(self) -> None:
        """First motions showed what turns the tip, too, if they are over."""
        self._points = True
        estimate, rows = self._estimate, self._first[POSITION:]
        if estimate is None or len(estimate.jacobian) == POSE:
            return
        if len(rows):
            first = np.concatenate([estimate.jacobian, rows])
            self._begin(first, np.eye(len(self._scale)) * FIRST_STD_MM**2)

    def _show(self, jacobian: Vector) -> None:
        """The first motions have shown this one."""
        self._first = jacobian
        coordinates = POSE if self._points else POSITION
        self._begin(jacobian[:coordinates], np.eye(len(self._scale)) * FIRST_STD_MM**2)

    def _begin(self, jacobian: Vector, covariance: Vector) -> None:
        self._estimate = JacobianEstimate(
            jacobian, covariance, self._options.sample_noise_mm, self._options.drift_mm
        )
        self._anchor = None


def make(options: Broyden, robot: Robot, seed: int) -> BroydenController:
    """It does nothing at random. Raises ControllerError."""
    del seed
    return BroydenController(options, robot)
