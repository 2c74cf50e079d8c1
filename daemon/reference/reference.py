"""Where the tip should be now: led to the path, then along the trajectory, and held in between."""

from collections.abc import Callable
from math import inf
from typing import Final, NamedTuple, Protocol

import numpy as np

from daemon.reference.trajectories import Motion, Trajectory
from drivers.pose import Vector

# From where the tip is to where a trajectory begins: straight, smooth, never too fast.


_PEAK = 1.875
"""Highest speed of the polynomial against its mean."""
_TURN_RAD_S = 0.2
"""No tip is led to its first direction faster."""
_OPPOSITE = 1e-9


class Blend:
    """A straight line with the least jerk: velocity and acceleration are zero at both ends."""

    def __init__(
        self,
        from_mm: Vector,
        to_mm: Vector,
        max_speed_mm_s: float,
        from_direction: Vector | None = None,
        to_direction: Vector | None = None,
    ) -> None:
        """Directions: (3,) unit vectors, led from one to the other meanwhile; None: none.

        Raises ValueError for places that are not finite and a speed that is not positive.
        """
        if not (np.isfinite(from_mm).all() and np.isfinite(to_mm).all() and max_speed_mm_s > 0.0):
            raise ValueError(f"no way from {from_mm} to {to_mm} at {max_speed_mm_s} mm/s")
        self._from_mm = np.array(from_mm, dtype=np.float64)
        self._way_mm = np.asarray(to_mm, dtype=np.float64) - self._from_mm
        self.duration_s = _PEAK * float(np.linalg.norm(self._way_mm)) / max_speed_mm_s
        self._turn: _Turn | None = None
        if from_direction is not None and to_direction is not None:
            self._turn = _Turn(from_direction, to_direction)
            self.duration_s = max(self.duration_s, _PEAK * self._turn.angle / _TURN_RAD_S)

    def last(self, least_s: float) -> None:
        """Take so long, if it is not longer anyway."""
        self.duration_s = max(self.duration_s, least_s)

    def at(self, t_s: float) -> tuple[Vector, Vector]:
        """(3,) mm and (3,) mm/s at `t_s` after the start."""
        if t_s >= self.duration_s:
            return self._from_mm + self._way_mm, np.zeros(3)
        s = max(t_s, 0.0) / self.duration_s
        share = s**3 * (10.0 + s * (6.0 * s - 15.0))
        rate = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration_s
        return self._from_mm + share * self._way_mm, rate * self._way_mm

    def pointing_at(self, t_s: float) -> tuple[Vector, Vector] | None:
        """(3,) direction and its change in 1/s, at `t_s` after the start."""
        if self._turn is None:
            return None
        if t_s >= self.duration_s:
            return self._turn.at(1.0)[0], np.zeros(3)
        s = max(t_s, 0.0) / self.duration_s
        share = s**3 * (10.0 + s * (6.0 * s - 15.0))
        direction, by_share = self._turn.at(share)
        return direction, 30.0 * s**2 * (1.0 - s) ** 2 / self.duration_s * by_share


class _Turn:
    """From one direction to another along a great circle."""

    def __init__(self, from_direction: Vector, to_direction: Vector) -> None:
        self._from = np.array(from_direction, dtype=np.float64)
        aside = to_direction - float(self._from @ to_direction) * self._from
        sine = float(np.sqrt(aside @ aside))
        self.angle = float(np.arctan2(sine, float(self._from @ to_direction)))
        if sine < _OPPOSITE:  # the same, or opposite: any way round is as good as another
            aside = np.cross(self._from, np.eye(3)[int(np.argmin(np.abs(self._from)))])
            sine = float(np.sqrt(aside @ aside))
        self._aside = aside / sine

    def at(self, share: float) -> tuple[Vector, Vector]:
        """(3,) after this share of the way, and (3,) how it changes by the share."""
        angle = share * self.angle
        direction = np.cos(angle) * self._from + np.sin(angle) * self._aside
        along = np.cos(angle) * self._aside - np.sin(angle) * self._from
        return direction, self.angle * along


# The reference in teleoperation: the newest set-point, approached at a limited speed.


_NS_PER_S = 1e9
_FARTHEST = 1e5
"""mm and mm/s; what is beyond is a mistake."""


class SetpointReference:
    """Stands where motion began until the first set-point, and wherever it is when one expires."""

    def __init__(self, start_mm: Vector, max_speed_mm_s: float) -> None:
        if not (np.isfinite(start_mm).all() and max_speed_mm_s > 0.0):
            raise ValueError(f"no reference can begin at {start_mm} with {max_speed_mm_s} mm/s")
        self._position_mm = np.array(start_mm, dtype=np.float64)
        self._max_speed_mm_s = max_speed_mm_s
        self._goal_mm = self._position_mm.copy()
        self._goal_velocity = np.zeros(3)
        self._set_ns = 0
        self._expires_ns: int | None = None
        self._advanced_ns: int | None = None

    def set(
        self, t_ns: int, position_mm: Vector, valid_s: float, velocity_mm_s: Vector | None = None
    ) -> None:
        """Take a set-point that arrived at `t_ns`. With a velocity it moves on until it expires.

        Raises ValueError for what makes no sense; the last set-point then stays.
        """
        position = np.array(position_mm, dtype=np.float64)
        velocity = np.zeros(3) if velocity_mm_s is None else np.array(velocity_mm_s, np.float64)
        if not (
            position.shape == velocity.shape == (3,)
            and (np.abs(position) <= _FARTHEST).all()
            and (np.abs(velocity) <= _FARTHEST).all()
            and 0.0 < valid_s < np.inf
        ):
            raise ValueError(
                f"a set-point needs three numbers in mm and a time to be valid, not {position_mm} "
                f"and {velocity_mm_s} for {valid_s} s"
            )
        self._goal_mm, self._goal_velocity = position, velocity
        self._set_ns, self._expires_ns = t_ns, t_ns + round(valid_s * _NS_PER_S)

    def valid(self, t_ns: int) -> bool:
        """Whether there is a set-point that may be followed at `t_ns`."""
        return self._expires_ns is not None and t_ns <= self._expires_ns

    def advance(self, t_ns: int) -> tuple[Vector, Vector]:
        """(3,) mm and (3,) mm/s of the reference at `t_ns`, which must not go back."""
        before_ns = t_ns if self._advanced_ns is None else self._advanced_ns
        self._advanced_ns = max(t_ns, before_ns)
        dt_s = (self._advanced_ns - before_ns) / _NS_PER_S
        if dt_s <= 0.0 or not self.valid(t_ns):
            return self._position_mm.copy(), np.zeros(3)
        goal = self._goal_mm + self._goal_velocity * max(t_ns - self._set_ns, 0) / _NS_PER_S
        way = goal - self._position_mm
        distance, most = float(np.linalg.norm(way)), self._max_speed_mm_s * dt_s
        step = way if distance <= most else way * (most / distance)
        self._position_mm = self._position_mm + step
        return self._position_mm.copy(), step / dt_s


_AT_REST: Final = np.zeros(3)
_LED_TO_THE_START: Final = -1


class Aim(NamedTuple):
    """What the tip should be doing."""

    position_mm: Vector
    velocity_mm_s: Vector
    cycle: int
    """Of the trajectory; -1 while the tip is led to its start."""
    direction: Vector | None = None
    """(3,) unit vector along the tip's axis. None: it may point anywhere."""
    turn: Vector | None = None
    """(3,) 1/s by which that changes."""
    in_cycle_s: float | None = None
    """Since the cycle began, where it is repeated; None: it is not."""
    cycle_s: float = 0.0
    """How long one lasts."""


class Reference(Protocol):
    """What is followed while the robot is RUNNING."""

    finished: bool

    def begin(self, tip_mm: Vector, direction: Vector | None = None) -> None:
        """Motion begins, or goes on after a hold, from where the tip is and points."""
        ...

    def wait(self) -> Aim:
        """Stay where the motion began: the controller is not ready yet."""
        ...

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        """The aim `dt_s` later."""
        ...

    def ahead(self, lead_s: float) -> tuple[Vector, Vector] | None:
        """(3,) mm and (3,) mm/s of the aim `lead_s` after the last one; None: that is not known."""
        ...


Unhurried = Callable[[Blend], float]
"""Seconds that the axes should have for a way."""


_RUN_UP_S: Final = 2.0
"""From rest to the path's own speed: half of it, in the path's own time, before the place where it
is to be followed. Chosen: a circle at 40 mm/s of the soft arm begins as it goes on, which after 1 s
it does not."""
_MOST_OF_A_CYCLE: Final = 0.25


class RunUp:
    """A way along the trajectory itself that begins at rest and ends with its own speed."""

    def __init__(self, trajectory: Trajectory, to_s: float) -> None:
        """to_s: where it is to be followed from, along the trajectory. There is no run-up (it
        takes no time) where the trajectory begins at rest, or nothing leads to its beginning."""
        before_s = min(0.5 * _RUN_UP_S, _MOST_OF_A_CYCLE * trajectory.cycle_s)
        leads_there = before_s <= to_s or trajectory.closed
        moves = bool(trajectory.at(to_s)[1].any())
        self.duration_s = 2.0 * before_s if leads_there and moves else 0.0
        self._trajectory = trajectory
        self._to_s = to_s

    def at(self, t_s: float) -> Motion:
        """(3,) mm and (3,) mm/s at `t_s` after it began."""
        along_s, rate = self._along(t_s)
        position, velocity = self._trajectory.at(along_s)
        return position, rate * velocity

    def pointing_at(self, t_s: float) -> Motion | None:
        """(3,) direction and its change in 1/s; None: it may be any."""
        along_s, rate = self._along(t_s)
        pointing = self._trajectory.pointing_at(along_s)
        return None if pointing is None else (pointing[0], rate * pointing[1])

    def _along(self, t_s: float) -> tuple[float, float]:
        """Along the trajectory, and how fast that goes on: smoothly from 0 to 1."""
        if not self.duration_s > 0.0:
            return self._to_s, 0.0
        s = min(max(t_s / self.duration_s, 0.0), 1.0)
        along_s = self._to_s + self.duration_s * (s**3 - 0.5 * s**4 - 0.5)
        wrapped = along_s + self._trajectory.cycle_s if along_s < 0.0 else along_s
        return wrapped, s**2 * (3.0 - 2.0 * s)


class TrajectoryReference:
    """A trajectory on a clock of its own, which stands still while the robot does."""

    def __init__(
        self,
        trajectory: Trajectory,
        blend_speed_mm_s: float,
        unhurried: Unhurried | None = None,
    ) -> None:
        """unhurried: asked when motion begins, for the way to where it goes on."""
        self.trajectory = trajectory
        self._unhurried = unhurried
        self.finished = False
        self.elapsed_s = 0.0
        """Along the trajectory."""
        self._speed_mm_s = blend_speed_mm_s
        self._blend: Blend | None = None
        """To where the run-up begins. None: the trajectory is followed."""
        self._run_up = RunUp(trajectory, 0.0)
        self._way_s = 0.0
        """Since the blend began."""
        self._from_mm = _AT_REST
        self._from_direction: Vector | None = None

    def begin(self, tip_mm: Vector, direction: Vector | None = None) -> None:
        self._run_up = RunUp(self.trajectory, self.elapsed_s)
        to_mm, _ = self._run_up.at(0.0)
        pointing = self._run_up.pointing_at(0.0)
        to_direction = None if pointing is None else pointing[0]
        self._from_mm = tip_mm
        self._from_direction = None if pointing is None else direction
        self._blend = Blend(tip_mm, to_mm, self._speed_mm_s, direction, to_direction)
        if self._unhurried is not None:
            self._blend.last(self._unhurried(self._blend))
        self._way_s = 0.0

    def wait(self) -> Aim:
        direction = self._from_direction
        turn = None if direction is None else _AT_REST
        return Aim(self._from_mm, _AT_REST, _LED_TO_THE_START, direction, turn)

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        del t_ns
        if self._blend is not None:
            self._way_s += dt_s
            way, since_s = self._way(self._blend, self._way_s)
            if way is not None:
                pointing = way.pointing_at(since_s) or (None, None)
                return Aim(*way.at(since_s), _LED_TO_THE_START, *pointing)
            self._blend, dt_s = None, since_s
        self.elapsed_s += dt_s
        self.finished = self.elapsed_s >= self.trajectory.duration_s
        at_s = min(self.elapsed_s, self.trajectory.duration_s)
        position, velocity = self.trajectory.at(at_s)
        direction, turn = self.trajectory.pointing_at(at_s) or (None, None)
        cycle, cycle_s = self.trajectory.cycle_of(at_s), self.trajectory.cycle_s
        in_cycle_s = at_s - cycle * cycle_s if self.trajectory.cycles > 1 else None
        return Aim(position, velocity, cycle, direction, turn, in_cycle_s, cycle_s)

    def ahead(self, lead_s: float) -> tuple[Vector, Vector]:
        if self._blend is not None:
            way, lead_s = self._way(self._blend, self._way_s + lead_s)
            if way is not None:
                return way.at(lead_s)
        along_s, end_s = self.elapsed_s + lead_s, self.trajectory.duration_s
        position, velocity = self.trajectory.at(min(along_s, end_s))
        return position, velocity if along_s < end_s else _AT_REST

    def _way(self, blend: Blend, way_s: float) -> tuple[Blend | RunUp | None, float]:
        """What leads to the trajectory then, and for how long already; None: it is followed."""
        if way_s < blend.duration_s:
            return blend, way_s
        way_s -= blend.duration_s
        run_up_s = self._run_up.duration_s
        return (self._run_up, way_s) if way_s < run_up_s else (None, way_s - run_up_s)


class TeleoperationReference:
    """The set-point stream. It has no end of its own."""

    finished = False

    def __init__(
        self, max_speed_mm_s: float, t_ns: int, max_turn_rad_s: float = _TURN_RAD_S
    ) -> None:
        """t_ns: now. From here on a set-point is waited for."""
        self._max_speed_mm_s = max_speed_mm_s
        self._max_turn_rad_s = max_turn_rad_s
        self._direction: Vector | None = None
        """Where the reference points; None: nobody knows where the tip does."""
        self._from_mm = _AT_REST
        self._setpoints = SetpointReference(_AT_REST, max_speed_mm_s)
        self._newest: _Newest | None = None
        self._waits_since_ns = t_ns

    def begin(self, tip_mm: Vector, direction: Vector | None = None) -> None:
        self._from_mm, self._direction = tip_mm, direction
        self._setpoints = SetpointReference(tip_mm, self._max_speed_mm_s)
        if self._newest is not None:
            self._setpoints.set(*self._newest[:-1])

    def wait(self) -> Aim:
        return Aim(self._from_mm, _AT_REST, _LED_TO_THE_START)

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        position, velocity = self._setpoints.advance(t_ns)
        pointing = self._pointing(dt_s if self._setpoints.valid(t_ns) else 0.0) or (None, None)
        return Aim(position, velocity, _LED_TO_THE_START, *pointing)

    def _pointing(self, dt_s: float) -> tuple[Vector, Vector] | None:
        """(3,) direction and its change in 1/s, `dt_s` later; None: the tip may point anywhere."""
        wanted = None if self._newest is None else self._newest.direction
        if wanted is None or self._direction is None:
            return None
        turn = _Turn(self._direction, wanted)
        share = min(1.0, self._max_turn_rad_s * dt_s / turn.angle) if turn.angle > 0.0 else 1.0
        before = self._direction
        if dt_s > 0.0:
            self._direction = turn.at(share)[0]
        return self._direction, (self._direction - before) / dt_s if dt_s > 0.0 else _AT_REST

    def ahead(self, lead_s: float) -> None:
        """Nobody knows what a hand will do."""

    def set(
        self,
        t_ns: int,
        position_mm: Vector,
        valid_s: float,
        velocity_mm_s: Vector | None,
        direction: Vector | None = None,
    ) -> None:
        """A set-point came. direction: (3,) of unit length; None: the tip may point anywhere.

        Raises ValueError for one that is not finite.
        """
        newest = _Newest(t_ns, position_mm, valid_s, velocity_mm_s, direction)
        self._setpoints.set(*newest[:-1])
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
    direction: Vector | None
