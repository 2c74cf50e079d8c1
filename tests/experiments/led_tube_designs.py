"""Random designs of concentric tubes, not only other figures of one: all are followed, none held.

`python -m tests.experiments.led_tube_designs`. Every case is a set of two to four tubes of lengths,
curvatures and stiffnesses of its own, each on a carriage of its own or two on one, with a mouth
that stands still or moves with the first, described by `coordinates` or by its axes alone. Sets
that snap somewhere are left out. The path is one that its body reaches, computed from that body
without friction, at 2 to 12 mm/s as far as its axes are fast enough. Verdicts are those of
`led_bodies`.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from config.emulation.plants import ConcentricTubesPlant
from drivers.pose import Vector
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
from sim_backends.plants.plant import PlantError, TipLoad
from tests import SHIPPED_ROBOTS
from tests.experiments.led_bodies import came_of, carry_out_all
from tests.experiments.led_designs import CONTROLLERS
from tests.experiments.led_tubes import CTR_CIRCLE

_LASTS_S: Final = 30.0
_POINTS: Final = 60
_OFF_MM: Final = 0.02
"""Of a point that counts as reached."""
_LEAST_STABILITY: Final = 0.15
_LEAST_ROOM: Final = 0.05
"""Of its travel, to either end of an axis along a path."""


def robot_of(random: np.random.Generator) -> dict[str, Any]:
    """A robot file's content."""
    uniform = random.uniform
    count = int(random.integers(2, 5))
    shared = bool(count > 2 and random.random() < 0.4)  # by the two outermost tubes
    carriages = [max(0, tube - shared) for tube in range(count)]
    mouth = str(random.choice(["first_collar", "plate"]))
    pushed_mm = float(uniform(8.0, 18.0))
    tubes: list[dict[str, Any]] = []
    stiffness, out_mm = float(np.exp(uniform(*np.log([2e4, 8e4])))), 0.0
    for tube, carriage in enumerate(carriages):
        same = tube > 0 and carriages[tube - 1] == carriage
        out_mm += 0.0 if same else 2.0 * pushed_mm + float(uniform(8.0, 30.0))
        collar_mm = -carriage * (2.0 * pushed_mm + 15.0) - (10.0 if same else 0.0)
        collar_mm -= pushed_mm + 5.0 if mouth == "plate" else 0.0
        length_mm = out_mm - collar_mm
        curved_mm = min(float(uniform(0.6, 1.4)) * out_mm, length_mm - 1.0)
        curvature = float(np.exp(uniform(*np.log([1 / 350.0, 1 / 70.0]))))
        sections: list[dict[str, float]] = [
            {"length_mm": length_mm - curved_mm},
            {"length_mm": curved_mm, "curvature_per_mm": curvature},
        ]
        if same:  # a pair that is balanced, nearly
            stiffness /= 0.5
            sections[1]["curvature_per_mm"] = tubes[-1]["sections"][1]["curvature_per_mm"]
        tubes.append(
            {
                "carriage": carriage,
                "collar_mm": collar_mm,
                "outer_radius_mm": 1.6 - 0.3 * tube,
                "mass_mg_mm": 6.0 - tube,
                "bending_stiffness_n_mm2": stiffness,
                "torsion_stiffness_n_mm2": stiffness / float(uniform(1.2, 1.5)),
                "sections": sections,
            }
        )
        stiffness *= float(uniform(0.2, 0.6))
    robot: dict[str, Any] = yaml.safe_load((SHIPPED_ROBOTS / "concentric_tubes.yaml").read_text())
    for key in ("coordinates", "coupled_limits", "homing_order"):
        del robot[key]
    rotation, carriage_axis = robot["axes"][0], robot["axes"][3]
    axes = [rotation | {"max_velocity_rad_s": float(uniform(0.5, 2.0))} for _ in tubes]
    axes += [
        carriage_axis
        | {"travel_mm": [-pushed_mm, pushed_mm], "max_velocity_mm_s": float(uniform(3.0, 10.0))}
        for _ in range(carriages[-1] + 1)
    ]
    names = [f"rotation_{one}" for one in range(count)]
    names += [f"carriage_{one}" for one in range(carriages[-1] + 1)]
    robot["axes"] = [
        axis | {"name": name, "drive": axis["drive"] | {"node": node}, "homing": {}}
        for node, (axis, name) in enumerate(zip(axes, names, strict=True), start=1)
    ]
    for axis in robot["axes"]:
        axis.pop("homing_position_mm", None)
        if "max_velocity_mm_s" in axis:
            axis["following_error_mm"] = 0.1 * axis["max_velocity_mm_s"]
        else:
            axis["following_error_rad"] = 0.08 * axis["max_velocity_rad_s"]
    if random.random() < 0.5:
        robot["coordinates"] = _coordinates(count, names)
    wide_mm = 1.1 * out_mm
    robot["workspace"] = {
        "x_mm": [-wide_mm, wide_mm],
        "y_mm": [-wide_mm, wide_mm],
        "z_mm": [-0.2 * out_mm, 1.4 * out_mm],
    }
    robot["emulation"]["plant"] = {
        "kind": "concentric_tubes",
        "tubes": tubes,
        "mouth": mouth,
        "friction_nmm": float(uniform(0.0, 2.0)),
    }
    return robot


def _coordinates(count: int, names: list[str]) -> list[dict[str, Any]]:
    turns, pushes = names[:count], names[count:]
    return [
        {"name": "roll", "kind": "angle", "moves": dict.fromkeys(turns, 1.0)},
        *(
            {"name": f"alpha_{one}", "kind": "angle", "comes_round": True, "moves": {one: 1.0}}
            for one in turns[1:]
        ),
        {"name": "insertion", "kind": "length", "moves": dict.fromkeys(pushes, 1.0)},
        *({"name": f"d_{one}", "kind": "length", "moves": {one: 1.0}} for one in pushes[1:]),
    ]


def path_on(
    robot: dict[str, Any], random: np.random.Generator
) -> tuple[Vector, Vector, str] | None:
    """(n, m) axes and (n, 3) tips of a closed path that a body reaches which does not rub, and what
    it is; None: it does not, or snaps."""
    given = robot["emulation"]["plant"] | {"friction_nmm": 0.0}
    body = ConcentricTubes(ConcentricTubesPlant.model_validate(given))
    travel = np.array([axis.get("travel_mm", axis.get("travel_rad")) for axis in robot["axes"]])
    turning = np.array(["travel_rad" in axis for axis in robot["axes"]])
    least = _stability(body, travel, turning, random)
    if least < _LEAST_STABILITY:
        return None
    uniform = random.uniform
    place = np.where(
        turning,
        uniform(-2.5, 2.5) + uniform(-1.2, 1.2, len(travel)),
        travel[:, 0] + uniform(0.3, 0.7, len(travel)) * np.ptp(travel, axis=1),
    )
    body.reset()
    for share in np.linspace(0.0, 1.0, 40).tolist():
        middle = _tip(body, share * place)
    radius_mm = float(uniform(4.0, 15.0))
    kind = str(random.choice(["circle", "rectangle", "eight"]))
    tips = middle + radius_mm * _shape(kind, random)
    axes = []
    for tip in np.vstack([middle + share * (tips[0] - middle) for share in (0.25, 0.5, 0.75)]):
        place = _reached(body, tip, place, turning)
    for tip in tips:
        place = _reached(body, tip, place, turning)
        if np.linalg.norm(_tip(body, place) - tip) > _OFF_MM:
            return None
        room = _LEAST_ROOM * np.ptp(travel, axis=1)
        if (place < travel[:, 0] + room).any() or (place > travel[:, 1] - room).any():
            return None
        axes.append(place)
    return np.array(axes), tips, kind


def _shape(kind: str, random: np.random.Generator) -> Vector:
    """(n, 3) of a closed path about one wide."""
    phase = np.linspace(0.0, 2.0 * np.pi, _POINTS + 1)
    other = random.uniform(0.4, 1.0)
    flat = np.column_stack([np.cos(phase), other * np.sin(phase), 0.0 * phase])
    if kind == "eight":
        flat[:, 1] = other * np.sin(2.0 * phase)
    if kind == "rectangle":
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * [0.8, 0.8 * other]
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        way = np.linspace(0.0, at[-1], _POINTS + 1)
        flat[:, :2] = np.column_stack([np.interp(way, at, corners[:, i]) for i in range(2)])
    return np.asarray(flat)


def _stability(
    body: ConcentricTubes, travel: Vector, turning: Vector, random: np.random.Generator
) -> float:
    """The least at some places; zero where the tubes snap on the way."""
    least, place = 1.0, np.zeros(len(travel))
    lowest, highest = np.where(turning, [[-np.pi], [np.pi]], travel.T)
    for _ in range(12):
        goal = lowest + random.uniform(0.0, 1.0, len(travel)) * (highest - lowest)
        for share in np.linspace(0.0, 1.0, 12).tolist():
            state = body.step(place + share * (goal - place), TipLoad(), 0.1)
            least = min(least, state.stability)
            if state.snaps:
                return 0.0
        place = goal
    return least


def _tip(body: ConcentricTubes, place: Vector) -> Vector:
    return np.asarray(body.step(place, TipLoad(), 0.1).tip.position_mm)


def _reached(body: ConcentricTubes, tip: Vector, place: Vector, turning: Vector) -> Vector:
    """(m,) axes near `place` that take the tip there, about."""
    size = np.where(turning, 1.0, 20.0)
    for _ in range(6):
        now = _tip(body, place)
        if np.linalg.norm(tip - now) < 0.2 * _OFF_MM:
            break
        changes = 1e-3 * np.diag(size)
        slopes = np.column_stack([(_tip(body, place + one) - now) / 1e-3 for one in changes])
        system = slopes @ slopes.T + 0.25 * np.eye(3)
        place = place + size * (slopes.T @ np.linalg.solve(system, tip - now))
    return place


def case_of(number: int) -> tuple[dict[str, Any], dict[str, Any], str]:
    """A robot file's content, what the experiment's file is changed by, and what is followed. The
    same number gives the same case."""
    random = np.random.default_rng([number, 577])
    found = None
    while found is None:
        robot = robot_of(random)
        try:
            found = path_on(robot, random)
        except (ValueError, PlantError):
            continue
    axes, tips, path = found
    lengths_mm = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    speeds = [
        axis.get("max_velocity_mm_s", axis.get("max_velocity_rad_s")) for axis in robot["axes"]
    ]
    takes_s = 2.0 * (np.abs(np.diff(axes, axis=0)) / np.array(speeds)).max(axis=1)
    speed_mm_s = float(np.exp(random.uniform(*np.log([2.0, 12.0]))))
    speed_mm_s = min(speed_mm_s, float((lengths_mm / np.maximum(takes_s, 1e-9)).min()))
    t = np.concatenate([[0.0], np.cumsum(lengths_mm / speed_mm_s)])
    return (
        robot,
        {
            "trajectory": {
                "kind": "waypoints",
                "points": np.column_stack([t, tips]).round(4).tolist(),
                "cycles": max(2, round(_LASTS_S / t[-1])),
                "pointing": None,
            },
            **CONTROLLERS[number % len(CONTROLLERS)],
            "longest_s": 1500.0,
        },
        path,
    )


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    robot, case, shape = case_of(number)
    known = "" if case["pretraining"] is None else ", with a model"
    points = np.array(case["trajectory"]["points"])
    plant = robot["emulation"]["plant"]
    what = {
        "path": shape,
        "kind": case["controller"]["kind"] + known,
        "carriages": [tube["carriage"] for tube in plant["tubes"]],
        "mouth": plant["mouth"],
        "coordinates": "coordinates" in robot,
        "speed_mm_s": round(float(np.linalg.norm(points[1, 1:] - points[0, 1:]) / points[1, 0]), 1),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_text(yaml.safe_dump(robot, sort_keys=False))
        return {"case": number, **what, **came_of(CTR_CIRCLE, {"robot": str(path), **case}, number)}


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 60)


if __name__ == "__main__":
    sys.exit(main())
