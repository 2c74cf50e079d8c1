"""Named bodies: what years, other hardware or another mould make of an arm.

A controller whose model was learnt on one body meets another. Naming a body sets every figure that
distinguishes bodies, those of the arm as it was designed (`as_made`) included; all others stay as
they are. Where no source is named a figure is judged.
"""

from collections.abc import Mapping
from typing import Any, Final, Literal, get_args

BodyName = Literal["as_made", "worn", "slow", "heavy", "mismatched"]

_SOFT_ARM: Final[dict[str, Any]] = {
    "mass_g": 41.7,
    "bending_stiffness_n_mm2": 8.0e3,
    "axial_stiffness_n": 130.0,
    "chamber_area_ratios": (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    "hysteresis": 0.15,
    "creep": 0.05,
    "pneumatic_lag_s": 0.1,
    "dead_time_s": 0.0,
    "backlash_mm": 0.0,
    "leak_per_hour": 0.0,
    "ageing": 0.0,
}
"""As `SoftArmPlant` derives it from Ho 2018 and the silicone's data sheet."""

_TENDON_ARM: Final[dict[str, Any]] = {
    "mass_g": 30.0,
    "bending_stiffness_n_mm2": 5.79e3,
    "torsion_stiffness_n_mm2": 4.45e3,
    "tendon_stiffness_n": 3.0e3,
    "drive_stiffness_n_mm": 8.0,
    "pretension_n": 2.0,
    "friction": 0.15,
    "backlash_mm": 0.1,
    "dead_time_s": 0.0,
}
"""As `TendonArmPlant` has it from its laboratory's robot files."""

_BODIES: Final[Mapping[str, Mapping[str, dict[str, Any]]]] = {
    "soft_arm": {
        "as_made": {},
        "worn": {
            # Filled silicones lose 10 to 20 % of their stiffness to the first stretches (Mullins'
            # effect), and then slowly more. A trapezoidal nut without preload has 0.1 to 0.3 mm of
            # play when it is worn, which is twice of what stands here. Push-fit fittings and
            # O-rings leak some per cent of the excess in an hour.
            "bending_stiffness_n_mm2": 6.8e3,
            "axial_stiffness_n": 110.0,
            "hysteresis": 0.3,
            "creep": 0.15,
            "backlash_mm": 0.12,
            "leak_per_hour": 0.1,
            "ageing": 0.08,
        },
        "slow": {
            # Long, thin lines: their resistance times the chamber's capacity makes the lag, which
            # goes as length over the fourth power of the diameter: 3 m instead of 0.6 m make five
            # times of it. Valves and the fieldbus before them add the dead time; fibre
            # with more friction makes the hysteresis.
            "pneumatic_lag_s": 0.5,
            "dead_time_s": 0.25,
            "backlash_mm": 0.15,
            "hysteresis": 0.4,
            "creep": 0.2,
        },
        "heavy": {
            # A gripper and its lead within the body: half as heavy again. The weight alone takes
            # a quarter of the stiffness that holds the arm up (see Euler and Greenhill).
            "mass_g": 62.0,
            "hysteresis": 0.2,
            "creep": 0.1,
        },
        "mismatched": {
            # Cores that were not round, or sat badly in the mould: chambers of 11 mm are off by up
            # to 1 mm, which makes ±20 % of their areas.
            "chamber_area_ratios": (1.2, 0.85, 1.05, 0.8, 1.1, 0.95),
            "hysteresis": 0.2,
            "creep": 0.1,
        },
    },
    "tendon_arm": {
        "as_made": {},
        "worn": {
            # Braided fibre loses a third of its stiffness and half of its pretension to creep;
            # grooves in the holes double the friction (Euler and Eytelwein's coefficient of a dry
            # polymer cord on plastic is 0.15 to 0.35).
            "tendon_stiffness_n": 2.0e3,
            "pretension_n": 1.2,
            "friction": 0.3,
            "backlash_mm": 0.25,
        },
        "slow": {"dead_time_s": 0.2, "drive_stiffness_n_mm": 4.0, "backlash_mm": 0.2},
        "heavy": {"mass_g": 60.0},
        "mismatched": {
            # The printed body's modulus is known to a third.
            "bending_stiffness_n_mm2": 7.2e3,
            "torsion_stiffness_n_mm2": 5.5e3,
            "friction": 0.2,
        },
    },
}

BODY_NAMES: Final = get_args(BodyName)


def body_figures(kind: object, name: object) -> dict[str, Any]:
    """What a body of that name has, by the plant's keys. Empty where kind or name is unknown."""
    design = {"soft_arm": _SOFT_ARM, "tendon_arm": _TENDON_ARM}.get(str(kind))
    figures = _BODIES.get(str(kind), {}).get(str(name))
    return {} if design is None or figures is None else {**design, **figures}


def with_body(given: object) -> object:
    """A plant's mapping, with the figures of the body that it names under those it gives."""
    if not isinstance(given, Mapping) or "body" not in given:
        return given
    return {**body_figures(given.get("kind"), given["body"]), **given}
