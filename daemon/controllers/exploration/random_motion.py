"""Random motions as learning needs them: straight towards a place, with a dither on top.

The dither is a swing of every axis with a period of its own, so that steps point in ever new
directions. It is slow, because the body follows its axes late.
"""

import numpy as np

from config.tasks.exploration import RandomMotion
from daemon.control.controller import Observation
from daemon.control.tip_following import step_time
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

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
