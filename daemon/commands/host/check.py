"""`tentacled check FILE …`: every problem of all files at once, or what they describe.

Robots, experiments, scenarios and studies. What passes here can be emulated, run and carried out:
it has been built once.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

from config.documents.problems import ConfigError, Problem, did_you_mean
from config.documents.yaml_document import read_yaml
from config.paths import is_folder
from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.robot.checked_robot import CheckedRobot, check_robot
from daemon.robot.coupled_axes import beyond_alone
from daemon.robot.shipped_files import FOLDERS, add_list_option, file_argument

_KINDS: Final = ("robot", "experiment", "scenario", "study")
"""The key that a file of each kind has. An experiment names its robot too."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        nargs="+",
        type=file_argument(*FOLDERS),
        metavar="FILE.yaml",
        help="robots, experiments, scenarios and studies; builtin:NAME is one that is shipped",
    )
    add_list_option(parser, *FOLDERS)
    parser.add_argument(
        "--robot",
        type=file_argument("robots"),
        metavar="ROBOT.yaml",
        help="of a scenario: the robot whose devices it is for (the shipped soft arm)",
    )


def run(arguments: argparse.Namespace) -> Result:
    for path in filter(is_folder, arguments.files):
        text = "is a folder: name a file in it, such as robot.yaml"
        raise UsageError(f"{path}: {text}", place=str(path))
    problems: list[Problem] = []
    described: list[tuple[Path, list[str]]] = []
    for path in arguments.files:
        try:
            described.append((path, check(path, arguments.robot)))
        except ConfigError as error:
            problems += error.problems
    text = "\n".join(line for _, lines in described for line in lines)
    if problems:
        if text:
            print(text)
        raise ConfigError(problems)
    files = [{"file": path, "sound": True, "described": lines} for path, lines in described]
    return Result(files[0] if len(files) == 1 else {"sound": True, "files": files}, text)


def check(path: Path, robot: Path | None = None) -> list[str]:
    """What the file describes. robot: of a scenario. Raises ConfigError with all that is wrong."""
    match kind_of(path):
        case "experiment":
            return check_experiment(path)
        case "study":
            return check_study(path)
        case "scenario":
            return check_scenario(path, robot)
        case _:
            return check_robot_file(path)


def kind_of(path: Path) -> str:
    """Which kind of file it is; a robot file where nothing says otherwise. Raises ConfigError."""
    document = read_yaml(path)
    keys = list(document.value) if isinstance(document.value, dict) else []
    if not keys:
        raise ConfigError(document.problems or [document.problem((), "there are no keys in it")])
    for kind in ("study", "scenario", "experiment"):
        if kind in keys:
            return kind
    if "robot" in keys or "axes" in keys or "tracker" in keys:
        return "robot"
    hints = [hint for key in keys if (hint := did_you_mean(str(key), _KINDS))]
    text = f"it must have one of the keys {', '.join(_KINDS)}{hints[0] if hints else ''}"
    raise ConfigError([document.problem((), text)])


def check_robot_file(path: Path) -> list[str]:
    """What it describes. Raises ConfigError."""
    from daemon.workbench.experiments.construction import robot_problems

    checked = check_robot(path)
    _none(robot_problems(checked.file))
    for warning in checked.warnings:
        print(f"{warning} (warning)", file=sys.stderr)
    return _described(path, checked)


def check_experiment(path: Path) -> list[str]:
    """What it describes. Raises ConfigError."""
    from daemon.workbench.experiments.construction import experiment_problems
    from daemon.workbench.experiments.experiment_file import load_experiment

    file = load_experiment(path)
    _none(experiment_problems(file))
    experiment = file.experiment
    return [
        f"{path}: the experiment {experiment.experiment} is sound",
        f"  robot       {file.robot.robot}",
        f"  trajectory  {experiment.trajectory.kind}",
        f"  controller  {experiment.controller.kind}",
    ]


def check_study(path: Path) -> list[str]:
    """What it describes. Raises ConfigError."""
    from daemon.workbench.experiments.construction import SoundRobots, experiment_problems
    from daemon.workbench.studies.study_file import load_study

    file, sound = load_study(path), SoundRobots()
    for experiment in file.experiments.values():
        _none(experiment_problems(experiment, sound))
    names = ", ".join(file.experiments)
    return [f"{path}: the study {file.study.study} is sound", f"  experiments {names}"]


def check_scenario(path: Path, robot: Path | None = None) -> list[str]:
    """What it describes. Raises ConfigError."""
    from daemon.workbench.experiments.construction import lab_of
    from daemon.workbench.experiments.experiment_file import robot_path
    from sim_backends.lab.scenario import load_scenario

    file = check_robot(robot or robot_path("builtin:soft_arm", path)).file
    scenario = load_scenario(path, lab_of(file))
    return [
        f"{path}: the scenario {scenario.scenario} is sound for {file.robot.robot}",
        f"  {len(scenario.events)} events, the last after {scenario.events[-1].at_s:g} s",
    ]


def _none(problems: list[Problem]) -> None:
    if problems:
        raise ConfigError(problems)


def _described(path: Path, checked: CheckedRobot) -> list[str]:
    robot = checked.file.robot
    tracker = robot.tracker
    lines = [
        f"{path}: {robot.robot} is sound",
        f"  tracker   {tracker.kind} on {tracker.port} at {tracker.baud_rate} baud",
    ]
    for name, bus in robot.buses.items():
        nodes = {axis.drive.node for axis in robot.axes if axis.drive.bus == name}
        lines.append(
            f"  bus       {name}: {bus.interface} {bus.channel}, {1 / bus.cycle_period_s:g} Hz, "
            f"{len(nodes)} drives, {checked.budgets[name]}"
        )
    for axis in robot.axes:
        drive = axis.drive
        lines.append(
            f"  axis      {axis.name}: {axis.kind}, {drive.bus}/{drive.node} axis {drive.axis}"
        )
    for limit, beyond in zip(robot.coupled_limits, beyond_alone(robot), strict=True):
        alone = f"drives alone reach {beyond:g} {limit.unit} beyond it" if beyond else "drives, too"
        lines.append(f"  coupled   {limit.name}: the gate keeps it; {alone}")
    return lines
