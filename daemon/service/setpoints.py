"""The set-point stream of a teleoperation: which are followed, and why others are not."""

from math import isfinite
from typing import Final

import numpy as np

from config.control import Workspace
from config.tasks.trajectory import FARTHEST_MM
from daemon.messages import Setpoint
from daemon.reference.teleoperation import TeleoperationReference
from drivers.pose import Vector

_SPEED_MM_S: Final = 15.0
_LONGEST_VALIDITY_S: Final = 1.0
_TURN_RAD_S: Final = 0.4
_POINTS_NOWHERE: Final = (
    "pointing: this controller leads the tip by its position alone, or the axes are too few for "
    "five degrees of freedom: send no direction"
)
_UNIT: Final = 1e-3
"""By which the length of a direction may be off."""


class Setpoints:
    """Of one teleoperation, from its beginning on."""

    def __init__(self, workspace: Workspace | None, t_ns: int, pointing: bool = False) -> None:
        """pointing: whether they may say where the tip shall point."""
        self.reference = TeleoperationReference(_SPEED_MM_S, t_ns, _TURN_RAD_S)
        self._workspace = workspace
        self._pointing = pointing
        self._last, self._token = -1, ""
        """Number of the newest, and the lease that it came under."""

    def take(self, setpoint: Setpoint, t_ns: int) -> str:
        """Follow a set-point that came at `t_ns`. Returns why not; empty if it is followed."""
        why = self._unwanted(setpoint)
        if why:
            return why
        self._last, self._token = setpoint.sequence, setpoint.token
        velocity = setpoint.velocity_mm_s
        self.reference.set(
            t_ns,
            np.array(setpoint.position_mm, dtype=np.float64),
            setpoint.valid_s,
            None if velocity is None else np.array(velocity, dtype=np.float64),
            None if setpoint.direction is None else _unit(setpoint.direction),
        )
        return ""

    def _unwanted(self, setpoint: Setpoint) -> str:
        velocity = setpoint.velocity_mm_s
        # Who goes on under another lease counts from the beginning.
        if setpoint.token == self._token and setpoint.sequence <= self._last:
            return f"it is not newer than number {self._last}"
        if len(setpoint.position_mm) != 3 or (velocity is not None and len(velocity) != 3):
            return "position and velocity have three numbers"
        if not all(map(isfinite, [*setpoint.position_mm, *(velocity or ())])):
            return "it is not finite"
        if max(map(abs, [*setpoint.position_mm, *(velocity or ())])) > FARTHEST_MM:
            return f"nothing here is {FARTHEST_MM:g} mm away, or so fast"
        if not 0.0 < setpoint.valid_s <= _LONGEST_VALIDITY_S:
            return f"valid_s must be more than 0 and at most {_LONGEST_VALIDITY_S:g}"
        return self._undirected(setpoint.direction) or self._outside(setpoint)

    def _undirected(self, direction: list[float] | None) -> str:
        if direction is None:
            return ""
        if not self._pointing:
            return _POINTS_NOWHERE
        if len(direction) != 3 or not all(map(isfinite, direction)):
            return "a direction has three numbers, all of them finite"
        length = sum(one * one for one in direction) ** 0.5
        return "" if abs(length - 1.0) <= _UNIT else f"a direction is as long as 1, not {length:g}"

    def _outside(self, setpoint: Setpoint) -> str:
        workspace = self._workspace
        if workspace is None:
            return ""
        ranges = (workspace.x_mm, workspace.y_mm, workspace.z_mm)
        for name, value, (low, high) in zip("xyz", setpoint.position_mm, ranges, strict=True):
            if not low <= value <= high:
                return f"{name} = {value:.1f} mm is outside the workspace [{low:g}, {high:g}]"
        return ""


def _unit(direction: list[float]) -> Vector:
    vector = np.array(direction, dtype=np.float64)
    return vector / np.sqrt(vector @ vector)
