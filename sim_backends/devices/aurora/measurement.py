"""From a sensor's true pose to what the tracker says: distortion, jitter, outliers, the volume."""

from collections.abc import Sequence
from math import hypot
from typing import NamedTuple

import numpy as np

from config.emulated_tracker import EmulatedTool, EmulatedTracker
from drivers.aurora.status_bits import PortStatus
from drivers.pose import Pose, Quaternion, Vector, product, rotate, turned
from sim_backends.devices.aurora.distortion import SmoothField, in_volume

_COIL_MM = (0.0, 0.0, 4.5)
"""A sensor with 6 degrees of freedom has two coils along its axis, z: here and opposite."""
_NEAR_MM = 300.0
_FAST_MODE_NOISE = 2.0
_AT_ONCE = 64
"""Readings whose random numbers are drawn together: one by one they take longer than the rest."""
_INDICATOR = 0.05
_NO_FLAGS = PortStatus(0)
_AXIS = np.array([0.0, 0.0, 1.0])


Triple = tuple[float, float, float]


class Measured(NamedTuple):
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
        self._distorted: dict[str, tuple[Pose, Triple, Triple]] = {}
        """By serial number, the last true pose: what stands still is not worked out again."""
        self._drawn: list[tuple[list[float], list[float]]] = []
        """Of the next readings: six of a normal distribution, and two from 0 to 1."""

    def measure(self, tool: EmulatedTool, true: Pose, period_s: float, fast: bool) -> Measured:
        """One reading of a sensor whose true pose is given in the field generator's frame."""
        place, orientation = true.position_mm.tolist(), true.quaternion.tolist()
        (m0, m1, m2, r0, r1, r2), (chance, fit) = self._draw()
        spread = self._spread(place, fast)
        by_mm, by_rad = self._config.jitter_mm * spread, self._config.jitter_rad * spread
        shift, turn = self._distortion(tool.serial, true)
        position_mm = np.array(
            [
                place[0] + shift[0] + by_mm * m0,
                place[1] + shift[1] + by_mm * m1,
                place[2] + shift[2] + by_mm * m2,
            ]
        )
        error = _turned_by(turn[0] + by_rad * r0, turn[1] + by_rad * r1, turn[2] + by_rad * r2)
        quaternion = np.array(product(error, orientation))
        if chance < self._config.outliers_per_s * period_s:
            position_mm += self._outlier_mm()
        flags = _outside(tool, place, orientation)
        if tool.degrees_of_freedom == 5:
            return Measured(Pose(position_mm, _without_roll(quaternion)), flags)
        return Measured(Pose(position_mm, quaternion), flags, _INDICATOR * (0.5 + fit))

    def _distortion(self, serial: str, true: Pose) -> tuple[Triple, Triple]:
        """By how many mm, and by what rotation in rad, the field is wrong at a sensor."""
        last = self._distorted.get(serial)
        if last is None or last[0] is not true:
            place = true.position_mm.tolist()
            fields = self._displacement.at_point(*place), self._turn.at_point(*place)
            last = self._distorted[serial] = (true, *fields)
        return last[1], last[2]

    def _draw(self) -> tuple[list[float], list[float]]:
        if not self._drawn:
            normal = self._random.normal(size=(_AT_ONCE, 6)).tolist()
            even = self._random.random((_AT_ONCE, 2)).tolist()
            self._drawn = list(zip(normal, even, strict=True))
        return self._drawn.pop()

    def _spread(self, place_mm: Sequence[float], fast: bool) -> float:
        distance = hypot(*place_mm) / _NEAR_MM
        return (0.5 + 0.5 * distance**2) * (_FAST_MODE_NOISE if fast else 1.0)

    def _outlier_mm(self) -> Vector:
        low_mm, high_mm = self._config.outlier_mm
        direction = self._random.normal(size=3)
        length_mm = low_mm * (high_mm / low_mm) ** self._random.random()
        return np.asarray(length_mm * direction / np.linalg.norm(direction))


def _outside(
    tool: EmulatedTool, place_mm: Sequence[float], orientation: Sequence[float]
) -> PortStatus:
    x, y, z = place_mm
    if tool.degrees_of_freedom == 5:
        return _NO_FLAGS if in_volume(x, y, z) else PortStatus.OUT_OF_VOLUME
    u, v, w = turned(orientation, _COIL_MM)
    one, other = in_volume(x + u, y + v, z + w), in_volume(x - u, y - v, z - w)
    if one and other:
        return _NO_FLAGS
    return PortStatus.PARTIALLY_OUT_OF_VOLUME if one or other else PortStatus.OUT_OF_VOLUME


def _turned_by(x: float, y: float, z: float) -> Quaternion:
    """The unit quaternion of a small rotation vector in rad."""
    x, y, z = 0.5 * x, 0.5 * y, 0.5 * z
    norm = hypot(1.0, x, y, z)
    return 1.0 / norm, x / norm, y / norm, z / norm


def _without_roll(q: Vector) -> Vector:
    """The shortest rotation that takes z to where q takes it: one coil cannot tell its roll."""
    z = rotate(q, _AXIS)
    shortest = np.array([1.0 + z[2], -z[1], z[0], 0.0])
    length = float(np.linalg.norm(shortest))
    return np.array([0.0, 1.0, 0.0, 0.0]) if length < 1e-9 else np.asarray(shortest / length)
