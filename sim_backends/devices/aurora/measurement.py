"""From a sensor's true pose to what the tracker says: distortion, jitter, outliers, the volume."""

import itertools
from math import hypot, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from config.emulation.lab import EmulatedTool, EmulatedTracker
from drivers.aurora.codec.status_bits import PortStatus
from drivers.pose import PlainPose, Position, Quaternion, product, turned

# The smooth, fixed error of the field: what the maker's accuracy figures are mostly made of.


Vector = NDArray[np.float64]

_CENTRE_X, _CENTRE_Y, _CENTRE_Z = 0.0, 0.0, -300.0
CENTRE_MM = np.array([_CENTRE_X, _CENTRE_Y, _CENTRE_Z])
HALF_WIDTH_MM = 250.0
"""The measurement volume is a cube: x and y within 250 mm, z from -550 to -50 mm."""

_MODES = 6
_SHORTEST_WAVE_MM = 450.0
_LONGEST_WAVE_MM = 1200.0
_AT_CENTRE = 0.3
_MOST_OUTWARDS = 3.0
_CELLS = 9


def in_volume(x: float, y: float, z: float) -> bool:
    """Whether a point is in the measurement volume."""
    return (
        abs(x - _CENTRE_X) <= HALF_WIDTH_MM
        and abs(y - _CENTRE_Y) <= HALF_WIDTH_MM
        and abs(z - _CENTRE_Z) <= HALF_WIDTH_MM
    )


class SmoothField:
    """A vector field of a few long waves that grows towards the edge of the volume."""

    def __init__(self, rms: float, random: np.random.Generator) -> None:
        """rms: root mean square of the field's length over the volume."""
        directions = random.normal(size=(_MODES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        lengths_mm = random.uniform(_SHORTEST_WAVE_MM, _LONGEST_WAVE_MM, size=(_MODES, 1))
        self._waves = 2.0 * np.pi * directions / lengths_mm
        self._phases = random.uniform(0.0, 2.0 * np.pi, size=_MODES)
        self._amplitudes = random.normal(size=(_MODES, 3))
        middles = HALF_WIDTH_MM * ((2.0 * np.arange(_CELLS) + 1.0) / _CELLS - 1.0)
        cells = self.at(CENTRE_MM + np.array(list(itertools.product(middles, repeat=3))))
        self._amplitudes *= rms / np.sqrt(np.mean(np.sum(np.square(cells), axis=1)))
        # Wave vector, phase and amplitude of each wave, for one point at a time.
        self._modes: list[list[float]] = np.column_stack(
            [self._waves, self._phases, self._amplitudes]
        ).tolist()

    def at(self, position_mm: Vector) -> Vector:
        """The field at some points. position_mm: (..., 3); returns (..., 3)."""
        offset = position_mm - CENTRE_MM
        outwards = np.minimum(
            np.square(offset).sum(axis=-1, keepdims=True) / HALF_WIDTH_MM**2, _MOST_OUTWARDS
        )
        waves = np.sin(offset @ self._waves.T + self._phases)
        return np.asarray((_AT_CENTRE + outwards) * (waves @ self._amplitudes))

    def at_point(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """The same at one point, without arrays: every frame asks for it."""
        x, y, z = x - _CENTRE_X, y - _CENTRE_Y, z - _CENTRE_Z
        share = _AT_CENTRE + min((x * x + y * y + z * z) / HALF_WIDTH_MM**2, _MOST_OUTWARDS)
        u = v = w = 0.0
        for by_x, by_y, by_z, phase, along_x, along_y, along_z in self._modes:
            wave = sin(by_x * x + by_y * y + by_z * z + phase)
            u += wave * along_x
            v += wave * along_y
            w += wave * along_z
        return share * u, share * v, share * w


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
