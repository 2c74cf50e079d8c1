"""From a study's matrices to experiments: the cells of a bench."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from config.documents.model import OptionsError
from config.documents.problems import ConfigError, Problem, did_you_mean_file
from config.documents.yaml_document import Location, YamlDocument
from config.emulation.bodies import BodyName
from config.paths import is_file
from config.tasks.study import Study, StudyRow
from config.tasks.study_matrix import MatrixLoad, MatrixPath, StudyMatrix
from config.tasks.trajectory import TrajectoryOptions, load_trajectory_options
from daemon.reference.trajectories import Trajectory, make_trajectory
from daemon.workbench.experiments.experiment_file import (
    ExperimentFile,
    body_fields,
    changed,
    load_experiment,
)

_SAMPLES: Final = 4000
"""Of a cycle, from which its length is found."""


@dataclass(frozen=True)
class Cell:
    """What an experiment of a matrix is made of."""

    robot: str
    body: BodyName | None
    """None: the experiment's own."""
    path: str
    speed_mm_s: float | None
    """None: as the trajectory has it."""
    load: str
    gain: float
    """Share of every controller's own gain."""

    @property
    def name(self) -> str:
        """Of the experiment."""
        parts = [self.robot, self.body or "", self.path]
        parts += [] if self.speed_mm_s is None else [_in_a_name(self.speed_mm_s)]
        parts += [self.load] + ([] if self.gain == 1.0 else [f"gain_{_in_a_name(self.gain)}"])
        return "_".join(filter(None, parts))

    @property
    def label(self) -> str:
        """For a table."""
        speed = "" if self.speed_mm_s is None else f" {self.speed_mm_s:g} mm/s"
        gain = "" if self.gain == 1.0 else f", gain × {self.gain:g}"
        load = "" if self.load == "empty" else f", {self.load.replace('_', ' ')}"
        body = f", {self.body.replace('_', ' ')}" if self.body else ""
        robot = self.robot.replace("_", " ")
        return f"{robot}{body}: {self.path.replace('_', ' ')}{speed}{load}{gain}"


@dataclass(frozen=True)
class MatrixExperiment:
    """A cell, ready to be carried out."""

    cell: Cell
    row: StudyRow
    file: ExperimentFile


def expanded(
    document: YamlDocument, study: Study, folder: Path, problems: list[Problem]
) -> Iterator[MatrixExperiment]:
    """All cells of all matrices, in their order; what is wrong is added to the problems.

    Raises ConfigError where one of the experiments that they are made of is wrong by itself.
    """
    for number, matrix in enumerate(study.matrix):
        where: Location = ("matrix", number)
        path = folder / matrix.experiment
        if not is_file(path):
            text = f"there is no file {path}{did_you_mean_file(path)}"
            problems.append(document.problem((*where, "experiment"), text))
            continue
        base = load_experiment(path)
        for cell, trajectory, load, place in _cells(document, where, matrix, path, problems):
            try:
                file = _experiment(base, cell, trajectory, load)
            except ConfigError as error:
                problems += [document.problem(place, one.message) for one in error.problems]
                break
            row = StudyRow(experiment=matrix.experiment, label=cell.label)
            yield MatrixExperiment(cell, row, file)


def length_mm(trajectory: Trajectory) -> float:
    """Of one cycle's way."""
    times = np.union1d(np.linspace(0.0, trajectory.cycle_s, _SAMPLES + 1), trajectory.corners_s)
    points = np.array([trajectory.in_cycle(t_s)[0] for t_s in times])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _cells(
    document: YamlDocument,
    where: Location,
    matrix: StudyMatrix,
    experiment: Path,
    problems: list[Problem],
) -> Iterator[tuple[Cell, TrajectoryOptions, MatrixLoad, Location]]:
    bodies: Sequence[BodyName | None] = matrix.bodies or [None]
    for number, path in enumerate(matrix.paths):
        place = (*where, "paths", number, "trajectory")
        try:
            paced = _at_speeds(path, experiment.parent)
        except (OptionsError, ValueError) as error:
            problems.append(document.problem(place, str(error)))
            continue
        for body in bodies:
            for speed_mm_s, trajectory in paced:
                for load in matrix.loads:
                    for gain in matrix.gains:
                        cell = Cell(matrix.robot, body, path.path, speed_mm_s, load.load, gain)
                        yield cell, trajectory, load, place


def _at_speeds(path: MatrixPath, folder: Path) -> list[tuple[float | None, TrajectoryOptions]]:
    """The trajectory at each speed. Raises OptionsError, ValueError."""
    if not path.speeds_mm_s:
        return [(None, load_trajectory_options(path.trajectory))]
    if "cycle_s" in path.trajectory:
        raise ValueError("how long a cycle takes, speeds_mm_s say: leave out cycle_s")
    way_mm = length_mm(make_trajectory(_lasting(path, 1.0), folder))
    return [(speed, _lasting(path, way_mm / speed)) for speed in path.speeds_mm_s]


def _lasting(path: MatrixPath, cycle_s: float) -> TrajectoryOptions:
    return load_trajectory_options({**path.trajectory, "cycle_s": cycle_s})


def _experiment(
    base: ExperimentFile, cell: Cell, trajectory: TrajectoryOptions, load: MatrixLoad
) -> ExperimentFile:
    """Raises ConfigError."""
    fields = {} if cell.body is None else body_fields(base.experiment, cell.body)
    named = {"experiment": cell.name, "description": cell.label, "trajectory": trajectory}
    loaded = {"tip_load_g": load.tip_load_g, "happenings": load.happenings}
    return changed(base, {**fields, **named, **loaded})


def _in_a_name(value: float) -> str:
    return f"{value:g}".replace(".", "p")
