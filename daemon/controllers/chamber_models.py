"""What pistons do to the lengths of a segment's three chambers."""

from typing import Protocol

import numpy as np

from config.controllers import ConstantCurvature, GasChambers, VolumetricChambers
from drivers.pose import Vector

ATMOSPHERE_MPA = 0.101325
_NEWTON_STEPS = 12
_CONVERGED_MM = 1e-9


class ChamberModel(Protocol):
    """One segment's chambers."""

    def lengths(self, pistons_mm: Vector) -> tuple[Vector, Vector]:
        """(3,) chamber lengths in mm and (3, 3) their derivative by the pistons' positions."""
        ...


class Volumetric:
    """Length in proportion to volume."""

    def __init__(self, options: VolumetricChambers, length_mm: float, bore_mm2: Vector) -> None:
        self._length_mm = length_mm
        self._slope = options.elongation_mm_per_ml * bore_mm2 * 1e-3

    def lengths(self, pistons_mm: Vector) -> tuple[Vector, Vector]:
        return self._length_mm + self._slope * pistons_mm, np.diag(self._slope)


class EnclosedGas:
    """Isothermal gas in each chamber against a segment that resists extension and bending.

    A segment of stiffness EA and EI whose chambers (area A, at radius r) have gauge pressures p
    rests where K (ℓ − L) = A p, with K the stiffness seen along the three chambers.
    """

    def __init__(
        self, options: GasChambers, length_mm: float, radius_mm: float, bore_mm2: Vector
    ) -> None:
        self._length_mm = length_mm
        self._bore_mm2 = bore_mm2
        self._area_mm2 = options.chamber_area_mm2
        self._supply_mm3 = 1e3 * options.supply_volume_ml
        extension = options.axial_stiffness_n / (9.0 * length_mm)
        bending = options.bending_stiffness_n_mm2 * 4.0 / (9.0 * radius_mm**2 * length_mm)
        third = 2.0 * np.pi / 3.0 * np.arange(3)
        self._stiffness = extension + bending * np.cos(third[:, None] - third[None, :])
        pre_n = options.pre_pressure_mpa * self._area_mm2
        stretched = length_mm + np.linalg.solve(self._stiffness, np.full(3, pre_n))
        self._amount = (options.pre_pressure_mpa + ATMOSPHERE_MPA) * (
            self._supply_mm3 + self._area_mm2 * stretched
        )
        self._last = stretched

    def lengths(self, pistons_mm: Vector) -> tuple[Vector, Vector]:
        supply = self._supply_mm3 - self._bore_mm2 * pistons_mm
        lengths = self._last
        for _ in range(_NEWTON_STEPS):
            volume = supply + self._area_mm2 * lengths
            pressure = self._amount / volume
            push = self._area_mm2 * (pressure - ATMOSPHERE_MPA)
            yields = self._stiffness + np.diag(self._area_mm2**2 * pressure / volume)
            change = np.linalg.solve(yields, push - self._stiffness @ (lengths - self._length_mm))
            lengths = lengths + change
            if float(np.abs(change).max()) < _CONVERGED_MM:
                break
        by_piston = self._area_mm2 * pressure / volume * self._bore_mm2
        if np.isfinite(lengths).all():
            self._last = lengths
        return lengths, np.asarray(np.linalg.solve(yields, np.diag(by_piston)))


def chamber_model(options: ConstantCurvature, segment: int, bore_mm2: Vector) -> ChamberModel:
    """The model of one segment's chambers. bore_mm2: (3,) areas of its pistons."""
    length_mm = options.segment_length_mm[segment]
    match options.chambers:
        case VolumetricChambers() as volumetric:
            return Volumetric(volumetric, length_mm, bore_mm2)
        case GasChambers() as gas:
            return EnclosedGas(gas, length_mm, options.chamber_radius_mm, bore_mm2)
