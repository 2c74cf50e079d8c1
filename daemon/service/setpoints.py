"""The set-point stream of a teleoperation: which are followed, and why others are not."""

from math import isfinite
from typing import Final

import numpy as np

from config.control import Workspace
from config.tasks.trajectory import FARTHEST_MM
from daemon.messages import Setpoint
from daemon.reference.reference import TeleoperationReference

_SPEED_MM_S: Final = 15.0
_LONGEST_VALIDITY_S: Final = 1.0
_POINTS_NOWHERE: Final = (
    "pointing: this robot's tip is led by its position alone, and no controller points it: send no "
    "direction"
)


class Setpoints:
    """Of one teleoperation, from its beginning on."""

    def __init__(self, workspace: Workspace | None, t_ns: int) -> None:
        self.reference = TeleoperationReference(_SPEED_MM_S, t_ns)
        self._workspace = workspace
        self._last = -1

    def take(self, setpoint: Setpoint, t_ns: int) -> str:
        """Follow a set-point that came at `t_ns`. Returns why not; empty if it is followed."""
        why = self._unwanted(setpoint)
        if why:
            return why
        self._last = setpoint.sequence
        velocity = setpoint.velocity_mm_s
        self.reference.set(
            t_ns,
            np.array(setpoint.position_mm, dtype=np.float64),
            setpoint.valid_s,
            None if velocity is None else np.array(velocity, dtype=np.float64),
        )
        return ""

    def _unwanted(self, setpoint: Setpoint) -> str:
        velocity = setpoint.velocity_mm_s
        if setpoint.direction is not None:
            return _POINTS_NOWHERE
        if setpoint.sequence <= self._last:
            return f"it is not newer than number {self._last}"
        if len(setpoint.position_mm) != 3 or (velocity is not None and len(velocity) != 3):
            return "position and velocity have three numbers"
        if not all(map(isfinite, [*setpoint.position_mm, *(velocity or ())])):
            return "it is not finite"
        if max(map(abs, [*setpoint.position_mm, *(velocity or ())])) > FARTHEST_MM:
            return f"nothing here is {FARTHEST_MM:g} mm away, or so fast"
        if not 0.0 < setpoint.valid_s <= _LONGEST_VALIDITY_S:
            return f"valid_s must be more than 0 and at most {_LONGEST_VALIDITY_S:g}"
        return self._outside(setpoint)

    def _outside(self, setpoint: Setpoint) -> str:
        workspace = self._workspace
        if workspace is None:
            return ""
        ranges = (workspace.x_mm, workspace.y_mm, workspace.z_mm)
        for name, value, (low, high) in zip("xyz", setpoint.position_mm, ranges, strict=True):
            if not low <= value <= high:
                return f"{name} = {value:.1f} mm is outside the workspace [{low:g}, {high:g}]"
        return ""
