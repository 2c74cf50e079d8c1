"""From a sensor's true pose to what the tracker says: distortion, jitter, outliers, the volume."""

from dataclasses import dataclass

import numpy as np

from config.emulated_tracker import EmulatedTool, EmulatedTracker
from drivers.aurora.status_bits import PortStatus
from drivers.pose import Pose, Vector, multiply, rotate
from sim_backends.devices.aurora.distortion import SmoothField, in_volume

_COILS_MM = np.array([[0.0, 0.0, -4.5], [0.0, 0.0, 4.5]])
"""A sensor with 6 degrees of freedom has two coils along its axis, z."""
_NEAR_MM = 300.0
_FAST_MODE_NOISE = 2.0
_INDICATOR = 0.05
_NO_FLAGS = PortStatus(0)
_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Measured:
    """What was measured of one sensor in one frame."""

    pose: Pose | None
    """In the field generator's frame; None where nothing can be told."""
    flags: PortStatus = _NO_FLAGS
    """Out of volume, and faults of the sensor."""
    indicator: float = 0.0


class Sensing:
    """The errors of one tracker: the fixed ones belong to it, the random ones come frame by frame.

    Its random numbers are drawn in a fixed order, so equal seeds give equal readings.
    """

    def __init__(self, config: EmulatedTracker, seed: np.random.SeedSequence) -> None:
        shape, jitter = seed.spawn(2)
        generator = np.random.default_rng(shape)
        self._config = config
        self._displacement = SmoothField(config.distortion_rms_mm, generator)
        self._turn = SmoothField(config.distortion_rms_rad, generator)
        self._random = np.random.default_rng(jitter)

    def measure(self, tool: EmulatedTool, true: Pose, period_s: float, fast: bool) -> Measured:
        """One reading of a sensor whose true pose is given in the field generator's frame."""
        noise = self._random.normal(size=6) * self._spread(true.position_mm, fast)
        chance, fit = self._random.random(2)
        position_mm = true.position_mm + self._displacement.at(true.position_mm)
        position_mm += self._config.jitter_mm * noise[:3]
        turn = self._turn.at(true.position_mm) + self._config.jitter_rad * noise[3:]
        quaternion = multiply(_turned_by(turn), true.quaternion)
        if chance < self._config.outliers_per_s * period_s:
            position_mm += self._outlier_mm()
        if tool.degrees_of_freedom == 5:
            return Measured(Pose(position_mm, _without_roll(quaternion)), _outside(tool, true))
        indicator = _INDICATOR * (0.5 + fit)
        return Measured(Pose(position_mm, quaternion), _outside(tool, true), indicator)

    def _spread(self, position_mm: Vector, fast: bool) -> float:
        distance = float(np.linalg.norm(position_mm)) / _NEAR_MM
        return (0.5 + 0.5 * distance**2) * (_FAST_MODE_NOISE if fast else 1.0)

    def _outlier_mm(self) -> Vector:
        low_mm, high_mm = self._config.outlier_mm
        direction = self._random.normal(size=3)
        length_mm = low_mm * (high_mm / low_mm) ** self._random.random()
        return np.asarray(length_mm * direction / np.linalg.norm(direction))


def _outside(tool: EmulatedTool, true: Pose) -> PortStatus:
    offsets = _COILS_MM if tool.degrees_of_freedom == 6 else np.zeros((1, 3))
    inside = [in_volume(true.position_mm + rotate(true.quaternion, o)) for o in offsets]
    if all(inside):
        return _NO_FLAGS
    return PortStatus.PARTIALLY_OUT_OF_VOLUME if any(inside) else PortStatus.OUT_OF_VOLUME


def _turned_by(rotation: Vector) -> Vector:
    """The unit quaternion of a small rotation vector in rad. rotation: (3,)."""
    q = np.concatenate(([1.0], 0.5 * rotation))
    return np.asarray(q / np.linalg.norm(q))


def _without_roll(q: Vector) -> Vector:
    """The shortest rotation that takes z to where q takes it: one coil cannot tell its roll."""
    z = rotate(q, _AXIS)
    shortest = np.array([1.0 + z[2], -z[1], z[0], 0.0])
    length = float(np.linalg.norm(shortest))
    return np.array([0.0, 1.0, 0.0, 0.0]) if length < 1e-9 else np.asarray(shortest / length)
