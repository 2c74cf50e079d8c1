"""`tentacled kinematics ROBOT.yaml --out MODEL.npz`: learn where the tip of concentric tubes is."""

import argparse
import sys
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

from config.emulation.plants import ConcentricTubesPlant
from config.paths import named_model
from daemon.commands.outcome.failures import CommandError, UsageError, as_failed
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.workbench.pretraining.pose_learning import LearntPose


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--out", type=Path, metavar="MODEL.npz", help="learn, and keep it there")
    what.add_argument(
        "--model",
        type=named_model,
        metavar="MODEL.npz",
        help="say how well this one does; `builtin:` for a shipped",
    )
    parser.add_argument(
        "--points",
        type=int,
        default=80,
        metavar="N",
        help="of the grid, along each angle and extension (default: %(default)s)",
    )
    parser.add_argument(
        "--extension",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="mm by which inner tubes stand out of the first one (default: as the axes go)",
    )
    parser.add_argument(
        "--fields", type=int, default=600, metavar="N", help="at most (default: %(default)s)"
    )
    parser.add_argument("--epochs", type=int, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--test-share",
        type=float,
        default=0.15,
        metavar="SHARE",
        help="of the grid that is kept back to test the model with (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="default: %(default)s"
    )


def run(arguments: argparse.Namespace) -> Result:
    # What solves and learns is compiled when it comes: `--help` does without.
    from daemon.files import check_can_be_made
    from daemon.learning.forward.pose_model import PoseModel
    from daemon.workbench.pretraining.pose_learning import (
        PoseLearningSettings,
        evaluate_pose,
        learn_pose,
    )
    from sim_backends.plants.concentric.relative import RelativeTubes

    checked = robot_with_warnings_told(arguments.robot)
    robot = checked.file.robot
    plant = None if robot.emulation is None else robot.emulation.plant
    if not isinstance(plant, ConcentricTubesPlant):
        place = str(arguments.robot)
        text = f"{place}: these are no concentric tubes"
        raise CommandError("configuration", text, place=place)
    try:
        settings = PoseLearningSettings(
            arguments.points,
            arguments.fields,
            arguments.epochs,
            arguments.test_share,
            arguments.seed,
        )
    except ValueError as error:
        raise UsageError(str(error)) from None
    extension_mm = None if arguments.extension is None else tuple(arguments.extension)
    try:
        tubes = RelativeTubes(plant, robot.axes, extension_mm)
        if arguments.model is not None:
            found = evaluate_pose(PoseModel.load(arguments.model), tubes, settings)
        else:
            check_can_be_made(arguments.out)
            found = learn_pose(tubes, settings, _about(arguments, plant), _say)
            found.model.save(arguments.out)
    except ValueError as error:
        raise as_failed(error) from None
    return Result(_as_json(found), _as_table(found))


def _about(arguments: argparse.Namespace, plant: ConcentricTubesPlant) -> dict[str, Any]:
    extension = ""
    if arguments.extension is not None:
        extension = " --extension {:g} {:g}".format(*arguments.extension)
    return {
        "robot": arguments.robot.name,
        "tubes": [tube.model_dump(mode="json") for tube in plant.tubes],
        "commands": [
            f"tentacled kinematics {arguments.robot.name} --out {arguments.out.name} "
            f"--points {arguments.points}{extension} --fields {arguments.fields} "
            f"--epochs {arguments.epochs} --test-share {arguments.test_share:g} "
            f"--seed {arguments.seed}"
        ],
    }


def _say(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def _as_table(found: "LearntPose") -> str:
    errors = found.errors
    off = [f"{x:.2f} mm" for x in errors.position_mm] + [f"{degrees(errors.angle_rad):.2f}°"]
    shares = [f"{x:.2f} %" for x in (*errors.position_percent, errors.angle_percent)]
    rows = [("", "x", "y", "z", "direction"), ("RMSE", *off), ("of the range", *shares)]
    lines = [f"{row[0]:14}" + "".join(f"{cell:>11}" for cell in row[1:]) for row in rows]
    return "\n".join(
        [
            f"{found.model.lwpr.count} receptive fields; {found.learnt} configurations, "
            f"{found.kept_back} kept back, {found.unsolved} without a stable shape",
            *lines,
        ]
    )


def _as_json(found: "LearntPose") -> dict[str, Any]:
    return {
        "fields": found.model.lwpr.count,
        "configurations": found.learnt,
        "kept_back": found.kept_back,
        "unsolved": found.unsolved,
        "rmse_mm": found.errors.position_mm.tolist(),
        "rmse_rad": found.errors.angle_rad,
        "percent": [*found.errors.position_percent.tolist(), found.errors.angle_percent],
    }
