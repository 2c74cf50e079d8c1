"""Reads a robot file. Either a sound `Robot` comes out, or every problem of the file at once."""

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from config.checks import Parts, findings
from config.documents.problems import ConfigError, Problem
from config.documents.schema_errors import schema_problems
from config.documents.yaml_document import Location, YamlDocument, read_yaml
from config.paths import eds_path, is_file, named_paths
from config.robot import Robot


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
            located = {(problem.line, problem.column) for problem in problems}
            problems += [
                problem
                for problem in schema_problems(document, Robot, error)
                if (problem.line, problem.column) not in located
            ]
        parts = Parts.of(document.value)
        problems += [document.problem(location, message) for location, message in findings(parts)]
        problems += _missing_files(document, parts, robot, path)
    if problems or robot is None:
        raise ConfigError(problems)
    return RobotFile(path, robot, document)


def _missing_files(
    document: YamlDocument, parts: Parts, robot: Robot | None, path: Path
) -> list[Problem]:
    if robot is not None:
        named = [(one.location, one.path) for one in named_paths(robot, path) if one.is_file]
    else:  # each drive that is sound can still be looked at
        named = [
            (("axes", index, "drive", "eds"), eds_path(drive.eds, path))
            for index, drive in enumerate(parts.drives)
            if drive is not None
        ]
    return [
        document.problem(location, f"there is no file {file}")
        for location, file in named
        if not is_file(file)
    ]
