"""What tendons do against each other, before more of them move than an arm has ways to bend.

Two ways to bend and one to be drawn together are all that three straight tendons have. Of six or
eight most motions bend nothing: they stretch some tendons and slacken others within tenths of a
millimetre. Which motions these are depends on the holes, so each tendon is pulled a little, and the
tensions of all tell it: along the eigenvectors of what they change by, stiff ones are strain.
"""

from dataclasses import replace
from typing import Final, Self

import numpy as np

from config.robot import Robot
from daemon.control.controller import Observation
from daemon.control.tip_following import step_time
from daemon.controllers.exploration.tension_loss import TensionLoss
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_FEW: Final = 4
"""Three and a helical one have no other way in which little of a motion strains them much."""
_SPEED: Final = 0.1
"""Of an axis' speed."""
_COUNTS_FROM, _RISES_BY = 0.02, 0.1
"""Of a tendon's range of tensions: by so much it rises in its play, and in all."""
_REACH: Final = 0.03
"""Of its travel, after which a tendon is let go whatever its tension is."""
_RESTS_S: Final = 0.4
"""Until what was told has arrived and is measured."""
_ARRIVED: Final = 0.002
"""Of its travel: no nearer need an axis come, which goes by whole counts of its drive."""
_WITHIN_S: Final = 4.0
"""It goes out, and comes back, or is not let."""
_BENDS: Final = 2
"""Ways in which a body bends: of stiffer motions as much is left as takes the same tension."""
_SOFTEST: Final = 0.02
"""Of the stiffest: what seems softer is friction."""


class TendonPulls:
    """Makes the steps, and then says what motions are left of those that are wanted."""

    def __init__(self, robot: Robot, axes: AxisRanges) -> None:
        self._axes = axes
        self._tendons = list(axes.tendons)
        ranges_n = [axis.tension_range_n for axis in robot.axes if axis.tension_range_n is not None]
        self._range_n = np.array([high - low for low, high in ranges_n])
        self._stiffness: list[Vector] = []
        """N/mm of each tendon, for each that was pulled."""
        self._home: float | None = None
        self._counted: tuple[float, Vector] | None = None
        """Where the axis was, and the tensions, when its play was gone through."""
        self._pulled: Vector | None = None
        """N/mm, by the tendon that is being let go again."""
        self._first_n = np.zeros(len(self._tendons))
        self._tension_loss = TensionLoss()
        self._rests_s = 0.0
        """Until the axis goes on; negative: so long it has gone."""
        self._goes_back = False

    @classmethod
    def of(cls, robot: Robot, axes: AxisRanges) -> Self | None:
        """None: there are so few that nothing has to be known."""
        return cls(robot, axes) if len(axes.tendons) > _FEW else None

    @property
    def done(self) -> bool:
        return len(self._stiffness) == len(self._tendons)

    @property
    def note(self) -> str:
        """What it is doing; empty when it is done."""
        if self.done:
            return ""
        return (
            f"finds how {self._axes.names[self._tendons[len(self._stiffness)]]} strains the others"
        )

    def begin(self) -> None:
        """Motion begins: a pull that was interrupted begins anew."""
        self._home = None

    def propose(self, observation: Observation) -> Vector:
        """(m,) the next step; none where nobody knows the tensions."""
        step = np.zeros(self._axes.count)
        if self.done or observation.tensions_n is None:
            return step
        axis, dt_s = self._tendons[len(self._stiffness)], step_time(observation)
        now_n, at = observation.tensions_n[self._tendons], float(observation.targets[axis])
        if self._home is None:
            self._home, self._goes_back, self._rests_s = at, False, _RESTS_S
            self._counted = self._pulled = None
        self._rests_s -= dt_s
        if self._rests_s > 0.0:
            self._first_n = now_n
            self._tension_loss.begin(now_n)
        elif self._goes_back:
            step[axis] = self._back(now_n, observation, axis)
        else:
            step[axis] = self._out(now_n, observation, axis)
        most = _SPEED * self._axes.max_velocity[axis] * dt_s
        return np.clip(step, -most, most)

    @property
    def axes(self) -> AxisRanges:
        """The same, which know what their tendons do against each other."""
        stiffness = np.array(self._stiffness)
        of_modes, modes = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
        soft = max(float(of_modes[_BENDS - 1]), _SOFTEST * float(of_modes[-1]))
        left = soft / np.maximum(of_modes, soft)
        return replace(self._axes, bending=(modes * left) @ modes.T)

    def _out(self, now_n: Vector, observation: Observation, axis: int) -> float:
        assert self._home is not None
        one = len(self._stiffness)
        risen = float((now_n - self._first_n)[one] / self._range_n[one])
        out = float(observation.targets[axis]) - self._home
        if self._counted is None and risen >= _COUNTS_FROM:
            self._counted = float(observation.u[axis]), now_n
        room = min(self._home + _REACH * self._axes.scale[axis], self._axes.highest[axis])
        left = float(room - self._home - out)
        slackens = self._tension_loss.grave(now_n, step_time(observation))
        goes_on = risen < _RISES_BY and not slackens and self._rests_s > -_WITHIN_S
        if goes_on and left > self._near(axis):
            return left
        self._goes_back, self._rests_s = True, _RESTS_S
        return 0.0

    def _back(self, now_n: Vector, observation: Observation, axis: int) -> float:
        assert self._home is not None
        if self._counted is None:
            self._counted = self._home, self._first_n
        if self._pulled is None:
            went = max(float(observation.u[axis]) - self._counted[0], self._near(axis))
            self._pulled = (now_n - self._counted[1]) / went
        back = self._home - float(observation.targets[axis])
        if abs(back) <= self._near(axis) or self._rests_s < -_WITHIN_S:
            self._stiffness.append(self._pulled)
            self._home = self._pulled = self._counted = None
            return 0.0
        return back

    def _near(self, axis: int) -> float:
        return float(_ARRIVED * self._axes.scale[axis])
