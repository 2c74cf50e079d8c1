"""Between the axes' positions and the coordinates that a robot file makes of them."""

from dataclasses import dataclass

import numpy as np

from config.coupling.sums import coordinate_map
from config.robot import Robot
from drivers.pose import Vector


@dataclass(frozen=True)
class Coordinates:
    """The map u = M (q − q₀) of a robot: u the axes, q the coordinates, each (m,), in mm or rad.

    A robot whose file names no coordinates has its axes for them: then M is one and q₀ zero.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    periods: tuple[float | None, ...]
    """After how much of each the body has the same shape again; None: never."""
    matrix: Vector
    """(m, m) M: a column says how far each axis goes with one coordinate."""
    inverse: Vector
    """(m, m) of M."""
    at_zero: Vector
    """(m,) q₀, the coordinates where all axes are at their zeros."""

    @classmethod
    def of(cls, robot: Robot) -> "Coordinates":
        """Those of a robot file that has been checked."""
        axes = [axis.name for axis in robot.axes]
        if not robot.coordinates:
            one = np.eye(len(axes))
            units = tuple(axis.unit for axis in robot.axes)
            return cls(tuple(axes), units, (None,) * len(axes), one, one, np.zeros(len(axes)))
        matrix, at_zero = coordinate_map(robot.coordinates, axes)
        return cls(
            tuple(q.name for q in robot.coordinates),
            tuple(q.unit for q in robot.coordinates),
            tuple(q.period for q in robot.coordinates),
            matrix,
            np.asarray(np.linalg.inv(matrix)),
            at_zero,
        )

    @property
    def count(self) -> int:
        """m, of the coordinates as of the axes."""
        return len(self.names)

    def of_axes(self, u: Vector) -> Vector:
        """(..., m) coordinates of (..., m) positions of the axes; angles count on."""
        return np.asarray(u @ self.inverse.T + self.at_zero)

    def axes(self, q: Vector) -> Vector:
        """(..., m) positions of the axes of (..., m) coordinates."""
        return np.asarray((q - self.at_zero) @ self.matrix.T)

    def steps_of_axes(self, delta_u: Vector) -> Vector:
        """(..., m) steps of the coordinates, of steps or velocities of the axes."""
        return np.asarray(delta_u @ self.inverse.T)

    def axis_steps(self, delta_q: Vector) -> Vector:
        """(..., m) steps of the axes, of steps or velocities of the coordinates."""
        return np.asarray(delta_q @ self.matrix.T)

    def slopes_by_axes(self, slopes: Vector) -> Vector:
        """(..., m) derivatives by the axes, of those by the coordinates: ∂y/∂u = ∂y/∂q M⁻¹."""
        return np.asarray(slopes @ self.inverse)
