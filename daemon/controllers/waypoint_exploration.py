"""Goes to random places of the axes, for others to learn from it: Ho 2018, section 3.2.

Places are drawn evenly from the axes' travel. Many of them may bring the tip out of its workspace:
a place that, by what was seen so far, does so is drawn again. Where the tip comes near a wall all
the same, the axes go back the way they came, until it is well inside, and from there on to another
place. So they do where something stands in the way and a line comes to no end. What the walls of
the workspace are to the tip, the tensions at which it goes slack or tears are to a tendon.
"""

from abc import ABC, abstractmethod
from collections import deque
from pathlib import Path

import numpy as np

from config.control import Workspace
from config.robot import Robot
from config.tasks.exploration import Exploration, RandomMotion, WaypointExploration
from daemon.array_files import ModelError
from daemon.control.controller import Observation, Proposal
from daemon.control.tip_following import step_time
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

# A rough idea of what the body does for which axes, from what was seen: it keeps waypoints inside.
#
# A quadratic in all axes, by least squares. It is no model to control with.


_RIDGE = 1e-3
"""Of the mean square of a feature that is 1."""


class QuadraticGuess:
    """Takes axes and k values that belong together; guesses once it has seen some of them."""

    def __init__(self, axes: AxisRanges, values: int) -> None:
        self._middle = 0.5 * (axes.lowest + axes.highest)
        self._half = 0.5 * axes.travel
        self._upper = np.triu_indices(axes.count)
        features = 1 + axes.count + len(self._upper[0])
        self._squares = np.zeros((features, features))
        self._products = np.zeros((features, values))
        self._seen = 0
        self._solution: Vector | None = None

    def add(self, u: Vector, values: Vector) -> None:
        """Take (m,) axes and (k,) values that belong together."""
        features = self._features(u[None, :])[0]
        self._squares += np.outer(features, features)
        self._products += np.outer(features, values)
        self._seen += 1
        self._solution = None

    def at(self, u: Vector) -> Vector:
        """(n, k) values for (n, m) axes; NaN while nothing was seen."""
        if not self._seen:
            return np.full((len(u), self._products.shape[1]), np.nan)
        if self._solution is None:
            ridge = _RIDGE * self._seen * np.eye(len(self._squares))
            ridge[0, 0] = 0.0
            self._solution = np.asarray(np.linalg.solve(self._squares + ridge, self._products))
        return np.asarray(self._features(u) @ self._solution)

    def _features(self, u: Vector) -> Vector:
        x = (u - self._middle) / self._half
        first, second = self._upper
        return np.hstack([np.ones((len(x), 1)), x, x[:, first] * x[:, second]])


# Random motions as learning needs them: straight towards a place, with a dither on top.
#
# The dither is a swing of every axis with a period of its own, so that steps point in ever new
# directions. It is slow, because the body follows its axes late.


_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
_SMOOTH_S = 0.2
"""Time constant of the velocity. An axis that turned round at once would only be braked."""
_SWING_AT_MOST = 0.75
"""Of the speed: a line must come forward whatever the dither does."""
_ARRIVED_S = 0.15
"""What is no further away than this is reached: the next line begins in a curve."""


class WaypointWalk:
    """Makes the steps. Whoever uses it says where to."""

    def __init__(
        self, options: RandomMotion, axes: AxisRanges, random: np.random.Generator
    ) -> None:
        self._axes = axes
        self._together = options.together_share
        shares = (_GOLDEN * np.arange(axes.count)) % 1.0
        self._rates = 2.0 * np.pi / (options.dither_period_s * (1.0 + shares))
        self._phases = random.uniform(0.0, 2.0 * np.pi, axes.count)
        highest = options.speed_share * axes.max_velocity
        swing = options.dither_share * axes.travel * self._rates
        self._swing = np.minimum(swing, _SWING_AT_MOST * highest)
        self._line_speed = highest
        self._elapsed_s = 0.0
        self._velocity = np.zeros(axes.count)

    def reset(self) -> None:
        """The axes stand still."""
        self._velocity = np.zeros(self._axes.count)

    def line_time_s(self, start: Vector, end: Vector) -> float:
        """How long it takes from one place of the axes to another."""
        return float(np.max(np.abs(end - start) / self._line_speed))

    def arrived(self, goal: Vector, observation: Observation) -> bool:
        """Whether the axes are told to be at the goal, or nearly."""
        return self.line_time_s(observation.targets, goal) <= _ARRIVED_S

    def step(self, goal: Vector, observation: Observation, *, dither: bool = True) -> Vector:
        """(m,) the next step towards (m,) `goal`, within the travel."""
        dt_s, axes = step_time(observation), self._axes
        self._elapsed_s += dt_s
        time_s = max(self.line_time_s(observation.targets, goal), _ARRIVED_S)
        wanted = (goal - observation.targets) / time_s
        if dither:
            swing = self._swing * np.cos(self._rates * self._elapsed_s + self._phases)
            wanted += self._axes.less_together(swing, self._together)
        self._velocity += min(dt_s / _SMOOTH_S, 1.0) * (wanted - self._velocity)
        step = np.clip(self._velocity * dt_s, *axes.step_range(observation.targets))
        return axes.slowed(step, dt_s)


# What the body shall stay between: the tip in its workspace, each tendon neither slack nor torn.


_INSIDE_AT_LEAST = 0.5
"""Of the workspace that is left between its walls, however thick they are said to be."""
_TENSION_SPARED = 0.05
"""Of a tendon's range of tensions, at either end. It has to do for friction, which lets a tension
rise or fall at once where a tendon turns round."""


class Walls:
    """The tip's place, if there is a workspace, and then the tensions of what tendons there are."""

    def __init__(self, robot: Robot, wall_mm: float) -> None:
        tensions_n = [axis.tension_range_n for axis in robot.axes]
        self._tendons = [i for i, one in enumerate(tensions_n) if one is not None]
        self._has_box = robot.workspace is not None
        pairs = [] if robot.workspace is None else _box(robot.workspace, wall_mm)
        for low, high in filter(None, tensions_n):
            spared = _TENSION_SPARED * (high - low)
            pairs.append((low + spared, high - spared))
        self._lowest, self._highest = np.array(pairs).reshape(-1, 2).T
        self.count = len(pairs)

    def values(self, observation: Observation) -> Vector:
        """(k,) mm and N: what stands between the walls at this step."""
        tip = observation.tip_mm if self._has_box else np.empty(0)
        pulls = observation.tensions_n
        if pulls is None:
            return np.concatenate([tip, np.full(len(self._tendons), np.nan)])
        return np.concatenate([tip, pulls[self._tendons]])

    def beyond(self, values: Vector) -> Vector:
        """(n,) how far the worst of each of (n, k) values is outside, as a share of what is between
        its walls; 0 inside, and where it is not known."""
        outside = np.maximum(self._lowest - values, values - self._highest)
        shares = outside / (self._highest - self._lowest)
        return np.asarray(np.nan_to_num(shares, nan=0.0).max(axis=1, initial=0.0))

    def well_inside(self, values: Vector, share: float) -> bool:
        """Whether the tip is by so much of the workspace's width away from its walls, and no
        tendon beyond its own."""
        if self.beyond(values[None, :])[0] > 0.0:
            return False
        tip = slice(0, 3 if self._has_box else 0)
        low, high, at = self._lowest[tip], self._highest[tip], values[tip]
        return bool((np.minimum(at - low, high - at) > share * (high - low)).all())


def _box(workspace: Workspace, wall_mm: float) -> list[tuple[float, float]]:
    """Lowest and highest x, y and z where the tip may be."""
    pairs = []
    for low, high in (workspace.x_mm, workspace.y_mm, workspace.z_mm):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        inside = max(half - wall_mm, _INSIDE_AT_LEAST * half)
        pairs.append((middle - inside, middle + inside))
    return pairs


DRAWN_AT_MOST = 60
_ALONG = np.linspace(0.25, 1.0, 4)[:, None]
"""Where a line is looked at before it is gone along."""
_AHEAD_S = 0.4
"""The tip goes on for so long, at most, after the axes were told to turn back."""
_PULLS_AHEAD_S = 0.2
"""A tension does: as long as the axes need to turn round."""
_RATE_S = 0.1
"""Time constant of how fast a tension changes: what is measured is a motor's torque, with noise."""
_TRAIL_STEPS = 2000
_GIVEN_UP = 3.0
_GIVEN_UP_S = 2.0
"""A line that takes so many times what it takes at full speed, and so much more, is given up."""
_WELL_INSIDE = 0.1
"""Of the workspace's width, from its walls."""


class ExplorationController(ABC):
    """A `Controller` that follows nothing, goes along one line after another, and turns back where
    a wall is near. The kinds differ in where lines lead to, and in how many there are."""

    name: str

    def __init__(self, options: Exploration, robot: Robot, seed: int) -> None:
        self._axes = AxisRanges.of(robot)
        self._random = np.random.default_rng(seed)
        self._walk = WaypointWalk(options, self._axes, self._random)
        self._walls = Walls(robot, options.wall_mm)
        self._guess = QuadraticGuess(self._axes, self._walls.count)
        self._tensions_n: Vector | None = None
        self._tension_rates = np.zeros(0)
        self._line = -1
        self._start = self._goal = np.zeros(self._axes.count)
        self._trail: deque[Vector] = deque(maxlen=_TRAIL_STEPS)
        self._turning_back = False
        self._left_s = 0.0
        """Until the line is given up."""

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
        self._walk.reset()
        self._tensions_n = None
        if self._line < 0:
            self._next_line(observation)

    def observe(self, observation: Observation) -> None:
        values = self._walls.values(observation)
        finite = np.isfinite(observation.u).all() and np.isfinite(values).all()
        if observation.believed and finite:
            self._guess.add(observation.u, values)

    def propose(self, observation: Observation) -> Proposal:
        self._left_s -= step_time(observation)
        self._follow_tensions(observation)
        if not self.ready and (self._left_s <= 0.0 or self._line_ends(observation)):
            self._next_line(observation)
        if self.ready:
            return Proposal(np.zeros(self._axes.count))
        if not self._turning_back and self._leaving(observation):
            self._turning_back = True
            self._left_s = self._longest_s()  # as much again, for the way back
        if self._turning_back:
            return Proposal(self._step_back(observation), self.note, self._line)
        self._trail.append(observation.targets.copy())
        return Proposal(self._walk.step(self._goal, observation), self.note, self._line)

    def learn(self) -> None:  # noqa: B027
        """Others learn from what it does."""

    def save(self, path: Path) -> None:
        raise ModelError(f"{path} is not written: an exploration has no model, only a recording")

    def load(self, path: Path) -> None:
        raise ModelError(f"{path} is not read: an exploration takes no model")

    def _next_line(self, observation: Observation) -> None:
        self._line += 1
        self._turning_back = False
        self._start = observation.targets.copy()
        self._goal = self._draw()
        self._left_s = self._longest_s()

    def _longest_s(self) -> float:
        return _GIVEN_UP_S + _GIVEN_UP * self._walk.line_time_s(self._start, self._goal)

    def _line_ends(self, observation: Observation) -> bool:
        if not self._turning_back:
            return self._walk.arrived(self._goal, observation)
        values = self._walls.values(observation)
        inside = len(self._trail) <= 1 or self._walls.well_inside(values, _WELL_INSIDE)
        return inside and not self._leaving(observation)

    def _step_back(self, observation: Observation) -> Vector:
        """(m,) along the way that the axes came."""
        trail = self._trail
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

    def _follow_tensions(self, observation: Observation) -> None:
        """Keep how fast the tendons' tensions change."""
        pulls, last = observation.tensions_n, self._tensions_n
        self._tensions_n = pulls
        if pulls is None:
            return
        if last is None:
            self._tension_rates = np.zeros(len(pulls))
            return
        dt_s = step_time(observation)
        newest = np.nan_to_num((pulls - last) / dt_s)  # of what is not known at the moment: none
        self._tension_rates += min(dt_s / _RATE_S, 1.0) * (newest - self._tension_rates)

    def _leaving(self, observation: Observation) -> bool:
        """Whether the tip or a tendon is about to pass a wall, and not on its way back from it."""
        pulls = observation.tensions_n
        ahead = observation._replace(
            tip_mm=observation.tip_mm + _AHEAD_S * observation.tip_velocity_mm_s,
            tensions_n=None if pulls is None else pulls + _PULLS_AHEAD_S * self._tension_rates,
        )
        beyond, then = self._walls.beyond(
            np.array([self._walls.values(one) for one in (observation, ahead)])
        )
        return bool(then > beyond)


class WaypointExplorationController(ExplorationController):
    """Is ready when it has been everywhere."""

    name = "waypoint_exploration"

    def __init__(self, options: WaypointExploration, robot: Robot, seed: int) -> None:
        super().__init__(options, robot, seed)
        self._options = options

    @property
    def ready(self) -> bool:
        return self._line >= self._options.waypoints

    @property
    def note(self) -> str:
        """What it is doing; empty when it is done."""
        return "" if self.ready else f"line {self._line + 1} of {self._options.waypoints}"

    def _draw(self) -> Vector:
        """(m,) a waypoint: the first that seems to be inside with all of the way there. If there
        is none: as far on one of the ways as it is inside, or the end of what is least outside."""
        axes = self._axes
        middle = 0.5 * (axes.lowest + axes.highest)
        half = 0.5 * self._options.travel_share * axes.travel
        best, longest = middle, -np.inf
        if not axes.coupled.way_inside(self._start, middle):
            best = self._start
        for _ in range(DRAWN_AT_MOST):
            away = half * self._random.uniform(-1.0, 1.0, axes.count)
            goal = middle + axes.less_together(away, self._options.together_share)
            if not axes.coupled.way_inside(self._start, goal):
                continue
            end, inside = self._inside_part(goal)
            if inside > longest:
                best, longest = end, inside
            if longest >= 1.0:
                break
        return best
