"""From where the tip is to where a trajectory begins: straight, smooth, never too fast."""

import numpy as np

from drivers.pose import Vector

_PEAK = 1.875
"""Highest speed of the polynomial against its mean."""


class Blend:
    """A straight line with the least jerk: velocity and acceleration are zero at both ends."""

    def __init__(self, from_mm: Vector, to_mm: Vector, max_speed_mm_s: float) -> None:
        """Raises ValueError for places that are not finite and a speed that is not positive."""
        if not (np.isfinite(from_mm).all() and np.isfinite(to_mm).all() and max_speed_mm_s > 0.0):
            raise ValueError(f"no way from {from_mm} to {to_mm} at {max_speed_mm_s} mm/s")
        self._from_mm = np.array(from_mm, dtype=np.float64)
        self._way_mm = np.asarray(to_mm, dtype=np.float64) - self._from_mm
        self.duration_s = _PEAK * float(np.linalg.norm(self._way_mm)) / max_speed_mm_s

    def at(self, t_s: float) -> tuple[Vector, Vector]:
        """(3,) mm and (3,) mm/s at `t_s` after the start."""
        if t_s >= self.duration_s:
            return self._from_mm + self._way_mm, np.zeros(3)
        s = max(t_s, 0.0) / self.duration_s
        share = s**3 * (10.0 + s * (6.0 * s - 15.0))
        rate = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration_s
        return self._from_mm + share * self._way_mm, rate * self._way_mm
