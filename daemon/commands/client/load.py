"""`tentacled load FILE.yaml`: make a trajectory ready, and a controller if the file names one."""

import argparse
import sys
from pathlib import Path
from typing import Any, Final

from config.documents.problems import ConfigError
from config.documents.yaml_document import read_yaml
from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import whole_number
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.messages import Load
from daemon.remote.wire import encode, most_bytes
from daemon.robot.shipped_files import file_argument

_MOST_CYCLES: Final = 1_000_000_000
"""The daemon knows how many are too many for what is to be followed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        type=file_argument("experiments"),
        metavar="FILE.yaml",
        help="an experiment file, one with `trajectory` and `controller` alone, or a planned path",
    )
    add_target_arguments(parser)
    add_timeout_argument(parser)
    parser.add_argument(
        "--cycles", type=whole_number(1, _MOST_CYCLES), metavar="N", help="instead of the file's"
    )


def run(arguments: argparse.Namespace) -> Result:
    if arguments.file.suffix == ".json":
        return _run_path(arguments)
    document = read_yaml(arguments.file)
    if document.problems:
        raise ConfigError(document.problems)
    content = document.value if isinstance(document.value, dict) else {}
    trajectory, controller = content.get("trajectory"), content.get("controller")
    if not isinstance(trajectory, dict):
        raise ConfigError([document.problem((), "there is no trajectory in it")])
    if controller is not None and not isinstance(controller, dict):
        raise ConfigError(
            [document.problem(("controller",), "a controller is written like a trajectory")]
        )
    if controller is not None and content.get("pretraining") is not None:
        controller = {**controller, **_pretrained(arguments.file)}
    command = Load(
        trajectory=_with_points(trajectory, arguments.file.parent),
        controller=controller,
        cycles=arguments.cycles,
        robot=_robot_name(content.get("robot"), arguments.file),
    )
    if _sent_bytes(command, arguments.file) > most_bytes(Load):
        text = "more than a message holds: keep them in the daemon's own folder (`run --files`)"
        raise _unusable(arguments.file, f"its waypoints are {text}")
    return run_command(arguments, command)


def _run_path(arguments: argparse.Namespace) -> Result:
    """A path file by itself, with the controller that needs to know nothing."""
    trajectory = _with_points(
        {"kind": "planned", "file": arguments.file.name}, arguments.file.parent
    )
    robot = trajectory["path"]["robot"]
    command = Load(trajectory=trajectory, cycles=arguments.cycles, robot=robot)
    if _sent_bytes(command, arguments.file) > most_bytes(Load):
        raise _unusable(arguments.file, "is longer than a message may be")
    return run_command(arguments, command)


def _sent_bytes(command: Load, path: Path) -> int:
    """Raises CommandError where a number is too large to be sent."""
    try:
        return len(encode(command))
    except OverflowError:
        text = f"{path}: a number in it has more digits than one may have"
        raise CommandError("configuration", text, place=str(path)) from None


def _unusable(path: Path, text: str) -> CommandError:
    return CommandError("unusable_data", f"{path}: {text}", place=str(path))


def _with_points(trajectory: dict[str, Any], folder: Path) -> dict[str, Any]:
    """With the points of its waypoint file as data: the daemon reads no files of ours.

    Raises WaypointError, PlannedPathError.
    """
    name = trajectory.get("file")
    if trajectory.get("kind") == "planned" and isinstance(name, str):
        return {"kind": "planned", "path": _path(folder / name)}
    if trajectory.get("kind") != "waypoints" or not isinstance(name, str):
        return trajectory
    # Nobody else who loads a trajectory has to wait for numpy.
    from daemon.reference.waypoints import read_waypoints

    times, points = read_waypoints(folder / name, closed=False)
    rows = [[t, *point] for t, point in zip(times.tolist(), points.tolist(), strict=True)]
    return {**{key: value for key, value in trajectory.items() if key != "file"}, "points": rows}


def _path(path: Path) -> dict[str, Any]:
    """What a path file holds, without its figures. Raises PlannedPathError."""
    from daemon.reference.planned_path import read_path

    return read_path(path).model_dump(mode="json", exclude={"figures"})


def _robot_name(named: object, path: Path) -> str:
    """The robot that an experiment is for, by the robot file that it names. Raises CommandError."""
    if not isinstance(named, str):
        return ""
    from daemon.workbench.experiments.experiment_file import robot_path

    robot_file = robot_path(named, path)
    content = read_yaml(robot_file).value if robot_file.is_file() else None
    name = content.get("robot") if isinstance(content, dict) else None
    if not isinstance(name, str):
        text = f"{path}: its `robot` names {robot_file}, which is no robot file"
        raise CommandError("configuration", text, place=str(path))
    return name


def _pretrained(path: Path) -> dict[str, str]:
    """What an experiment's controller gets from its pre-training.

    Found, or made in virtual time first. Raises ConfigError, TrialError, OSError.
    """
    # Nobody else who loads a trajectory has to wait for what learns.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.workbench.experiments.experiment_file import load_experiment
    from daemon.workbench.pretraining.model_cache import with_model

    file = load_experiment(path)
    with telling_progress() as progress:
        seed = file.experiment.seed
        file = with_model(file, seed, lambda text: progress.tell(text, sys.stderr), progress)
    model = getattr(file.experiment.controller, "model", None)
    return {} if model is None else {"model": str(model)}
