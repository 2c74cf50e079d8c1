"""What explorations have in common: line after line between places of the axes, and walls.

Many places may bring the tip out of its workspace. Where the tip comes near a wall all the same,
the axes go back the way they came, until it is well inside, and from there on to another place. So
they do where something stands in the way and a line comes to no end. A body with hysteresis goes
back another way than its axes do: where that one leads to a wall as well, the axes go straight to
where the first line began.
"""

from abc import ABC, abstractmethod
from collections import deque
from enum import Enum
from pathlib import Path

import numpy as np

from config.robot import Robot
from config.tasks.exploration import Exploration
from daemon.array_files import ModelError
from daemon.control.controller import Observation, Proposal
from daemon.control.redundancy import TensionKeeping
from daemon.control.task import POSITION
from daemon.control.tip_following import step_time
from daemon.controllers.exploration.lateness import Lateness
from daemon.controllers.exploration.random_motion import WaypointWalk
from daemon.controllers.exploration.tendon_pulls import TendonPulls
from daemon.controllers.exploration.walls import QuadraticGuess, Walls
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

DRAWN_AT_MOST = 60
"""Places, until one is inside with all of the way there."""
_ALONG = np.linspace(0.25, 1.0, 4)[:, None]
"""Where a line is looked at before it is gone along."""
_AHEAD_S = 0.4
"""A prompt body's tip goes on for so long, at most, after the axes were told to turn back ..."""
_AHEAD_BY_LATENESS = 2.0
"""... and one that is late so many times that: what is told already takes it on, the faster the
longer the line before was straight. With half as much a slow arm leaves its workspace."""
_PULLS_AHEAD_S = 0.2
"""A tension does so much longer than the tip is late: as long as the axes need to turn round."""
_LOOSE, _STRUNG = 0.18, 0.25
"""Of the weakest tendon's range of tensions. Where one has less than the first, a little less than
where arms are strung as they should be, each that has less than the second is pulled before the
first line: else every line ends as it begins, near the tension of which the walls keep off. Of 39
such arms one saw too little to learn from, and three went round a path 2 to 6 mm off that are 0.7
to 0.9 mm off with this."""
_STRUNG_SPEED = 0.1
"""Of their speed. With 8 N/mm and a delay of 0.25 s they are pulled 1 N too far."""
_STRUNG_WITHIN_S = 4.0
"""What is not by then will not be: it gives, or stretches."""
_TRAIL_STEPS = 2000
"""Of the way that the axes came, to go back along: 50 s at 40 frames a second."""
_GIVEN_UP = 3.0
_GIVEN_UP_S = 2.0
"""A line that takes so many times what it takes at full speed, and so much more, is given up."""
_WELL_INSIDE = 0.1
"""Of the workspace's width, from its walls."""
_TURNED_S = 1.0
_TURNED_BY_LATENESS = 2.0
"""The wall that it turned at is left behind after so long, and so many times the tip's lateness:
while the axes turn round it is near and not near by turns."""


class _Way(Enum):
    """Where it goes."""

    OUT = "along its line"
    BACK = "a wall came near: back along its trail"
    HOME = "the trail leads along a wall, or to one again, as that of a plastic body may: home"


class ExplorationController(ABC):
    """A `Controller` that follows nothing, goes along one line after another, and turns back where
    a wall is near. The kinds differ in where lines lead to, and in how many there are."""

    name: str

    def __init__(self, options: Exploration, robot: Robot, seed: int) -> None:
        self._axes = AxisRanges.of(robot)
        self._random = np.random.default_rng(seed)
        self._motion = options
        self._tendon_pulls = TendonPulls.of(robot, self._axes)
        self._walk = WaypointWalk(options, self._axes, self._random)
        self._walls = Walls(robot, options.wall_mm)
        self._guess = QuadraticGuess(self._axes, self._walls.count)
        self._lateness = Lateness(self._axes.travel)
        self._tension_keeping = TensionKeeping(robot, self._axes) if self._axes.opposed else None
        self._strung_s = 0.0
        """For so long tendons were pulled before the first line, ..."""
        self._strung_by = np.zeros(self._axes.count)
        """(m,) ... and so far."""
        self._line = -1
        self._start = self._goal = np.zeros(self._axes.count)
        self._trail: deque[Vector] = deque(maxlen=_TRAIL_STEPS)
        self._way = _Way.OUT
        self._back_s = 0.0
        """For so long it has gone back."""
        self._first: Vector | None = None
        """(m,) where the first line began."""
        self._left_s = 0.0
        """Until the line is given up."""
        self._asked = True
        """Whether a step was asked for since the last frame: of a robot that is held none is."""

    @property
    @abstractmethod
    def ready(self) -> bool:
        """Whether it has seen enough."""

    @property
    @abstractmethod
    def note(self) -> str:
        """What it is doing; empty when it is done."""

    @abstractmethod
    def _draw(self) -> Vector:
        """(m,) where the next line leads, from `_start`."""

    def reset(self, observation: Observation) -> None:
        self._asked = True
        self._walk.reset()
        if self._tension_keeping is not None:
            self._tension_keeping.begin()
        if self._line < 0:
            self._walls.stand_back(observation.tip_mm)
            if self._tension_keeping is not None:
                self._tension_keeping.see(observation.tensions_n, 0.0)
            if self._tendon_pulls is not None:
                self._tendon_pulls.begin()
            elif not self._is_loose:
                self._next_line(observation)

    def observe(self, observation: Observation) -> None:
        """Of a robot that is held nothing is learnt: one place, seen for an hour, would count for
        more than all that was explored."""
        asked, self._asked = self._asked, False
        if not asked:
            return
        values = self._walls.values(observation)
        finite = np.isfinite(observation.u).all() and np.isfinite(values).all()
        if observation.believed and finite:
            self._guess.add(observation.u, values)
            self._lateness.add(1e-9 * observation.t_ns, observation.u, observation.tip_mm)

    def propose(self, observation: Observation) -> Proposal:
        self._asked = True
        self._left_s -= step_time(observation)
        if self._tension_keeping is not None:
            late_s = self._lateness.seconds
            self._tension_keeping.see(observation.tensions_n, step_time(observation), late_s)
        if self._tendon_pulls is not None:
            if not self._tendon_pulls.done:
                step, said = self._tendon_pulls.propose(observation), self._tendon_pulls.note
                return Proposal(step, said, self._line)
            self._axes, self._tendon_pulls = self._tendon_pulls.axes, None
            self._walk = WaypointWalk(self._motion, self._axes, self._random)
            if not self._is_loose:
                self._next_line(observation)
        if self._line < 0 and self._is_loose:
            return Proposal(self._pulled(observation), "pulls its tendons", self._line)
        if not self.ready and (self._left_s <= 0.0 or self._line_ends(observation)):
            self._next_line(observation)
        if self.ready:
            return Proposal(np.zeros(self._axes.count))
        self._look_for_walls(observation)
        if self._way is not _Way.OUT:
            return Proposal(self._step_back(observation), self.note, self._line)
        self._trail.append(observation.targets.copy())
        step = self._walk.step(self._goal, observation)
        kept = self._kept_tight(step, observation)
        self._goal = self._goal + (kept - step)  # what bends no body takes nothing from the line
        return Proposal(kept, self.note, self._line)

    def learn(self) -> None:  # noqa: B027
        """Others learn from what it does."""

    def save(self, path: Path) -> None:
        raise ModelError(f"{path} is not written: an exploration has no model, only a recording")

    def load(self, path: Path) -> None:
        raise ModelError(f"{path} is not read: an exploration takes no model")

    def _next_line(self, observation: Observation) -> None:
        self._line += 1
        if self._way is _Way.HOME:
            self._trail.clear()
        self._way = _Way.OUT
        self._start = observation.targets.copy()
        if self._first is None:
            self._first = self._start
        self._goal = self._draw()
        self._left_s = self._longest_s()

    def _longest_s(self) -> float:
        return _GIVEN_UP_S + _GIVEN_UP * self._walk.line_time_s(self._start, self._goal)

    @property
    def _is_loose(self) -> bool:
        keeping = self._tension_keeping
        if keeping is None or self._strung_s > _STRUNG_WITHIN_S:
            return False
        return bool(keeping.slacker_than(_STRUNG if self._strung_s > 0.0 else _LOOSE).any())

    def _pulled(self, observation: Observation) -> Vector:
        """(m,) a step of those tendons that are loose."""
        assert self._tension_keeping is not None
        dt_s = step_time(observation)
        loose = self._tension_keeping.slacker_than(_STRUNG)
        step = dt_s * _STRUNG_SPEED * self._axes.max_velocity * loose
        step = np.clip(step, *self._axes.step_range(observation.targets))
        self._strung_s += dt_s
        self._strung_by += step
        return step

    def _kept_tight(self, step: Vector, observation: Observation) -> Vector:
        """(m,) a step with all tendons pulled together where one of them would get slack."""
        if self._tension_keeping is None:
            return step
        kept = self._tension_keeping.tightened(step)
        return np.clip(kept, *self._axes.step_range(observation.targets))

    def _line_ends(self, observation: Observation) -> bool:
        if self._way is _Way.OUT:
            return self._walk.arrived(self._goal, observation)
        values = self._walls.values(observation)
        inside = len(self._trail) <= 1 or self._walls.well_inside(values, _WELL_INSIDE)
        return inside and not self._leaving(observation)

    def _look_for_walls(self, observation: Observation) -> None:
        near = self._leaving(observation)
        if self._way is _Way.OUT and near:
            self._way, self._back_s = _Way.BACK, 0.0
            self._left_s = self._longest_s()  # as much again, for the way back
        elif self._way is _Way.BACK:
            self._back_s += step_time(observation)
            turned = self._back_s > _TURNED_S + _TURNED_BY_LATENESS * self._lateness.seconds
            # Tensions tell walls by moments, and are not mended by going home: they began there.
            if turned and near and self._leaving(observation, tip_alone=True):
                self._way = _Way.HOME

    def _step_back(self, observation: Observation) -> Vector:
        """(m,) along the way that the axes came, or home."""
        trail, home = self._trail, self._first if self._way is _Way.HOME else None
        if home is not None and self._axes.coupled.way_inside(observation.targets, home):
            return self._walk.step(home, observation, dither=False)
        while len(trail) > 1 and self._walk.arrived(trail[-1], observation):
            trail.pop()
        back = trail[-1] if trail else observation.targets
        return self._walk.step(back, observation, dither=False)

    def _inside_part(self, goal: Vector) -> tuple[Vector, float]:
        """(m,) how far on the line to `goal` all seems to be inside, and which share of it that is.
        Of a line that leads outside from its start on the whole, with how far outside, negative."""
        line = self._start + _ALONG * (goal - self._start)
        beyond = self._walls.beyond(self._guess.at(line))
        outside = np.flatnonzero(beyond > 0.0)
        if not len(outside):
            return goal, 1.0
        if outside[0] == 0:
            return goal, -float(beyond.max())
        last = int(outside[0]) - 1
        return line[last], float(_ALONG[last, 0])

    def _leaving(self, observation: Observation, tip_alone: bool = False) -> bool:
        """Whether the tip or a tendon is about to pass a wall, and not on its way back from it."""
        late_s, keeping = self._lateness.seconds, self._tension_keeping
        ahead_s = max(_AHEAD_S, _AHEAD_BY_LATENESS * late_s)
        ahead = observation._replace(
            tip_mm=observation.tip_mm + ahead_s * observation.tip_velocity_mm_s,
            tensions_n=None if keeping is None else keeping.ahead(_PULLS_AHEAD_S + late_s),
        )
        values = np.array([self._walls.values(one) for one in (observation, ahead)])
        if tip_alone:
            values[:, POSITION:] = np.nan
        beyond, then = self._walls.beyond(values)
        return bool(then > beyond)
