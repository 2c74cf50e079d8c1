"""Where the tip should be now: led to the path, then along the trajectory, and held in between."""

from collections.abc import Callable
from math import sqrt
from typing import Final, NamedTuple, Protocol

import numpy as np

from daemon.reference.pacing import AGREED_S, Pacing
from daemon.reference.trajectories import Motion, Trajectory
from drivers.pose import Vector

# From where the tip is to where a trajectory begins: straight, smooth, never too fast.


_PEAK = 1.875
"""Highest speed of the polynomial against its mean."""
TURN_RAD_S = 0.2
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
        self._turn: Turn | None = None
        if from_direction is not None and to_direction is not None:
            self._turn = Turn(from_direction, to_direction)
            self.duration_s = max(self.duration_s, _PEAK * self._turn.angle / TURN_RAD_S)

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


class Turn:
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


AT_REST: Final = np.zeros(3)
LED_TO_THE_START: Final = -1


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
    pace: float = 1.0
    """Seconds of these for each second that passes."""


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

    def go_at(self, pace: float) -> None:
        """Go on at this share of its own speed, above 0 and up to 1, from when on nothing else was
        foretold."""
        ...

    @property
    def own_speed_mm_s(self) -> float | None:
        """Where it is not slowed, at that time; None: it never is."""
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
        """Since the blend began, in its own time, and in the run-up's afterwards."""
        self._pacing = Pacing()
        """Of run-up and trajectory: the blend goes as fast as it may."""
        self._from_mm = AT_REST
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
        turn = None if direction is None else AT_REST
        return Aim(self._from_mm, AT_REST, LED_TO_THE_START, direction, turn)

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        del t_ns
        along_s, pace = self._passes(dt_s)
        if self._blend is not None:
            self._way_s += along_s
            way, since_s = self._way(self._blend, self._way_s)
            if way is not None:
                position, velocity = way.at(since_s)
                direction, turn = way.pointing_at(since_s) or (None, None)
                turn = None if turn is None else pace * turn
                return Aim(position, pace * velocity, LED_TO_THE_START, direction, turn)
            self._blend, along_s = None, since_s
        self.elapsed_s += along_s
        self.finished = self.elapsed_s >= self.trajectory.duration_s
        at_s = min(self.elapsed_s, self.trajectory.duration_s)
        position, velocity = self.trajectory.at(at_s)
        direction, turn = self.trajectory.pointing_at(at_s) or (None, None)
        cycle, cycle_s = self.trajectory.cycle_of(at_s), self.trajectory.cycle_s
        in_cycle_s = at_s - cycle * cycle_s if self.trajectory.cycles > 1 else None
        turn = None if turn is None else pace * turn
        velocity = pace * velocity
        return Aim(position, velocity, cycle, direction, turn, in_cycle_s, cycle_s, pace)

    def ahead(self, lead_s: float) -> tuple[Vector, Vector]:
        position, velocity, _ = self._ahead(lead_s)
        return position, velocity

    def _ahead(self, lead_s: float) -> tuple[Vector, Vector, float]:
        lead_s, pace = self._led(lead_s)
        if self._blend is not None:
            way, lead_s = self._way(self._blend, self._way_s + lead_s)
            if way is not None:
                position, velocity = way.at(lead_s)
                return position, pace * velocity, pace
        along_s, end_s = self.elapsed_s + lead_s, self.trajectory.duration_s
        position, velocity = self.trajectory.at(min(along_s, end_s))
        return position, pace * velocity if along_s < end_s else AT_REST, pace

    def go_at(self, pace: float) -> None:
        self._pacing.ask(pace)

    @property
    def own_speed_mm_s(self) -> float:
        _, velocity, pace = self._ahead(AGREED_S)
        return sqrt(velocity @ velocity) / pace

    def _blend_left_s(self) -> float:
        """In which time passes as it does."""
        return 0.0 if self._blend is None else max(self._blend.duration_s - self._way_s, 0.0)

    def _led(self, lead_s: float) -> tuple[float, float]:
        """Seconds of way and trajectory from now on, and their pace then."""
        left_s = self._blend_left_s()
        if lead_s <= left_s:
            return lead_s, 1.0
        return left_s + self._pacing.along(left_s, lead_s), self._pacing.at(lead_s)

    def _passes(self, dt_s: float) -> tuple[float, float]:
        """The same, and it is later."""
        passed = self._led(dt_s)
        self._pacing.advance(dt_s)
        return passed

    def _way(self, blend: Blend, way_s: float) -> tuple[Blend | RunUp | None, float]:
        """What leads to the trajectory then, and for how long already; None: it is followed."""
        if way_s < blend.duration_s:
            return blend, way_s
        way_s -= blend.duration_s
        run_up_s = self._run_up.duration_s
        return (self._run_up, way_s) if way_s < run_up_s else (None, way_s - run_up_s)
