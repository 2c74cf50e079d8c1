"""Random designs of tendon arms, not only other figures of one: all are followed, none is held.

`python -m tests.experiments.led_tendon_designs`. Every case is an arm of three to eight tendons,
straight or partly wound round it, 60 to 300 mm long, whose rod, tendons, spools, motors and
pretension are of its own, hanging, standing or level. The path is one that its body reaches,
computed from that body without friction, at 5 to 20 mm/s as far as its motors are fast enough.
Verdicts are those of `led_bodies`.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from config.emulation.plants import TendonArmPlant
from drivers.pose import Vector
from sim_backends.plants.plant import GRAVITY_N_G, PlantError, TipLoad
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm
from tests import SHIPPED_ROBOTS
from tests.experiments.led_bodies import LASTS_S, came_of, carry_out_all
from tests.experiments.led_designs import CONTROLLERS
from tests.experiments.led_tendons import TENDON_ARM

_THIRDS: Final = (0.0, 2.0944, -2.0944)
_TENDONS: Final[dict[str, tuple[tuple[float, float], ...]]] = {
    "three": tuple((angle, 0.0) for angle in _THIRDS),
    "four": tuple((0.5 * np.pi * one, 0.0) for one in range(4)),
    "three and a helix": (*((angle, 0.0) for angle in _THIRDS), (0.0, -1.5)),
    "three helices": tuple((angle, 0.4) for angle in _THIRDS),
    "three and three helices": (
        *((angle, 0.0) for angle in _THIRDS),
        *((angle + 1.0472, 0.75) for angle in _THIRDS),
    ),
    "six": tuple((np.pi * one / 3.0, 0.0) for one in range(6)),
    "eight": tuple((0.25 * np.pi * one, 0.0) for one in range(8)),
}
"""Angle and turns of each."""
_HOW_IT_STANDS: Final = (((0.0, 0.0, 1.0), 2.0), ((0.0, 0.0, -1.0), 0.6), ((0.0, -1.0, 0.0), 0.6))
"""Which way is down, and how heavy it is at most: its weight times its length squared, over EI."""
_POINTS: Final = 120
_LEAST_SHARE: Final = 0.15
"""Of the pretension, in the slackest tendon along a path."""


def robot_of(random: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """What its tendons are, and a robot file's content."""
    uniform = random.uniform
    kind = str(random.choice(list(_TENDONS)))
    length_mm, rod_mm = float(uniform(60.0, 300.0)), float(uniform(0.8, 3.0))
    radius_mm = float(uniform(max(3.0, rod_mm + 1.0), 11.0))
    # So stiff that some newtons in one tendon bend it by a radian.
    bending_n = float(np.exp(uniform(*np.log([1.5, 5.0]))))
    bending = bending_n * radius_mm * length_mm
    down, heavy = _HOW_IT_STANDS[random.choice(len(_HOW_IT_STANDS), p=[0.6, 0.2, 0.2])]
    plant: dict[str, Any] = {
        "kind": "tendon_arm",
        "length_mm": length_mm,
        "mass_g": heavy * float(uniform(0.1, 1.0)) * bending / length_mm**2 / GRAVITY_N_G,
        "body_radius_mm": radius_mm + 3.0,
        "disks": int(random.integers(5, 13)),
        "tendon_radius_mm": radius_mm,
        "tendons": [{"angle_rad": float(a), "turns": turns} for a, turns in _TENDONS[kind]],
        "bending_stiffness_n_mm2": bending,
        "torsion_stiffness_n_mm2": bending / 1.3,
        "axial_stiffness_n": 4.0 * bending / rod_mm**2,
        "shear_stiffness_n": 4.0 * bending / rod_mm**2 / 2.6,
        "tendon_stiffness_n": float(np.exp(uniform(*np.log([1.5e3, 1.5e4])))),
        "drive_stiffness_n_mm": float(uniform(4.0, 20.0)),
        "pretension_n": bending_n * float(uniform(0.4, 1.2)),
        "friction": float(uniform(0.02, 0.3)),
        "backlash_mm": float(uniform(0.0, 0.15)),
        "dead_time_s": float(random.integers(2) * uniform(0.0, 0.2)),
        "gravity_direction": list(down),
    }
    robot: dict[str, Any] = yaml.safe_load((SHIPPED_ROBOTS / "tendon_arm.yaml").read_text())
    speed_mm_s = float(np.exp(uniform(*np.log([3.0, 10.0]))))
    travel_mm = radius_mm * float(uniform(1.2, 2.0))
    of_design = {
        "spool_radius_mm": float(uniform(5.0, 15.0)),
        "travel_mm": [-travel_mm, travel_mm],
        "max_tension_n": 4.0 * bending_n + 2.0 * plant["pretension_n"],
        "max_velocity_mm_s": speed_mm_s,
        "following_error_mm": 0.1 * speed_mm_s,
    }
    tendon = robot["axes"][0] | of_design
    torque_nmm = 1.5 * tendon["max_tension_n"] * tendon["spool_radius_mm"] / tendon["gear_ratio"]
    drive = tendon["drive"] | {"rated_torque_nmm": torque_nmm}
    robot["axes"] = [
        tendon | {"name": f"tendon_{node}", "drive": drive | {"node": node}}
        for node in range(1, 1 + len(plant["tendons"]))
    ]
    wide = float(uniform(0.6, 1.1)) * length_mm
    robot["workspace"] = {
        "x_mm": [-wide, wide],
        "y_mm": [-wide, wide],
        "z_mm": [0.3 * length_mm, 1.05 * length_mm],
    }
    robot["emulation"]["plant"] = plant
    robot["emulation"]["tracker"]["base_position_mm"] = [0.0, 0.0, -150.0 - length_mm]
    return kind, robot


def path_on(
    plant: dict[str, Any], load_g: float, random: np.random.Generator
) -> tuple[Vector, Vector, str] | None:
    """(n, m) axes and (n, 3) tips of a closed path that a body reaches which does not rub, and what
    it is; None: a tendon would be slack on it."""
    smooth = {"friction": 0.0, "backlash_mm": 0.0, "dead_time_s": 0.0}
    body = TendonArm(TendonArmPlant.model_validate({**plant, **smooth}))
    phase = np.linspace(0.0, 2.0 * np.pi, _POINTS + 1)
    kind = str(random.choice(["circle", "rectangle", "eight"]))
    one, other = random.uniform(0.2, 0.6, 2)
    if kind == "rectangle":
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * [one, other]
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        way = np.linspace(0.0, at[-1], _POINTS + 1)
        bend = 0.7 * np.column_stack([np.interp(way, at, corners[:, i]) for i in range(2)])
    elif kind == "eight":
        bend = np.column_stack([one * np.sin(phase), 0.5 * other * np.sin(2.0 * phase)])
    else:
        bend = one * np.column_stack([np.cos(phase), np.sin(phase)])
    bend += random.uniform(-0.15, 0.15, 2)
    holes = plant["tendon_radius_mm"] * _mean_directions(plant)
    axes = bend @ holes.T
    load, tips, least = TipLoad(load_g), [], np.inf
    try:
        for share in np.linspace(0.0, 1.0, 20):
            body.step(share * axes[0], load, 0.1)
        for place in axes:
            state = body.step(place, load, 0.1)
            tips.append(state.tip.position_mm)
            least = min(least, float(state.actuator_forces.min()))
    except PlantError:
        return None
    if least < max(0.25, _LEAST_SHARE * plant["pretension_n"]):
        return None
    tips[-1] = tips[0]
    return axes, np.array(tips), kind


def _mean_directions(plant: dict[str, Any]) -> Vector:
    """(m, 2) which way each tendon pulls the tip, over the arm."""
    along = np.linspace(0.0, 1.0, 101)
    angles = [one["angle_rad"] + 2.0 * np.pi * one["turns"] * along for one in plant["tendons"]]
    return np.array([[np.cos(one).mean(), np.sin(one).mean()] for one in angles])


def case_of(number: int) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """What its tendons are, a robot file's content, and what the experiment's file is changed by.
    The same number gives the same case."""
    random = np.random.default_rng([number, 1618])
    while True:
        kind, robot = robot_of(random)
        plant = robot["emulation"]["plant"]
        load_g = float(random.integers(2) * random.uniform(0.1, 0.5) * plant["mass_g"])
        try:
            found = path_on(plant, load_g, random)
        except (ValueError, PlantError):
            continue
        if found is not None:
            break
    axes, tips, path = found
    lengths_mm = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    # As fast as asked, or with the fastest axis at a half of its speed.
    most_mm_s = 0.5 * robot["axes"][0]["max_velocity_mm_s"]
    pull = np.abs(np.diff(axes, axis=0)).max(axis=1)
    speed_mm_s = float(np.exp(random.uniform(*np.log([5.0, 20.0]))))
    speed_mm_s = min(speed_mm_s, float((most_mm_s * lengths_mm / np.maximum(pull, 1e-9)).min()))
    t = np.concatenate([[0.0], np.cumsum(lengths_mm / speed_mm_s)])
    points = np.column_stack([t, tips]).round(4).tolist()
    return (
        f"{kind}, {path}",
        robot,
        {
            "trajectory": {
                "kind": "waypoints",
                "points": points,
                "cycles": max(2, round(LASTS_S / t[-1])),
            },
            **CONTROLLERS[number % len(CONTROLLERS)],
            "tip_load_g": load_g,
            "longest_s": 1500.0,
        },
    )


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    design, robot, case = case_of(number)
    known = "" if case["pretraining"] is None else ", with a model"
    points = np.array(case["trajectory"]["points"])
    what = {
        "design": design,
        "kind": case["controller"]["kind"] + known,
        "speed_mm_s": round(float(np.linalg.norm(points[1, 1:] - points[0, 1:]) / points[1, 0]), 1),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_text(yaml.safe_dump(robot, sort_keys=False))
        return {"case": number, **what, **came_of(TENDON_ARM, {"robot": str(path), **case}, number)}


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 60)


if __name__ == "__main__":
    sys.exit(main())
