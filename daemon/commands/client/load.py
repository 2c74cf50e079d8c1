"""`tentacled load FILE.yaml`: make a trajectory ready, and a controller if the file names one."""

import argparse
import sys
from pathlib import Path
from typing import Any

from config.documents.problems import ConfigError
from config.documents.yaml_document import read_yaml
from daemon.commands.terminal.command_line import EXIT_FAILED
from daemon.commands.terminal.remote_arguments import (
    add_json_argument,
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.messages import Load
from daemon.remote.wire import encode, most_bytes
from daemon.robot.shipped_files import file_argument


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        type=file_argument("experiments"),
        metavar="FILE.yaml",
        help="an experiment file, one with `trajectory` and `controller` alone, or a planned path",
    )
    add_target_arguments(parser)
    add_json_argument(parser)
    add_timeout_argument(parser)
    parser.add_argument("--cycles", type=int, metavar="N", help="instead of the file's")


def run(arguments: argparse.Namespace) -> int:
    if arguments.file.suffix == ".json":
        return _run_path(arguments)
    document = read_yaml(arguments.file)
    if document.problems:
        print("\n".join(str(problem) for problem in document.problems), file=sys.stderr)
        return EXIT_FAILED
    content = document.value if isinstance(document.value, dict) else {}
    trajectory, controller = content.get("trajectory"), content.get("controller")
    if not isinstance(trajectory, dict):
        print(f"{arguments.file}: there is no trajectory in it", file=sys.stderr)
        return EXIT_FAILED
    if controller is not None and not isinstance(controller, dict):
        print(f"{arguments.file}: a controller is written like a trajectory", file=sys.stderr)
        return EXIT_FAILED
    if controller is not None and content.get("pretraining") is not None:
        model = _pretrained(arguments.file)
        if isinstance(model, str):
            print(model, file=sys.stderr)
            return EXIT_FAILED
        controller = {**controller, **model}
    try:
        command = Load(
            trajectory=_with_points(trajectory, arguments.file.parent),
            controller=controller,
            cycles=arguments.cycles,
            robot=_robot_name(content.get("robot"), arguments.file),
        )
    except LoadError as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    if len(encode(command)) > most_bytes(Load):
        text = "more than a message holds: keep them in the daemon's own folder (`run --files`)"
        print(f"{arguments.file}: its waypoints are {text}", file=sys.stderr)
        return EXIT_FAILED
    return run_command(arguments, command)


def _run_path(arguments: argparse.Namespace) -> int:
    """A path file by itself, with the controller that needs to know nothing."""
    try:
        trajectory = _with_points(
            {"kind": "planned", "file": arguments.file.name}, arguments.file.parent
        )
    except LoadError as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    robot = trajectory["path"]["robot"]
    command = Load(trajectory=trajectory, cycles=arguments.cycles, robot=robot)
    if len(encode(command)) > most_bytes(Load):
        print(f"{arguments.file}: is longer than a message may be", file=sys.stderr)
        return EXIT_FAILED
    return run_command(arguments, command)


class LoadError(ValueError):
    """A file that cannot be loaded; the text says which, and why."""


def _with_points(trajectory: dict[str, Any], folder: Path) -> dict[str, Any]:
    """With the points of its waypoint file as data: the daemon reads no files of ours.

    Raises LoadError.
    """
    name = trajectory.get("file")
    if trajectory.get("kind") == "planned" and isinstance(name, str):
        return {"kind": "planned", "path": _path(folder / name)}
    if trajectory.get("kind") != "waypoints" or not isinstance(name, str):
        return trajectory
    # Nobody else who loads a trajectory has to wait for numpy.
    from daemon.reference.waypoints import WaypointError, read_waypoints

    try:
        times, points = read_waypoints(folder / name, closed=False)
    except WaypointError as error:
        raise LoadError(str(error)) from None
    rows = [[t, *point] for t, point in zip(times.tolist(), points.tolist(), strict=True)]
    return {**{key: value for key, value in trajectory.items() if key != "file"}, "points": rows}


def _path(path: Path) -> dict[str, Any]:
    """What a path file holds, without its figures. Raises LoadError."""
    from daemon.reference.planned_path import PlannedPathError, read_path

    try:
        return read_path(path).model_dump(mode="json", exclude={"figures"})
    except PlannedPathError as error:
        raise LoadError(str(error)) from None


def _robot_name(named: object, path: Path) -> str:
    """The robot that an experiment is for, by the robot file that it names. Raises LoadError."""
    if not isinstance(named, str):
        return ""
    from daemon.workbench.experiments.experiment_file import robot_path

    robot_file = robot_path(named, path)
    content = read_yaml(robot_file).value if robot_file.is_file() else None
    name = content.get("robot") if isinstance(content, dict) else None
    if not isinstance(name, str):
        raise LoadError(f"{path}: its `robot` names {robot_file}, which is no robot file")
    return name


def _pretrained(path: Path) -> dict[str, str] | str:
    """What an experiment's controller gets from its pre-training; a text where there is none.

    Found, or made in virtual time first.
    """
    # Nobody else who loads a trajectory has to wait for what learns.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.workbench.experiments.experiment_file import load_experiment
    from daemon.workbench.experiments.trial import TrialError
    from daemon.workbench.pretraining.model_cache import with_model

    try:
        file = load_experiment(path)
        with telling_progress() as progress:
            seed = file.experiment.seed
            file = with_model(file, seed, lambda text: progress.tell(text, sys.stderr), progress)
    except (ConfigError, TrialError, OSError) as error:
        return str(error)
    model = getattr(file.experiment.controller, "model", None)
    return {} if model is None else {"model": str(model)}
