"""How redundant axes are resolved: which are dear, where they are drawn, what is not asked of them.

Where options leave it open the robot decides. Tendons pull against each other: what only all of
them together would do for the tip takes tension, or leaves one of them slack, so it is given up
sooner than with other axes, and tendons are drawn to their posture faster.
"""

from typing import Final

import numpy as np

from config.tasks.controllers import TipFollowing
from daemon.control.controller import ControllerError
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_DAMPING_MM: Final = 8.0
_TENDONS_DAMPING: Final = 0.5
"""Of how far all axes move the tip, the root of the sum of squares. Of an arm with three straight
tendons and a helical one that is between 290, 270 and 14 mm: what bends it, and what lengthens it.
"""
_POSTURE_PER_S: Final = 0.1
_TENDONS_POSTURE_PER_S: Final = 1.0


class Redundancy:
    """What one controller's options come to for one robot's axes."""

    def __init__(self, options: TipFollowing, axes: AxisRanges) -> None:
        """Raises ControllerError where the options do not fit the axes."""
        self._options = options
        self._axes = axes
        self.unit = axes.scale / np.sqrt(self._weights())
        """(m,) how far each axis goes for the price of 1."""
        self.posture = self._posture()
        """(m,) that the axes are drawn to."""
        self.posture_gain_per_s = self._posture_gain_per_s()
        """Share of the way there per second."""

    def damping_mm(self, jacobian: Vector) -> float:
        """Directions in which the tip moves less than this while an axis goes through its range are
        given up gently. jacobian: (3 or 6, m), whose first rows are mm per mm or rad."""
        stated = self._options.damping_mm
        if stated is not None:
            return stated
        if not self._axes.opposed:
            return _DAMPING_MM
        size_mm = float(np.linalg.norm(jacobian[:3] * self.unit))
        return max(_TENDONS_DAMPING * size_mm, _DAMPING_MM)

    def _posture_gain_per_s(self) -> float:
        stated = self._options.posture_gain_per_s
        if stated is not None:
            return stated
        return _TENDONS_POSTURE_PER_S if self._axes.opposed else _POSTURE_PER_S

    def _weights(self) -> Vector:
        weights, axes = self._options.axis_weights, self._axes
        if weights is None:
            return np.ones(axes.count)
        if len(weights) != axes.count:
            raise ControllerError(
                f"axis_weights are {len(weights)}, and the robot has {axes.count} axes"
            )
        return np.asarray(np.array(weights) / np.mean(weights))

    def _posture(self) -> Vector:
        posture, axes = self._options.posture, self._axes
        if isinstance(posture, str):
            return np.asarray(0.5 * (axes.lowest + axes.highest))
        if len(posture) != axes.count:
            raise ControllerError(
                f"posture has {len(posture)} positions, and the robot {axes.count} axes"
            )
        return np.asarray(np.clip(np.array(posture), axes.lowest, axes.highest))
