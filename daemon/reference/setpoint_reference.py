"""The reference in teleoperation: the newest set-point, approached at a limited speed."""

import numpy as np

from drivers.pose import Vector

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
