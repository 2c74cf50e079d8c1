"""Random paths on random tendon arms that have explored themselves: all are followed, none is held.

`python -m tests.experiments.led_tendons`. Every case is an arm of other stiffness, mass, tendons,
friction and play than the one that was made, some with a dead time, strung more loosely or tightly;
every other two have three tendons, and not four. It explores itself, and follows a path about as
high as such an arm reaches, at 5 to 25 mm/s, with or without a load. Verdicts are those of
`led_bodies`. Of the error most is height: an arm of tendons reaches about one at a radius, and no
path keeps to it.
"""

import sys
from math import cos, hypot, sin
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.optimize import brentq

from tests import SHIPPED_ROBOTS
from tests.experiments.led_bodies import LASTS_S, came_of, carry_out_all
from tests.experiments.led_paths import path_of, scaled

TENDON_ARM: Final = SHIPPED_ROBOTS.parent / "experiments" / "bench_tendon_arm.yaml"
_SAG_MM: Final = 0.5
"""By which an arm is lower than an arc of its length is."""


class _Arm(NamedTuple):
    """A shipped robot, and what its bodies are about."""

    robot: str
    length_mm: float
    bending_n_mm2: float
    torsion_n_mm2: float
    mass_g: tuple[float, float]
    pretension_n: tuple[float, float]


_ARMS: Final = (
    _Arm("tendon_arm", 200.0, 5.79e3, 4.45e3, (20.0, 60.0), (1.2, 3.0)),
    _Arm("three_tendon_arm", 150.0, 4393.0, 3379.0, (12.0, 40.0), (1.5, 5.0)),
)


def case_of(number: int) -> dict[str, Any]:
    """What the experiment's file is changed by. The same number gives the same case."""
    random, arm = np.random.default_rng([number, 991]), _ARMS[number // 2 % 2]
    speed_mm_s = float(np.exp(random.uniform(np.log(5.0), np.log(25.0))))
    path, length_mm = path_of(random)
    size = arm.length_mm / _ARMS[0].length_mm
    path |= scaled(path, size)
    center_mm = (size * random.uniform(-10.0, 10.0, 2)).tolist()
    path["center_mm"] = [*center_mm, _height_mm(arm, hypot(_about_mm(path), *center_mm))]
    for high in {"amplitude_mm", "size_mm"} & path.keys():
        path[high][2] = 0.0
    if "rise_mm" in path:
        path["rise_mm"] = _SAG_MM
    cycle_s = size * length_mm / speed_mm_s
    return {
        "robot": f"builtin:{arm.robot}",
        "plant": _random_plant(random, arm),
        "trajectory": {**path, "cycle_s": cycle_s, "cycles": max(2, round(LASTS_S / cycle_s))},
        "controller": {
            "kind": "reward_weighted",
            "lead": True,
            "max_tip_speed_mm_s": 80.0,
            "slow_above_mm": (1.0, None)[number % 2],
        },
        "tip_load_g": random.choice([0.0, 0.0, 14.2, 30.0]),
        "longest_s": 900.0,
    }


def _random_plant(random: np.random.Generator, arm: _Arm) -> dict[str, Any]:
    uniform, stiffer = random.uniform, random.uniform(0.75, 1.3)
    return {
        "mass_g": uniform(*arm.mass_g),
        "bending_stiffness_n_mm2": arm.bending_n_mm2 * stiffer,
        "torsion_stiffness_n_mm2": arm.torsion_n_mm2 * stiffer,
        "tendon_stiffness_n": uniform(1.5e3, 4.0e3),
        "drive_stiffness_n_mm": uniform(4.0, 10.0),
        "pretension_n": uniform(*arm.pretension_n),
        "friction": uniform(0.05, 0.35),
        "backlash_mm": uniform(0.0, 0.25),
        "dead_time_s": float(random.integers(2) * uniform(0.0, 0.25)),
    }


def _about_mm(path: dict[str, Any]) -> float:
    """How far a path is from its middle, about."""
    radius_mm = path.get("radius_mm", 15.0)
    if path["kind"] == "star":
        return float(0.5 * (radius_mm + path["inner_radius_mm"]))
    if path["kind"] == "rectangle":
        return 0.6 * hypot(path["width_mm"], path["height_mm"])
    return float(radius_mm)


def _height_mm(arm: _Arm, aside_mm: float) -> float:
    """Where the tip of an arm is that bends in an arc, and so far aside."""
    length_mm = arm.length_mm
    turn_rad: float = brentq(lambda rad: length_mm * (1.0 - cos(rad)) / rad - aside_mm, 1e-6, 2.0)
    return length_mm * sin(turn_rad) / turn_rad - _SAG_MM


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    case = case_of(number)
    plant = {name: case["plant"][name] for name in ("pretension_n", "friction", "dead_time_s")}
    what = {name: case[name] for name in ("robot", "tip_load_g")}
    short = {"path": case["trajectory"]["kind"], **what, **plant}
    return {"case": number, **short, **came_of(TENDON_ARM, case, number)}


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 100)


if __name__ == "__main__":
    sys.exit(main())
