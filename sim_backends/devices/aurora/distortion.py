"""The smooth, fixed error of the field: what the maker's accuracy figures are mostly made of."""

from itertools import product
from math import sin

import numpy as np
from numpy.typing import NDArray

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
        cells = self.at(CENTRE_MM + np.array(list(product(middles, repeat=3))))
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
