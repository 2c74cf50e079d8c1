"""What of a body can be seen: a tube along its centreline, and disks on it."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from config.emulation.plants import Plant, TendonArmPlant

FloatArray = NDArray[np.float64]

_DISK_THICKNESS_MM = 3.0
_RIM_MM = 2.0
"""Of a disk, outside of its tendons."""


@dataclass(frozen=True)
class BodySurface:
    """disks: evenly spaced along the body, the last one at its tip; none: 0."""

    tube_radius_mm: float
    disks: int = 0
    disk_radius_mm: float = 0.0
    disk_thickness_mm: float = _DISK_THICKNESS_MM

    @classmethod
    def of(cls, plant: Plant) -> "BodySurface":
        """A backbone is as thick as a round rod with its stiffnesses; silicone fills the body.

        Disks reach a little farther than their tendons: not as far as what may touch.
        """
        if isinstance(plant, TendonArmPlant):
            backbone_mm = 2.0 * sqrt(plant.bending_stiffness_n_mm2 / plant.axial_stiffness_n)
            return cls(backbone_mm, plant.disks, plant.tendon_radius_mm + _RIM_MM)
        return cls(plant.body_radius_mm)


@dataclass(frozen=True, eq=False)
class PlacedSurface:
    """A surface in the base frame: balls so close to each other that they are a tube, and disks.

    balls_mm: (b, 3). disks_mm, disk_axes: (k, 3), the axes of unit length.
    """

    surface: BodySurface
    balls_mm: FloatArray
    disks_mm: FloatArray
    disk_axes: FloatArray

    @classmethod
    def along(cls, surface: BodySurface, centreline_mm: FloatArray) -> "PlacedSurface":
        """Round a smooth curve through (n, 3) nodes from base to tip."""
        chords = np.linalg.norm(np.diff(centreline_mm, axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(chords)])
        curve = CubicSpline(arc, centreline_mm)
        # At half a radius from each other the balls dent the tube by a thirtieth of it.
        count = 1 + int(np.ceil(arc[-1] / (0.5 * surface.tube_radius_mm)))
        places = arc[-1] * np.arange(1, surface.disks + 1) / max(surface.disks, 1)
        axes = curve(places, 1)
        return cls(
            surface,
            np.ascontiguousarray(curve(np.linspace(0.0, arc[-1], count))),
            np.ascontiguousarray(curve(places)),
            axes / np.linalg.norm(axes, axis=1, keepdims=True),
        )
