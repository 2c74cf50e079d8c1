"""Random paths on random bodies that have explored themselves: all are followed, none swings up.

`python -m tests.experiments.led_paths`. Every case is a soft arm that nobody knows, with lags of
0.05 to 1 s, which explores its travel as an arm in a laboratory would, and then follows a path of
any kind: off centre, of any size that fits, at 5 to 25 mm/s, with or without a load. Every other
one keeps the path's time. As in `led_bodies`, a case is unstable where the tip is far from its path
at the end; failed where it never came to its end.
"""

import sys
from typing import Any, Final

import numpy as np

from tests import SHIPPED_ROBOTS
from tests.experiments.led_bodies import LASTS_S, came_of, carry_out_all, random_plant

SOFT_ARM: Final = SHIPPED_ROBOTS.parent / "experiments" / "bench_soft_arm.yaml"
_KINDS: Final = ("circle", "rectangle", "star", "lissajous", "helix", "random_smooth")
_SIZES: Final = {"radius_mm", "inner_radius_mm", "width_mm", "height_mm", "amplitude_mm", "size_mm"}


def case_of(number: int) -> dict[str, Any]:
    """What the experiment's file is changed by. The same number gives the same case."""
    random = np.random.default_rng([number, 77])
    uniform = random.uniform
    speed_mm_s = float(np.exp(uniform(np.log(5.0), np.log(25.0))))
    path, length_mm = path_of(random)
    cycle_s = length_mm / speed_mm_s
    cycles = max(2, round(LASTS_S / cycle_s))
    stiffer, lag_s = uniform(0.8, 1.25), float(np.exp(uniform(np.log(0.05), np.log(0.8))))
    return {
        "plant": random_plant(random, stiffer, lag_s),
        "trajectory": {**path, "cycle_s": cycle_s, "cycles": cycles},
        "controller": {"lead": True, "slow_above_mm": (1.0, None)[number % 2]},
        "risk": False,
        "tip_load_g": random.choice([0.0, 0.0, 14.2, 30.0]),
        "longest_s": 900.0,
    }


def path_of(random: np.random.Generator) -> tuple[dict[str, Any], float]:
    """A trajectory without its time, and about how long a round of it is, mm."""
    uniform, kind = random.uniform, str(random.choice(_KINDS))
    radius_mm, other_mm, high_mm = uniform(8.0, 28.0), uniform(8.0, 25.0), uniform(0.0, 5.0)
    center_mm = [*uniform(-12.0, 12.0, 2).tolist(), uniform(178.0, 194.0)]
    middle: dict[str, Any] = {"kind": kind, "center_mm": center_mm}
    round_mm = 2.0 * np.pi * radius_mm
    if kind == "rectangle":
        sides = {"width_mm": 2.0 * radius_mm, "height_mm": 2.0 * other_mm}
        return {**middle, **sides}, 4.0 * (radius_mm + other_mm)
    if kind == "star":
        points, inner_mm = int(random.integers(4, 8)), uniform(0.3, 0.7) * radius_mm
        side = np.hypot(
            radius_mm - inner_mm * np.cos(np.pi / points), inner_mm * np.sin(np.pi / points)
        )
        radii: dict[str, Any] = {"radius_mm": radius_mm, "inner_radius_mm": inner_mm}
        return {**middle, **radii, "points": points}, 2.0 * points * float(side)
    if kind == "lissajous":
        one, two = random.choice([(1, 2), (2, 1), (2, 3), (1, 1)]).tolist()
        about = {"amplitude_mm": [radius_mm, other_mm, high_mm], "frequencies": [one, two, 0]}
        return {**middle, **about}, 4.0 * (one * radius_mm + two * other_mm)
    if kind == "helix":
        turns = uniform(1.0, 3.0)
        coil = {"radius_mm": radius_mm, "rise_mm": high_mm, "turns": turns}
        return {**middle, **coil}, 2.0 * turns * round_mm
    if kind == "random_smooth":
        size = {"size_mm": [2.0 * radius_mm, 2.0 * other_mm, high_mm]}
        bends = {"harmonics": int(random.integers(2, 6)), "seed": int(random.integers(100))}
        length_mm = 12.0 * float(np.hypot(radius_mm, other_mm))
        return {**middle, **size, **bends}, length_mm
    return {**middle, "radius_mm": radius_mm}, round_mm


def scaled(path: dict[str, Any], size: float) -> dict[str, Any]:
    """What of a trajectory lies across the arm, so many times as large."""
    return {name: _times(size, path[name]) for name in _SIZES & path.keys()}


def _times(size: float, value: Any) -> Any:
    return [size * one for one in value] if isinstance(value, list) else size * value


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    case = case_of(number)
    plant = {name: case["plant"][name] for name in ("pneumatic_lag_s", "dead_time_s")}
    short = {"path": case["trajectory"]["kind"], "tip_load_g": case["tip_load_g"], **plant}
    return {"case": number, **short, **came_of(SOFT_ARM, case, number)}


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 100)


if __name__ == "__main__":
    sys.exit(main())
