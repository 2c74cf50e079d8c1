"""Goes where most is learnt on the way: an exploration of seconds, as optimal experiments have it.

What shall be learnt is how the tip goes as a quadratic of the axes: a Jacobian, and how that
changes from place to place. What a line tells of its coefficients is known before it is gone along:
it is a matter of places and directions alone. So of many places around, the line is taken whose
information grows the determinant of all that was gathered fastest, per second (D-optimality;
Fedorov, Theory of Optimal Experiments, 1972). Such lines move all axes, each at its speed, and in
directions that are ever new.

Places come from around where the axes were in the beginning, and then, moving on and growing, from
the middle of their travel: a controller that begins from there again has to know that, too. What an
exploration keeps away from, it keeps away from as ever.
"""

import numpy as np

from config.robot import Robot
from config.tasks.exploration import DesignedExploration
from daemon.control.controller import Observation, Proposal
from daemon.control.tip_following import step_time
from daemon.controllers.exploration.exploration_controller import (
    DRAWN_AT_MOST,
    ExplorationController,
)
from drivers.pose import Vector

# What is known of the coefficients of a quadratic, from the motions that were made.
#
# Of axes x, in shares of half the travel, a motion d at x changes the tip by c · φ(x, d), with φ
# the differences of all xᵢ and xᵢxⱼ: dᵢ, and dᵢxⱼ + xᵢdⱼ. Motions seen for a second, with noise
# that is the same for all, give the information ∫ φφᵀ dt.


_AT = np.linspace(0.1, 0.9, 4)
"""Where a line is looked at, as shares of it."""
_AT_FIRST = 1e-3
"""Information on each coefficient before anything is seen: as if it were nearly unknown."""


class GatheredInformation:
    """On the coefficients of a quadratic of m axes."""

    def __init__(self, axes: int) -> None:
        self._upper = np.triu_indices(axes)
        features = axes + len(self._upper[0])
        self._matrix = _AT_FIRST * np.eye(features)
        self._inverse: Vector = np.eye(features) / _AT_FIRST

    def add(self, start: Vector, end: Vector, time_s: float) -> None:
        """A straight line from (m,) to (m,) was gone along. Shares of half the travel."""
        rows = self._rows(start, end[None], np.array([time_s]))[0]
        self._matrix += rows.T @ rows
        self._inverse = np.asarray(np.linalg.inv(self._matrix), np.float64)

    def gain(self, start: Vector, ends: Vector, times_s: Vector) -> Vector:
        """(n,) by how much lines from (m,) to (n, m) that take (n,) seconds would raise the
        logarithm of the determinant."""
        rows = self._rows(start, ends, times_s)
        told = rows @ self._inverse @ rows.transpose(0, 2, 1)
        return np.asarray(np.linalg.slogdet(np.eye(len(_AT)) + told)[1])

    def _rows(self, start: Vector, ends: Vector, times_s: Vector) -> Vector:
        """(n, places, features) whose products sum up to the lines' information."""
        speed = (ends - start) / np.maximum(times_s, 1e-9)[:, None]
        at = start + _AT[:, None] * (ends - start)[:, None, :]
        first, second = self._upper
        d = np.broadcast_to(speed[:, None, :], at.shape)
        products = d[..., first] * at[..., second] + at[..., first] * d[..., second]
        weights = np.sqrt(times_s / len(_AT))
        rows = np.concatenate([d, products], axis=2)
        return np.asarray(rows * weights[:, None, None])


_LONGEST_S = 1.8
"""Of a line, at full speed: what a body that answers late makes of it is seen before its end."""
_SHORTEST = 0.5
"""... and the shortest, as a share of that."""
_COUNTED = 0.25
"""... and the least that one is counted as: what is hardly a line would tell most per second."""
_BEGINS_WITH = 0.5
"""Of the share of the travel that places are from in the end."""
_GROWN_AFTER = 0.5
"""Of the exploration, all of the share is used."""


class DesignedExplorationController(ExplorationController):
    """Is ready when its time is over."""

    name = "designed_exploration"

    def __init__(self, options: DesignedExploration, robot: Robot, seed: int) -> None:
        super().__init__(options, robot, seed)
        self._options = options
        self._lasts_s = options.lasts_s(self._axes.count)
        self._middle = 0.5 * (self._axes.lowest + self._axes.highest)
        self._half = 0.5 * self._axes.travel
        self._information = GatheredInformation(self._axes.count)
        self._elapsed_s = self._begun_s = 0.0
        self._home = self._middle
        """Where the axes were in the beginning."""

    @property
    def ready(self) -> bool:
        return self._elapsed_s >= self._lasts_s

    @property
    def note(self) -> str:
        """What it is doing; empty when it is done."""
        if self.ready:
            return ""
        return f"tries motions: {self._elapsed_s:.0f} of {self._lasts_s:.0f} s"

    def reset(self, observation: Observation) -> None:
        turns = bool((self._axes.period > 0.0).any())  # tubes may be drawn back first
        if self._line < 0 and not turns:
            self._walls.come_near(observation.tip_mm)
        super().reset(observation)

    def propose(self, observation: Observation) -> Proposal:
        if self._tendon_pulls is None:  # which show nothing of how the body bends
            self._elapsed_s += step_time(observation)
        return super().propose(observation)

    def _next_line(self, observation: Observation) -> None:
        if self._line >= 0:
            gone_s = self._elapsed_s - self._begun_s
            end = self._shares(observation.targets)
            self._information.add(self._shares(self._start), end, gone_s)
        else:
            self._home = observation.targets.copy()
        self._begun_s = self._elapsed_s
        super()._next_line(observation)

    def _draw(self) -> Vector:
        """(m,) of the places that seem to be inside with all of the way there the one that tells
        most; if there is none, as far towards the first as it is inside."""
        places = self._candidates()
        if not len(places):
            return self._start.copy()
        times_s = np.array([self._walk.line_time_s(self._start, place) for place in places])
        times_s = np.maximum(times_s, _COUNTED * _LONGEST_S)
        told = self._information.gain(self._shares(self._start), self._shares(places), times_s)
        best: Vector = places[0]
        longest = -np.inf
        for place in places[np.argsort(-told / times_s, kind="stable")]:
            end, inside = self._inside_part(place)
            if inside > longest:
                best, longest = end, inside
            if longest >= 1.0:
                break
        return best

    def _candidates(self) -> Vector:
        """(n, m) places around that the axes may go to, within what is explored by now."""
        axes, options = self._axes, self._options
        grown = min(self._elapsed_s / (_GROWN_AFTER * self._lasts_s), 1.0)
        share = options.travel_share * (_BEGINS_WITH + (1.0 - _BEGINS_WITH) * grown)
        around = self._home + grown * (self._middle + self._strung_by - self._home)
        reach = self._half * share
        farthest = options.speed_share * axes.max_velocity * _LONGEST_S
        signs = self._random.choice([-1.0, 1.0], (DRAWN_AT_MOST, axes.count))
        far = self._random.uniform(_SHORTEST, 1.0, (DRAWN_AT_MOST, 1))
        lowest = np.maximum(around - reach, axes.lowest)
        highest = np.minimum(around + reach, axes.highest)
        places = np.clip(self._start + far * signs * farthest, lowest, highest)
        away = [axes.bent_as_far(one - around, options.together_share) for one in places]
        goals = around + np.array(away)
        kept = [goal for goal in goals if axes.coupled.way_inside(self._start, goal)]
        return np.asarray(kept, np.float64).reshape(-1, axes.count)

    def _shares(self, u: Vector) -> Vector:
        """(..., m) axes from the middle of their travel on, in halves of it."""
        return np.asarray((u - self._middle) / self._half)
