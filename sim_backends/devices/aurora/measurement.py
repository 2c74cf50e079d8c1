"""From a sensor's true pose to what the tracker says: distortion, jitter, outliers, the volume."""

from math import hypot
from typing import NamedTuple

import numpy as np

from config.emulated_tracker import EmulatedTool, EmulatedTracker
from drivers.aurora.codec.status_bits import PortStatus
from drivers.pose import PlainPose, Position, Quaternion, product, turned
from sim_backends.devices.aurora.distortion import SmoothField, in_volume

_COIL_MM = (0.0, 0.0, 4.5)
"""A sensor with 6 degrees of freedom has two coils along its axis, z: here and opposite."""
_NEAR_MM = 300.0
_FAST_MODE_NOISE = 2.0
_AT_ONCE = 64
"""Readings whose random numbers are drawn together: one by one they take longer than the rest."""
_INDICATOR = 0.05
_IN_VOLUME = 0
_OUT_OF_VOLUME = PortStatus.OUT_OF_VOLUME.value
_PARTIALLY_OUT_OF_VOLUME = PortStatus.PARTIALLY_OUT_OF_VOLUME.value
_AXIS = (0.0, 0.0, 1.0)


Triple = tuple[float, float, float]


class Measured(NamedTuple):
    """What was measured of one sensor in one frame."""

    pose: PlainPose | None
    """In the field generator's frame; None where nothing can be told."""
    flags: int = _IN_VOLUME
    """Bits of a port's status: out of volume, and faults of the sensor."""
    indicator: float = 0.0


class _Sight(NamedTuple):
    """A sensor at a true pose, and what is fixed by it."""

    tool: EmulatedTool
    true: PlainPose
    shift_mm: Triple
    turn_rad: Triple
    """By what the field is wrong there."""
    spread: float
    """How much jitter there is, against that at some 300 mm."""
    flags: int


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
        self._sights: dict[str, _Sight] = {}
        """The last ones by serial number: what stands still is not worked out again."""
        self._drawn: list[tuple[list[float], list[float]]] = []
        """Of the next readings: six of a normal distribution, and two from 0 to 1."""

    def measure(self, tool: EmulatedTool, true: PlainPose, period_s: float, fast: bool) -> Measured:
        """One reading of a sensor whose true pose is given in the field generator's frame."""
        sight = self._sights.get(tool.serial)
        if sight is None or sight.true is not true or sight.tool is not tool:
            sight = self._sights[tool.serial] = self._sight(tool, true)
        _, ((x, y, z), orientation), (u, v, w), (a, b, c), spread, flags = sight
        (m0, m1, m2, r0, r1, r2), (chance, fit) = self._draw()
        config = self._config
        if fast:
            spread *= _FAST_MODE_NOISE
        by_mm, by_rad = config.jitter_mm * spread, config.jitter_rad * spread
        position_mm = (x + u + by_mm * m0, y + v + by_mm * m1, z + w + by_mm * m2)
        error = _turned_by(a + by_rad * r0, b + by_rad * r1, c + by_rad * r2)
        quaternion = product(error, orientation)
        if chance < config.outliers_per_s * period_s:
            position_mm = self._displaced(position_mm)
        if tool.degrees_of_freedom == 5:
            return Measured(PlainPose(position_mm, _without_roll(quaternion)), flags)
        return Measured(PlainPose(position_mm, quaternion), flags, _INDICATOR * (0.5 + fit))

    def _sight(self, tool: EmulatedTool, true: PlainPose) -> _Sight:
        place = true.position_mm
        return _Sight(
            tool,
            true,
            self._displacement.at_point(*place),
            self._turn.at_point(*place),
            0.5 + 0.5 * (hypot(*place) / _NEAR_MM) ** 2,
            _outside(tool, true),
        )

    def _draw(self) -> tuple[list[float], list[float]]:
        if not self._drawn:
            normal = self._random.normal(size=(_AT_ONCE, 6)).tolist()
            even = self._random.random((_AT_ONCE, 2)).tolist()
            self._drawn = list(zip(normal, even, strict=True))
        return self._drawn.pop()

    def _displaced(self, position_mm: Position) -> Position:
        """An outlier."""
        low_mm, high_mm = self._config.outlier_mm
        direction = self._random.normal(size=3)
        length_mm = low_mm * (high_mm / low_mm) ** self._random.random()
        u, v, w = (length_mm * direction / np.linalg.norm(direction)).tolist()
        x, y, z = position_mm
        return x + u, y + v, z + w


def _outside(tool: EmulatedTool, true: PlainPose) -> int:
    x, y, z = true.position_mm
    if tool.degrees_of_freedom == 5:
        return _IN_VOLUME if in_volume(x, y, z) else _OUT_OF_VOLUME
    u, v, w = turned(true.quaternion, _COIL_MM)
    one, other = in_volume(x + u, y + v, z + w), in_volume(x - u, y - v, z - w)
    if one and other:
        return _IN_VOLUME
    return _PARTIALLY_OUT_OF_VOLUME if one or other else _OUT_OF_VOLUME


def _turned_by(x: float, y: float, z: float) -> Quaternion:
    """The unit quaternion of a small rotation vector in rad."""
    x, y, z = 0.5 * x, 0.5 * y, 0.5 * z
    norm = hypot(1.0, x, y, z)
    return 1.0 / norm, x / norm, y / norm, z / norm


def _without_roll(quaternion: Quaternion) -> Quaternion:
    """The shortest rotation that takes z to where `quaternion` takes it: one coil cannot tell its
    roll."""
    x, y, z = turned(quaternion, _AXIS)
    length = float(np.linalg.norm(np.array([1.0 + z, -y, x, 0.0])))
    if length < 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    return (1.0 + z) / length, -y / length, x / length, 0.0
