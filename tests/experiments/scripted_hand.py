"""`python -m tests.experiments.scripted_hand OUT.csv`: a path as if recorded by teleoperation.

No hand made it. A scripted one reaches from place to place as hands do (least jerk, bowed, pauses
and a tremor), the emulated robot follows it by its learnt model, and its tip is recorded at 10 Hz:
so everything on the path could be reached, with its direction. Fagogenis, Bergeles and Dupont
(IROS 2016) recorded theirs with a haptic device, and did not publish it.
"""

import argparse
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from config.emulation.plants import ConcentricTubesPlant
from config.paths import shipped_or_beside
from daemon.control.redundancy import damped_solution
from daemon.control.task import tip_axis, turn_between
from daemon.learning.forward.pose_kinematics import BodyCoordinates, PoseKinematics
from daemon.learning.forward.pose_model import PoseModel
from daemon.robot.axes import AxisRanges
from daemon.robot.checked_robot import check_robot
from drivers.pose import Vector
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
from sim_backends.plants.plant import TipLoad

SEED: Final = 20160
_DT_S: Final = 0.025
_RECORDED_S: Final = 0.1
_LASTS_S: Final = 90.0
_MM_PER_RAD: Final = 25.0
_GAIN_PER_S: Final = 4.0
_SPEED_MM_S: Final = 7.0
_TREMOR_MM, _TREMOR_HZ = 0.1, 7.0
_BOW: Final = 0.15
"""How far a reach bends aside, as a share of its length."""
_START: Final = (0.0, 2.0, 1.2, 0.0, 0.0)
_RANGE: Final = (0.5, 0.6, 0.8, 3.0, 8.0)
"""Of the axes, within which the places are to which it reaches: so they can be reached."""


class Hand(NamedTuple):
    """Where it is, and where it points the tip."""

    position_mm: Vector
    direction: Vector


def scripted_path(seed: int = SEED, lasts_s: float = _LASTS_S) -> Vector:
    """(n, 7) t, x, y, z, dx, dy, dz: of the tip of the shipped robot of concentric tubes."""
    here = Path(__file__)
    robot = check_robot(
        shipped_or_beside("builtin:concentric_tubes.yaml", "robots", here)
    ).file.robot
    assert robot.emulation is not None
    plant = robot.emulation.plant
    assert isinstance(plant, ConcentricTubesPlant)
    model = PoseModel.load(shipped_or_beside("builtin:concentric_tubes_pose.npz", "models", here))
    coordinates = BodyCoordinates.from_dict(model.metadata["coordinates"])
    kinematics, body = PoseKinematics(model.lwpr, coordinates), ConcentricTubes(plant)
    axes, u = AxisRanges.of(robot), np.array(_START)
    hand = _hand(kinematics, np.random.default_rng(seed))
    rows, steps_each = [], round(_RECORDED_S / _DT_S)
    for number in range(round(lasts_s / _DT_S) + 1):
        tip = body.step(u, TipLoad(), _DT_S).tip
        if number % steps_each == 0:
            rows.append([number * _DT_S, *tip.position_mm, *tip_axis(tip.quaternion)])
        wanted, answer = next(hand), kinematics.answer(u)
        turn = turn_between(tip_axis(tip.quaternion), wanted.direction)
        step = np.concatenate([wanted.position_mm - tip.position_mm, _MM_PER_RAD * turn])
        scaled = (
            np.concatenate([answer.jacobian[:3], _MM_PER_RAD * answer.jacobian[3:]]) * axes.scale
        )
        change = axes.scale * damped_solution(scaled, _GAIN_PER_S * _DT_S * step, 2.0)
        u = np.clip(u + axes.slowed(change, 0.8 * _DT_S), axes.lowest, axes.highest)
    return np.array(rows)


def _hand(kinematics: PoseKinematics, random: np.random.Generator):  # type: ignore[no-untyped-def]
    """Where the hand is at each step, without end."""
    at = Hand(*kinematics.pose(np.array(_START)))
    t_s = 0.0
    while True:
        place = np.array(_START) + random.uniform(-1.0, 1.0, len(_START)) * np.array(_RANGE)
        to = Hand(*kinematics.pose(place))
        way, turn = to.position_mm - at.position_mm, turn_between(at.direction, to.direction)
        far_mm = float(np.linalg.norm(way))
        aside = np.cross(way, random.normal(size=3))
        aside *= _BOW * random.uniform(-1.0, 1.0) * far_mm / np.linalg.norm(aside)
        lasts_s = 0.6 + 1.875 * max(far_mm, _MM_PER_RAD * float(np.linalg.norm(turn))) / _SPEED_MM_S
        pause_s = random.uniform(0.1, 0.8)
        for step in range(round((lasts_s + pause_s) / _DT_S)):
            s = min(step * _DT_S / lasts_s, 1.0)
            share = s**3 * (10.0 + s * (6.0 * s - 15.0))
            tremor = _TREMOR_MM * np.sin(2.0 * np.pi * _TREMOR_HZ * t_s + np.array([0.0, 2.1, 4.2]))
            direction = at.direction + share * (to.direction - at.direction)
            bow = 4.0 * share * (1.0 - share) * aside
            yield Hand(
                at.position_mm + share * way + bow + tremor, direction / np.linalg.norm(direction)
            )
            t_s += _DT_S
        at = to


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.experiments.scripted_hand")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    lines = [
        "# Made by a scripted hand, not recorded from a person:",
        f"# python -m tests.experiments.scripted_hand {arguments.out.name} --seed {arguments.seed}",
        "t, x, y, z, dx, dy, dz",
    ]
    for row in scripted_path(arguments.seed):
        cells = [f"{row[0]:.1f}", *(f"{mm:.3f}" for mm in row[1:4])]
        lines.append(", ".join([*cells, *(f"{share:.5f}" for share in row[4:])]))
    arguments.out.write_text("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
