"""Random paths with concentric tubes that are made otherwise: all are followed, none is held.

`python -m tests.experiments.led_tubes`. Every case is a set of tubes with other curvatures (up to
6 % off), stiffnesses (5 %) and friction than those that are meant, and a path on any side of them,
at 1.5 to 8 mm/s, followed by one of three controllers: the kinematics that was learnt from the
statics and goes on learning, reward-weighted local ones that know nothing but their first motions,
and `broyden`. Verdicts are those of `led_bodies`.
"""

import sys
from typing import Any, Final

import numpy as np

from config.emulation.plants import ConcentricTubesPlant, Tube
from config.loader import load_robot
from tests import SHIPPED_ROBOTS
from tests.experiments.led_bodies import came_of, carry_out_all
from tests.experiments.led_paths import path_of, scaled

CTR_CIRCLE: Final = SHIPPED_ROBOTS.parent / "experiments" / "ctr_circle.yaml"
_LASTS_S: Final = 40.0
_SMALLER: Final = 0.65
"""Than paths of soft arms: 5 to 18 mm to either side."""
_CURVATURE, _STIFFNESS = 0.06, 0.05
"""How far a tube may be off, as in models of their risk."""
_CONTROLLERS: Final[tuple[dict[str, Any], ...]] = (
    {
        "kind": "learned_kinematics",
        "model": "builtin:concentric_tubes_pose.npz",
        "damping_mm": 2.0,
    },
    {"kind": "reward_weighted", "lead": True, "slow_above_mm": 1.0},
    {"kind": "broyden"},
)


def case_of(number: int) -> dict[str, Any]:
    """What the experiment's file is changed by. The same number gives the same case."""
    random = np.random.default_rng([number, 555])
    uniform = random.uniform
    speed_mm_s = float(np.exp(uniform(np.log(1.5), np.log(8.0))))
    path, length_mm = path_of(random)
    aside_mm, turned_rad = uniform(26.0, 46.0), uniform(-np.pi, np.pi)
    place = [aside_mm * np.cos(turned_rad), aside_mm * np.sin(turned_rad), uniform(172.0, 184.0)]
    path |= scaled(path, _SMALLER) | {"center_mm": place, "pointing": None}
    cycle_s = _SMALLER * length_mm / speed_mm_s
    cycles = max(2, round(_LASTS_S / cycle_s))
    return {
        "plant": {
            "tubes": [_made_otherwise(tube, random) for tube in _tubes()],
            "friction_nmm": uniform(0.0, 3.0),
        },
        "trajectory": {**path, "cycle_s": cycle_s, "cycles": cycles},
        "controller": _CONTROLLERS[number % len(_CONTROLLERS)],
        "longest_s": 1500.0,
    }


def _tubes() -> tuple[Tube, ...]:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    assert robot.emulation is not None
    plant = robot.emulation.plant
    assert isinstance(plant, ConcentricTubesPlant)
    return plant.tubes


def _made_otherwise(tube: Tube, random: np.random.Generator) -> dict[str, Any]:
    told = tube.model_dump(mode="json")
    for name in ("bending_stiffness_n_mm2", "torsion_stiffness_n_mm2"):
        told[name] *= random.uniform(1.0 - _STIFFNESS, 1.0 + _STIFFNESS)
    for section in told["sections"]:
        section["curvature_per_mm"] *= random.uniform(1.0 - _CURVATURE, 1.0 + _CURVATURE)
    return told


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    case = case_of(number)
    what = {"path": case["trajectory"]["kind"], "kind": case["controller"]["kind"]}
    return {"case": number, **what, **came_of(CTR_CIRCLE, case, number)}


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 60)


if __name__ == "__main__":
    sys.exit(main())
