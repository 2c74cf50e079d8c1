"""Reads a robot file. Either a sound `Robot` comes out, or every problem of the file at once."""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError

from config.checks import Parts, findings
from config.problems import ConfigError, Problem
from config.robot import Robot
from config.schema_errors import schema_problems
from config.yaml_document import Location, YamlDocument, read_yaml

_BUILTIN = "builtin:"


@dataclass(frozen=True)
class RobotFile:
    """A sound robot, and the file it came from for whoever has more to say about it."""

    path: Path
    robot: Robot
    document: YamlDocument

    def problem(self, location: Location, message: str) -> Problem:
        """A problem at `location` of this file, found by a check that lives elsewhere."""
        return self.document.problem(location, message)


def load_robot(path: Path) -> RobotFile:
    """Read and check a robot file.

    Raises ConfigError with every problem of the file, each with line and column.
    """
    document = read_yaml(path)
    problems = list(document.problems)
    robot: Robot | None = None
    if document.value is not None:
        try:
            robot = Robot.model_validate(document.value)
        except ValidationError as error:
            told = {(problem.line, problem.column) for problem in problems}
            problems += [
                problem
                for problem in schema_problems(document, Robot, error)
                if (problem.line, problem.column) not in told
            ]
        parts = Parts.of(document.value)
        problems += [document.problem(location, message) for location, message in findings(parts)]
        problems += _missing_files(document, parts, path)
        problems += _missing_risk_files(document, robot, path)
    if problems or robot is None:
        raise ConfigError(problems)
    return RobotFile(path, robot, document)


def eds_path(reference: str, robot_path: Path) -> Path:
    """The EDS file that a robot file names: shipped with us, or relative to the robot file."""
    return _shipped_or_beside(reference, "eds", robot_path)


def risk_paths(robot: Robot, robot_path: Path) -> tuple[Path, Path] | None:
    """The model of the body and the mesh that a robot file names; None: it names none."""
    settings = robot.risk
    if settings.model is None or settings.surface is None:
        return None
    return (
        _shipped_or_beside(settings.model, "models", robot_path),
        _shipped_or_beside(settings.surface.mesh, "surfaces", robot_path),
    )


def _shipped_or_beside(reference: str, folder: str, robot_path: Path) -> Path:
    if reference.startswith(_BUILTIN):
        return Path(str(files("config") / folder / reference.removeprefix(_BUILTIN)))
    return robot_path.parent / reference


def _missing_files(document: YamlDocument, parts: Parts, path: Path) -> list[Problem]:
    return [
        document.problem(("axes", index, "drive", "eds"), f"there is no file {eds}")
        for index, drive in enumerate(parts.drives)
        if drive is not None and not (eds := eds_path(drive.eds, path)).is_file()
    ]


def _missing_risk_files(document: YamlDocument, robot: Robot | None, path: Path) -> list[Problem]:
    paths = None if robot is None else risk_paths(robot, path)
    if paths is None:
        return []
    places: tuple[Location, ...] = ("risk", "model"), ("risk", "surface", "mesh")
    return [
        document.problem(place, f"there is no file {file}")
        for place, file in zip(places, paths, strict=True)
        if not file.is_file()
    ]
