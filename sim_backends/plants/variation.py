"""Plants that differ as one built arm differs from the next."""

import numpy as np

from config.emulated_plants import SoftArmPlant

_STIFFNESS = 0.10
_CHAMBER = 0.04
_MASS = 0.03
_HYSTERESIS = 0.15
_TIME = 0.15
_PRE_PRESSURE = 0.05
_ROTATION_RAD = 0.05


def variation(plant: SoftArmPlant, seed: int) -> SoftArmPlant:
    """Another arm of the same design; the same seed gives the same arm.

    Every figure is even-handedly better or worse, uniform within its bounds: stiffness ±10 % (one
    batch of silicone, so bending and axial alike), each chamber's area ±4 % by itself, mass ±3 %,
    pre-pressure ±5 %, hysteresis, creep and time constants ±15 %, the joint's angle ±0.05 rad.
    """
    generator = np.random.default_rng(seed)

    def about(value: float, share: float) -> float:
        return value * float(generator.uniform(1.0 - share, 1.0 + share))

    stiffer = about(1.0, _STIFFNESS)
    return plant.model_validate(
        {
            **plant.model_dump(),
            "bending_stiffness_n_mm2": plant.bending_stiffness_n_mm2 * stiffer,
            "axial_stiffness_n": plant.axial_stiffness_n * stiffer,
            "chamber_area_ratios": tuple(about(r, _CHAMBER) for r in plant.chamber_area_ratios),
            "mass_g": about(plant.mass_g, _MASS),
            "pre_pressure_mpa": about(plant.pre_pressure_mpa, _PRE_PRESSURE),
            "hysteresis": min(0.5, about(plant.hysteresis, _HYSTERESIS)),
            "creep": min(0.3, about(plant.creep, _HYSTERESIS)),
            "creep_time_s": about(plant.creep_time_s, _TIME),
            "pneumatic_lag_s": about(plant.pneumatic_lag_s, _TIME),
            "distal_rotation_rad": plant.distal_rotation_rad
            + float(generator.uniform(-_ROTATION_RAD, _ROTATION_RAD)),
        }
    )
