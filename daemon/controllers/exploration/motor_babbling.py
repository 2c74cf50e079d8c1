"""Motor babbling: small random motions round where the axes are, to learn a first model from.

A learning controller uses it as long as it knows nothing, and takes samples of it as of any other
motion.
"""

from typing import Final

import numpy as np

from config.tasks.exploration import MotorBabbling
from daemon.control.controller import Observation
from daemon.control.tip_following import step_time
from daemon.controllers.exploration.random_motion import WaypointWalk
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_DRAWN_AT_MOST: Final = 60
"""Until one is inside coupled limits: of a box round a corner of five of them one in 32 is."""


class Babbling:
    """Proposes the steps until it has lasted as long as it should, pauses not counted."""

    def __init__(
        self, options: MotorBabbling, axes: AxisRanges, seed: int, home: Vector | None = None
    ) -> None:
        """home: (m,) where the axes go first, and then round it; None: where they are."""
        self._options = options
        self._axes = axes
        self._random = np.random.default_rng(seed)
        self._walk = WaypointWalk(options, axes, self._random)
        self.home = home
        """(m,) round which they go; None: motion has not begun."""
        self._goal = np.zeros(axes.count) if home is None else home
        self._elapsed_s = 0.0
        self._frames = 0

    @property
    def done(self) -> bool:
        return self._elapsed_s >= self._options.duration_s

    @property
    def share_done(self) -> float:
        """Of the time that it lasts."""
        return self._elapsed_s / self._options.duration_s

    @property
    def frames(self) -> int:
        """For which a step was proposed."""
        return self._frames

    @property
    def note(self) -> str:
        """What it is doing; empty when it is done."""
        if self.done:
            return ""
        return f"tries small motions: {self._elapsed_s:.0f} of {self._options.duration_s:.0f} s"

    def reset(self) -> None:
        """Motion begins again, perhaps from elsewhere."""
        self._walk.reset()
        self.home = None

    def propose(self, observation: Observation) -> Vector:
        """(m,) the next step; none when it is done."""
        if self.done:
            return np.zeros(self._axes.count)
        self._elapsed_s += step_time(observation)
        self._frames += 1
        if self.home is None:
            self.home = observation.targets.copy()
            self._goal = self._draw(self.home)
        elif self._walk.arrived(self._goal, observation):
            self._goal = self._draw(self.home)
        return self._walk.step(self._goal, observation)

    def _draw(self, home: Vector) -> Vector:
        """(m,) near home. Where there is no room on one side, the other has all of it."""
        axes = self._axes
        reach = self._options.reach_share * axes.scale
        lowest = np.clip(home - reach, axes.lowest, axes.highest - 2.0 * reach)
        for _ in range(_DRAWN_AT_MOST):
            goal = lowest + 2.0 * reach * self._random.uniform(0.0, 1.0, axes.count)
            if axes.tendons:
                goal = home + axes.bent_as_far(goal - home, self._options.together_share)
            if axes.coupled.way_inside(home, goal):
                return np.asarray(goal)
        return home
