"""Tendon-driven arms that differ as one built arm differs from the next."""

import numpy as np

from config.emulated_plants import TendonArmPlant

_STIFFNESS = 0.10
_MASS = 0.05
_FRICTION = 0.20
_PLAY = 0.25
_DRIVE = 0.15
_PRETENSION = 0.15
_RADIUS = 0.02
_ANGLE_RAD = 0.03


def variation(plant: TendonArmPlant, seed: int) -> TendonArmPlant:
    """Another arm of the same design; the same seed gives the same arm.

    Uniform within its bounds: stiffness ±10 % (one batch, so all alike), mass ±5 %, friction ±20 %,
    play ±25 %, stiffness of the drive trains ±15 %, pretension ±15 %, the tendons' distance from
    the axis ±2 %, and the place of each by itself ±0.03 rad.
    """
    generator = np.random.default_rng(seed)

    def about(value: float, share: float) -> float:
        return value * float(generator.uniform(1.0 - share, 1.0 + share))

    stiffer = about(1.0, _STIFFNESS)
    return plant.model_validate(
        {
            **plant.model_dump(),
            "bending_stiffness_n_mm2": plant.bending_stiffness_n_mm2 * stiffer,
            "torsion_stiffness_n_mm2": plant.torsion_stiffness_n_mm2 * stiffer,
            "shear_stiffness_n": plant.shear_stiffness_n * stiffer,
            "axial_stiffness_n": plant.axial_stiffness_n * stiffer,
            "mass_g": about(plant.mass_g, _MASS),
            "friction": min(1.0, about(plant.friction, _FRICTION)),
            "backlash_mm": about(plant.backlash_mm, _PLAY),
            "drive_stiffness_n_mm": about(plant.drive_stiffness_n_mm, _DRIVE),
            "pretension_n": about(plant.pretension_n, _PRETENSION),
            "tendon_radius_mm": about(plant.tendon_radius_mm, _RADIUS),
            "tendons": tuple(
                {
                    "angle_rad": tendon.angle_rad
                    + float(generator.uniform(-_ANGLE_RAD, _ANGLE_RAD)),
                    "turns": tendon.turns,
                }
                for tendon in plant.tendons
            ),
        }
    )
