"""Random designs of soft arms, not only other figures of one: all are followed, none swings up.

`python -m tests.experiments.led_designs`. Every case is an arm of one to three segments, each of
three or four chambers and of a length of its own, five times as stiff at most as the softest, with
drives of 5 to 20 mm/s, in a workspace that is much wider than it reaches. It follows a path about
its middle, as large as such an arm goes: by a model of a short exploration, by what its first
motions tell, or by `broyden`. Verdicts are those of `led_bodies`.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from tests import SHIPPED_ROBOTS
from tests.experiments.led_bodies import LASTS_S, came_of, carry_out_all
from tests.experiments.led_paths import SOFT_ARM, path_of, scaled

SHIPPED_MM: Final = 155.0
BENDING_N_MM2, _AXIAL_N, _MASS_G = 8.0e3, 130.0, 41.7
"""Of the shipped arm."""
_RISES: Final = 0.19
"""Of its length, the shipped arm with all axes in the middle of their travel."""
_LONGEST_MM: Final = 210.0
"""With its axes half out the tip of a longer arm may leave the tracker's volume."""
_LARGEST_MM: Final = 28.0
"""To either side, of the paths that are scaled."""
_OF_LENGTH: Final = 0.17
"""To either side, the paths of an arm as stiff as the shipped one: 26 mm of that."""
CONTROLLERS: Final[tuple[dict[str, Any], ...]] = (
    {
        "controller": {"kind": "reward_weighted", "lead": True},
        "pretraining": {"waypoints": None},  # but seconds of designed motions
    },
    {"controller": {"kind": "reward_weighted", "lead": True}, "pretraining": None},
    {"controller": {"kind": "broyden", "lead": True}, "pretraining": None},
)


def robot_of(random: np.random.Generator) -> dict[str, Any]:
    """A robot file's content: the shipped arm's, of another design."""
    uniform = random.uniform
    lengths_mm = uniform(40.0, 110.0, int(random.integers(1, 4)))
    lengths_mm *= min(1.0, _LONGEST_MM / lengths_mm.sum())
    length_mm = float(lengths_mm.sum())
    segments: list[dict[str, Any]] = [
        {
            "length_mm": one_mm,
            "chambers": int(random.choice([3, 4])),
            "rotation_rad": float(uniform(0.0, 2.0)),
        }
        for one_mm in lengths_mm.tolist()
    ]
    stiffer = float(np.exp(uniform(np.log(0.65), np.log(3.0))))
    robot: dict[str, Any] = yaml.safe_load((SHIPPED_ROBOTS / "soft_arm.yaml").read_text())
    speed_mm_s = float(np.exp(uniform(*np.log([5.0, 20.0]))))
    of_speed = {"max_velocity_mm_s": speed_mm_s, "following_error_mm": 0.1 * speed_mm_s}
    chamber = robot["axes"][0] | of_speed
    robot["axes"] = [
        chamber | {"name": f"chamber_{node}", "drive": chamber["drive"] | {"node": node}}
        for node in range(1, 1 + sum(one["chambers"] for one in segments))
    ]
    beside, height = [-length_mm, length_mm], [0.2 * length_mm, 1.7 * length_mm]
    robot["workspace"] = {"x_mm": beside, "y_mm": beside, "z_mm": height}
    robot["emulation"]["plant"] |= {
        "segments": segments,
        "mass_g": _MASS_G * length_mm / SHIPPED_MM,
        "bending_stiffness_n_mm2": BENDING_N_MM2 * stiffer,
        "axial_stiffness_n": _AXIAL_N * stiffer * float(uniform(0.75, 1.3)),
        "hysteresis": float(uniform(0.05, 0.3)),
        "creep": float(uniform(0.0, 0.2)),
        "pneumatic_lag_s": float(np.exp(uniform(*np.log([0.05, 0.4])))),
        "backlash_mm": float(uniform(0.0, 0.1)),
    }
    return robot


def case_of(number: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """A robot file's content, and what the experiment's file is changed by. The same number gives
    the same case."""
    random = np.random.default_rng([number, 2718])
    robot = robot_of(random)
    plant = robot["emulation"]["plant"]
    length_mm = sum(one["length_mm"] for one in plant["segments"])
    softer = BENDING_N_MM2 / plant["bending_stiffness_n_mm2"]
    size = _OF_LENGTH * length_mm * min(1.0, softer) / _LARGEST_MM
    path, round_mm = path_of(random)
    rises = _RISES * _AXIAL_N / plant["axial_stiffness_n"]
    path |= scaled(path, size) | {"center_mm": [0.0, 0.0, length_mm * (1.0 + rises)]}
    # A path of which an axis goes half as fast as it may, of an arm whose axes all bend it.
    speed_mm_s = random.uniform(0.3, 1.0) * size * robot["axes"][0]["max_velocity_mm_s"]
    cycle_s = size * round_mm / speed_mm_s
    return robot, {
        "trajectory": {**path, "cycle_s": cycle_s, "cycles": max(2, round(LASTS_S / cycle_s))},
        **CONTROLLERS[number % len(CONTROLLERS)],
        "risk": False,
        "tip_load_g": float(random.choice([0.0, 14.2])),
        "longest_s": 1500.0,
    }


def line_of(
    number: int, robot: dict[str, Any], case: dict[str, Any], more: dict[str, Any]
) -> dict[str, Any]:
    """What became of a case, as one line for the file. more: what the line says of it besides."""
    segments = robot["emulation"]["plant"]["segments"]
    known = "" if case["pretraining"] is None else ", with a model"
    what = {
        "path": case["trajectory"]["kind"],
        "kind": case["controller"]["kind"] + known,
        "chambers": [one["chambers"] for one in segments],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_text(yaml.safe_dump(robot, sort_keys=False))
        came = came_of(SOFT_ARM, {"robot": str(path), **case}, number)
    return {"case": number, **what, **more, **came}


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    return line_of(number, *case_of(number), {})


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 60)


if __name__ == "__main__":
    sys.exit(main())
