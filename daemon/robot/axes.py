"""What a controller knows of the axes: how far and how fast they go."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from config.robot import Robot
from daemon.robot.coupled_axes import CoupledAxes
from drivers.pose import Vector

_AMPLIFIED: Final = 3.0
"""A motion that bends, at most: what strains is amplified with it."""


@dataclass(frozen=True)
class AxisRanges:
    """Limits of all axes, each (m,) in mm or rad and per second; and when they come round."""

    names: tuple[str, ...]
    lowest: Vector
    highest: Vector
    max_velocity: Vector
    scale: Vector
    """How far what an axis does to the tip is about the same: its range, in shares of which axes of
    different kinds are compared."""
    period: Vector
    """After how much the body is where it was; 0: never."""
    coupled: CoupledAxes = field(default_factory=CoupledAxes)
    """Where they may be together."""
    units: tuple[str, ...] = ()
    """mm or rad."""
    tendons: tuple[int, ...] = ()
    """Which axes pull at the body, and against each other."""
    bending: Vector | None = None
    """(t, t) what is left of a motion of so many tendons, of which most ways to move strain them.
    None: only the one in which all go together is known to."""

    @classmethod
    def of(cls, robot: Robot) -> "AxisRanges":
        limits = [
            (*axis.travel, axis.max_velocity, axis.linear_range, axis.period or 0.0)
            for axis in robot.axes
        ]
        columns = (np.array(column, np.float64) for column in zip(*limits, strict=True))
        names = tuple(axis.name for axis in robot.axes)
        lowest, highest, max_velocity, scale, period = columns
        units = tuple(axis.unit for axis in robot.axes)
        coupled = CoupledAxes.of(robot)
        tendons = tuple(i for i, axis in enumerate(robot.axes) if axis.tension_range_n is not None)
        return cls(names, lowest, highest, max_velocity, scale, period, coupled, units, tendons)

    @property
    def count(self) -> int:
        return len(self.names)

    @property
    def travel(self) -> Vector:
        """(m,) from lowest to highest."""
        return self.highest - self.lowest

    @property
    def one_round(self) -> tuple[Vector, Vector]:
        """(m,) lowest and highest, but of an axis that comes round no more than one period, in the
        middle of its travel: beyond that the body does nothing that it has not done there."""
        comes_round = (self.period > 0.0) & (self.travel > self.period)
        middle, half = 0.5 * (self.lowest + self.highest), 0.5 * self.period
        return (
            np.where(comes_round, middle - half, self.lowest),
            np.where(comes_round, middle + half, self.highest),
        )

    def step_range(self, targets: Vector) -> tuple[Vector, Vector]:
        """(m,) lowest and highest step within the travel; an axis outside may only come back."""
        return np.minimum(self.lowest - targets, 0.0), np.maximum(self.highest - targets, 0.0)

    @property
    def opposed(self) -> bool:
        """Whether there are tendons that pull against each other."""
        return len(self.tendons) > 1

    def less_together(self, motion: Vector, share: float) -> Vector:
        """(m,) the motion with no more than `share` of what all tendons do together in it: that
        bends no body, but slackens or tears it."""
        if not self.opposed:
            return motion
        pulling = list(self.tendons)
        parted = motion.copy()
        if self.bending is not None:
            parted[pulling] = self.bending @ motion[pulling]
        parted[pulling] -= (1.0 - share) * parted[pulling].mean()
        return parted

    def bent_as_far(self, motion: Vector, share: float) -> Vector:
        """(m,) as `less_together`, but of many tendons, of which little is left of a random motion,
        the farthest goes as far as before, and no more than some times as far as is left."""
        parted = self.less_together(motion, share)
        if self.bending is None:
            return parted
        pulling = list(self.tendons)
        before, after = (float(np.abs(one[pulling]).max()) for one in (motion, parted))
        parted[pulling] *= min(before / max(after, 1e-12), _AMPLIFIED)
        return parted

    def unstrained(self, jacobian: Vector) -> Vector:
        """(r, m) what motions do that strain tendons no more than need be: whoever inverts it asks
        for no others."""
        if self.bending is None:
            return jacobian
        pulling = list(self.tendons)
        freed = jacobian.copy()
        freed[:, pulling] = jacobian[:, pulling] @ self.bending
        return freed

    def slowed(self, step: Vector, dt_s: float) -> Vector:
        """The step, as a whole shortened until no axis is faster than it may be."""
        fastest = float(np.max(np.abs(step) / self.max_velocity))
        return np.asarray((1.0 if fastest <= dt_s else dt_s / fastest) * step)
