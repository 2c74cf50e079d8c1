"""Where the tip should be now: led to the start, then along the trajectory, and held in between."""

from enum import Enum
from math import inf
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from daemon.reference.blend import Blend
from daemon.reference.setpoint_reference import SetpointReference
from daemon.reference.trajectories import Trajectory

Vector = NDArray[np.float64]

_AT_REST: Final = np.zeros(3)
_LED_TO_THE_START: Final = -1


class Aim(NamedTuple):
    """What the tip should be doing."""

    position_mm: Vector
    velocity_mm_s: Vector
    cycle: int
    """Of the trajectory; -1 while the tip is led to its start."""


class Reference(Protocol):
    """What is followed while the robot is RUNNING."""

    finished: bool

    def begin(self, tip_mm: Vector) -> None:
        """Motion begins, or goes on after a hold, from where the tip is."""
        ...

    def wait(self) -> Aim:
        """Stay where the motion began: the controller is not ready yet."""
        ...

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        """The aim `dt_s` later."""
        ...


class _Phase(Enum):
    BLEND = "blend"
    FOLLOW = "follow"


class TrajectoryReference:
    """A trajectory on a clock of its own, which stands still while the robot does."""

    def __init__(self, trajectory: Trajectory, blend_speed_mm_s: float) -> None:
        self.trajectory = trajectory
        self.finished = False
        self.elapsed_s = 0.0
        """Along the trajectory."""
        self._speed_mm_s = blend_speed_mm_s
        self._phase = _Phase.BLEND
        self._blend: Blend | None = None
        self._blend_s = 0.0
        self._from_mm = _AT_REST

    def begin(self, tip_mm: Vector) -> None:
        to_mm, _ = self.trajectory.at(self.elapsed_s)
        self._from_mm = tip_mm
        self._blend, self._blend_s = Blend(tip_mm, to_mm, self._speed_mm_s), 0.0
        self._phase = _Phase.BLEND

    def wait(self) -> Aim:
        return Aim(self._from_mm, _AT_REST, _LED_TO_THE_START)

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        del t_ns
        if self._phase is _Phase.BLEND:
            assert self._blend is not None
            self._blend_s += dt_s
            if self._blend_s < self._blend.duration_s:
                position, velocity = self._blend.at(self._blend_s)
                return Aim(position, velocity, _LED_TO_THE_START)
            self._phase = _Phase.FOLLOW
            dt_s = self._blend_s - self._blend.duration_s
        self.elapsed_s += dt_s
        self.finished = self.elapsed_s >= self.trajectory.duration_s
        at_s = min(self.elapsed_s, self.trajectory.duration_s)
        position, velocity = self.trajectory.at(at_s)
        return Aim(position, velocity, self.trajectory.cycle_of(at_s))


class TeleoperationReference:
    """The set-point stream. It has no end of its own."""

    finished = False

    def __init__(self, max_speed_mm_s: float, t_ns: int) -> None:
        """t_ns: now. From here on a set-point is waited for."""
        self._max_speed_mm_s = max_speed_mm_s
        self._from_mm = _AT_REST
        self._setpoints = SetpointReference(_AT_REST, max_speed_mm_s)
        self._newest: _Newest | None = None
        self._waits_since_ns = t_ns

    def begin(self, tip_mm: Vector) -> None:
        self._from_mm = tip_mm
        self._setpoints = SetpointReference(tip_mm, self._max_speed_mm_s)
        if self._newest is not None:
            self._setpoints.set(*self._newest)

    def wait(self) -> Aim:
        return Aim(self._from_mm, _AT_REST, _LED_TO_THE_START)

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        del dt_s
        position, velocity = self._setpoints.advance(t_ns)
        return Aim(position, velocity, _LED_TO_THE_START)

    def set(
        self, t_ns: int, position_mm: Vector, valid_s: float, velocity_mm_s: Vector | None
    ) -> None:
        """A set-point came. Raises ValueError for one that is not finite."""
        newest = _Newest(t_ns, position_mm, valid_s, velocity_mm_s)
        self._setpoints.set(*newest)
        self._newest = newest

    def age_s(self, t_ns: int) -> float:
        """Since the newest set-point came; infinite if it has expired.

        Before the first: since there could have been one.
        """
        if self._newest is None:
            return (t_ns - self._waits_since_ns) * 1e-9
        return (t_ns - self._newest.t_ns) * 1e-9 if self._setpoints.valid(t_ns) else inf


class _Newest(NamedTuple):
    t_ns: int
    position_mm: Vector
    valid_s: float
    velocity_mm_s: Vector | None
