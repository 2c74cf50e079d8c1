"""The posture that redundant axes are drawn to, and how much of the way each step asks for."""

import numpy as np

from config.tasks.controllers import TipFollowing
from daemon.control.controller import Observation
from daemon.control.redundancy import Redundancy
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_FURTHER, _FURTHER_PER_S = 4.0, 0.4
"""Times the posture's gain, and per second at most, to draw the axes of a body with that is led. On
a repeated path their way is soon the same in every cycle, and what one teaches holds for the next:
a slow body's rectangle settles at 1.1 mm without, at 0.84 with twice as much, at 0.75 with four
times. On the way to a path an arm that rests with its axes at their ends comes to its posture
before it is there: else those that stay behind bend it into an S, along which its model is wrong.
Of thirty arms with lags of 0.35 to 1 s one never came to its path without, and one was held on it
again and again."""


class Posture:
    """Of one robot's m axes, in their own units."""

    def __init__(self, options: TipFollowing, redundancy: Redundancy, axes: AxisRanges) -> None:
        self._lowest, self._highest = axes.lowest, axes.highest
        self._at = redundancy.posture
        self._gain_per_s = redundancy.posture_gain_per_s
        self._begins_here = options.posture == "start"
        self._rotations = axes.period > 0.0
        self.turns = bool(self._rotations.any())
        """Whether axes turn round: then far ways come of little, the body can snap on them, and the
        middle of their travel is no better than another place."""
        self._further_per_s = self._drawn_further_per_s(options.leads)
        self._turned_together: float | None = None
        """The mean of axes that come round, as a path began; None: it has not."""

    @property
    def at(self) -> Vector:
        """(m,) that the axes are drawn to."""
        return self._at.copy()

    def set(self, posture: Vector) -> None:
        """Draw to (m,) another one, as far as the axes go. Raises ValueError for no numbers."""
        if np.shape(posture) != self._lowest.shape or not np.isfinite(posture).all():
            raise ValueError(f"a posture is {len(self._lowest)} finite numbers, not {posture}")
        self._at = np.clip(posture, self._lowest, self._highest)

    def begin(self, targets: Vector) -> None:
        """Motion begins with the axes told to be at (m,): the posture may be the one of this
        moment."""
        self._turned_together = None
        if self._begins_here:
            self._at = np.clip(targets, self._lowest, self._highest)

    def drawn(self, observation: Observation, dt_s: float, times: float) -> Vector:
        """(m,) change of the targets that the posture asks for in `dt_s`, with so many times its
        gain."""
        share = min(times * self._gain_per_s * dt_s, 1.0)
        return np.asarray(share * self._way(observation))

    def drawn_further(self, observation: Observation, dt_s: float) -> Vector:
        """(m,) that the posture asks for besides, of a body that is led."""
        share = min(self._further_per_s * dt_s, 1.0)
        return np.asarray(share * self._way(observation))

    def shaped_as(self, u: Vector) -> Vector:
        """(m,) from (m,) axes to where the body has the posture's shape. How tubes are turned all
        together is none of it: to draw that to a place, too, would turn them against each other
        where a tip is on the other side, and a body that is folded back reaches less far."""
        way = self._at - u
        if self.turns:
            way[self._rotations] -= way[self._rotations].mean()
        return way

    def _way(self, observation: Observation) -> Vector:
        """(m,) from where the axes are told to be to the posture, on a path with all tubes turned
        together as they were when it began: so they come back to what was learnt of them."""
        targets = observation.targets
        way = self.shaped_as(targets)
        if self.turns:
            together = float(targets[self._rotations].mean())
            if not observation.on_path:
                self._turned_together = None
            elif self._turned_together is None:
                self._turned_together = together
            else:
                way[self._rotations] += self._turned_together - together
        return way

    def _drawn_further_per_s(self, leads: bool) -> float:
        if self.turns or not leads:
            return 0.0
        return max(min(_FURTHER * self._gain_per_s, _FURTHER_PER_S) - self._gain_per_s, 0.0)
