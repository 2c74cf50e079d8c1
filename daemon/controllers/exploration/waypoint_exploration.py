"""Goes to random places of the axes, for others to learn from it: Ho 2018, section 3.2.

Places are drawn evenly from the axes' travel. One that, by what was seen so far, brings the tip out
of its workspace is drawn again. Now and then a line leads home, to where the first began: that is
often a corner of the travel, which no line would come near again, and whoever goes by the model
begins there.
"""

import numpy as np

from config.robot import Robot
from config.tasks.exploration import WaypointExploration
from daemon.controllers.exploration.exploration_controller import (
    DRAWN_AT_MOST,
    ExplorationController,
)
from drivers.pose import Vector


class WaypointExplorationController(ExplorationController):
    """Is ready when it has been everywhere."""

    name = "waypoint_exploration"

    def __init__(self, options: WaypointExploration, robot: Robot, seed: int) -> None:
        super().__init__(options, robot, seed)
        self._options = options
        self._home: Vector | None = None

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
        if self._home is None:
            self._home = self._start
        elif self._leads_home(self._home):
            return self._home
        middle = 0.5 * (axes.lowest + axes.highest) + self._strung_by
        half = 0.5 * self._options.travel_share * axes.travel
        best, longest = middle, -np.inf
        if not axes.coupled.way_inside(self._start, middle):
            best = self._start
        for _ in range(DRAWN_AT_MOST):
            away = half * self._random.uniform(-1.0, 1.0, axes.count)
            goal = middle + axes.bent_as_far(away, self._options.together_share)
            if not axes.coupled.way_inside(self._start, goal):
                continue
            end, inside = self._inside_part(goal)
            if inside > longest:
                best, longest = end, inside
            if longest >= 1.0:
                break
        return best

    def _leads_home(self, home: Vector) -> bool:
        every = self._options.home_every
        due = every > 0 and self._line % every == 0
        return due and self._axes.coupled.way_inside(self._start, home)
