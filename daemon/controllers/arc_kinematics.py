"""Two arcs in series: from piston positions to the tip, its Jacobian, and the way back."""

import numpy as np

from config.controllers import ConstantCurvature
from daemon.control.tip_following import bounded_step
from daemon.controllers.arc import arc, arc_carries_by_bending, arc_end_by_shape
from daemon.controllers.chamber_models import chamber_model
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

CHAMBERS = 3
_SEARCH_STEPS = 60
_SEARCH_DAMPING_MM = 5.0
_FOUND_MM = 0.01
_NO_PROGRESS_MM = 0.001
_LONGEST_SEARCH_STEP = 0.1
"""Of an axis' travel."""


class ArcKinematics:
    """The model, and a `KinematicModel` for reachability."""

    def __init__(self, options: ConstantCurvature, axes: AxisRanges, bore_mm2: Vector) -> None:
        """bore_mm2: (6,) areas of the pistons."""
        self._base = np.array(options.base_offset_mm)
        self._axes = axes
        self._length_mm = options.segment_length_mm
        self._chambers = [
            chamber_model(options, segment, bore_mm2[CHAMBERS * segment : CHAMBERS * (segment + 1)])
            for segment in range(2)
        ]
        self._shape_by_length = [
            _shape_by_length(options, first) for first in options.first_chamber_rad
        ]
        self._elongation_gain = options.elongation_gain
        self.tolerance_mm = options.tolerance_mm

    def tip(self, u: Vector) -> tuple[Vector, Vector]:
        """(3,) tip in mm and (3, 6) its derivative at (6,) piston positions."""
        near, near_by_u = self._shape(0, u[:CHAMBERS])
        far, far_by_u = self._shape(1, u[CHAMBERS:])
        end, turn = arc(near)
        beyond, _ = arc(far)
        by_near = arc_end_by_shape(near)
        by_near[:, :2] += arc_carries_by_bending(near, beyond)
        by_far = turn @ arc_end_by_shape(far)
        jacobian = np.hstack([by_near @ near_by_u, by_far @ far_by_u])
        return self._base + end + turn @ beyond, jacobian

    def reach(self, position_mm: Vector, near_u: Vector | None) -> tuple[Vector, float]:
        """(6,) pistons within their travel that bring the tip nearest, and the miss in mm."""
        axes = self._axes
        middle = 0.5 * (axes.lowest + axes.highest)
        u = middle.copy() if near_u is None else np.clip(near_u, axes.lowest, axes.highest)
        best, best_mm = u, np.inf
        longest = np.full(axes.count, _LONGEST_SEARCH_STEP)
        for _ in range(_SEARCH_STEPS):
            tip, jacobian = self.tip(u)
            missing = position_mm - tip
            miss_mm = float(np.linalg.norm(missing))
            nearer_mm = best_mm - miss_mm
            if nearer_mm > 0.0:
                best, best_mm = u, miss_mm
            if miss_mm <= _FOUND_MM or nearer_mm < _NO_PROGRESS_MM:
                break
            step = axes.travel * bounded_step(
                jacobian * axes.travel,
                missing,
                np.zeros(axes.count),
                np.maximum((axes.lowest - u) / axes.travel, -longest),
                np.minimum((axes.highest - u) / axes.travel, longest),
                _SEARCH_DAMPING_MM,
            )
            u = u + step
        return best, best_mm

    def _shape(self, segment: int, pistons_mm: Vector) -> tuple[Vector, Vector]:
        lengths, by_piston = self._chambers[segment].lengths(pistons_mm)
        by_length = self._shape_by_length[segment]
        shape = by_length @ lengths
        shape[2] += (1.0 - self._elongation_gain) * self._length_mm[segment]
        return shape, by_length @ by_piston


def _shape_by_length(options: ConstantCurvature, first_rad: float) -> Vector:
    """(3, 3) from chamber lengths to (b_x, b_y, s): a segment leans away from its long chambers.

    Without what elongation_gain adds to the length at rest.
    """
    angles = first_rad + 2.0 * np.pi / 3.0 * np.arange(CHAMBERS)
    lean = -2.0 / 3.0 / options.chamber_radius_mm * options.bending_gain
    return np.stack(
        [
            lean * np.cos(angles),
            lean * np.sin(angles),
            np.full(CHAMBERS, options.elongation_gain / CHAMBERS),
        ]
    )
