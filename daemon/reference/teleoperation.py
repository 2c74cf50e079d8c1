"""The reference in teleoperation: the newest set-point, approached at a limited speed."""

from math import inf
from typing import Final, NamedTuple

import numpy as np

from daemon.reference.reference import AT_REST, LED_TO_THE_START, TURN_RAD_S, Aim, Turn
from drivers.pose import Vector

_NS_PER_S: Final = 1e9
_FARTHEST: Final = 1e5
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


class TeleoperationReference:
    """The set-point stream. It has no end of its own."""

    finished = False

    def __init__(
        self, max_speed_mm_s: float, t_ns: int, max_turn_rad_s: float = TURN_RAD_S
    ) -> None:
        """t_ns: now. From here on a set-point is waited for."""
        self._max_speed_mm_s = max_speed_mm_s
        self._max_turn_rad_s = max_turn_rad_s
        self._direction: Vector | None = None
        """Where the reference points; None: nobody knows where the tip does."""
        self._from_mm = AT_REST
        self._setpoints = SetpointReference(AT_REST, max_speed_mm_s)
        self._newest: _Newest | None = None
        self._waits_since_ns = t_ns

    def begin(self, tip_mm: Vector, direction: Vector | None = None) -> None:
        self._from_mm, self._direction = tip_mm, direction
        self._setpoints = SetpointReference(tip_mm, self._max_speed_mm_s)
        if self._newest is not None:
            self._setpoints.set(*self._newest[:-1])

    def wait(self) -> Aim:
        """With where it points, once a hand has asked for that: the controller may have to find out
        first what turns the tip."""
        direction = None if self._wanted_direction is None else self._direction
        turn = None if direction is None else AT_REST
        return Aim(self._from_mm, AT_REST, LED_TO_THE_START, direction, turn)

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        position, velocity = self._setpoints.advance(t_ns)
        pointing = self._pointing(dt_s if self._setpoints.valid(t_ns) else 0.0) or (None, None)
        return Aim(position, velocity, LED_TO_THE_START, *pointing)

    @property
    def _wanted_direction(self) -> Vector | None:
        return None if self._newest is None else self._newest.direction

    def _pointing(self, dt_s: float) -> tuple[Vector, Vector] | None:
        """(3,) direction and its change in 1/s, `dt_s` later; None: the tip may point anywhere."""
        wanted = self._wanted_direction
        if wanted is None or self._direction is None:
            return None
        turn = Turn(self._direction, wanted)
        share = min(1.0, self._max_turn_rad_s * dt_s / turn.angle) if turn.angle > 0.0 else 1.0
        before = self._direction
        if dt_s > 0.0:
            self._direction = turn.at(share)[0]
        return self._direction, (self._direction - before) / dt_s if dt_s > 0.0 else AT_REST

    def ahead(self, lead_s: float) -> None:
        """Nobody knows what a hand will do."""

    def go_at(self, pace: float) -> None:
        """A hand goes at its own."""

    @property
    def own_speed_mm_s(self) -> None:
        """A hand is not slowed."""

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
