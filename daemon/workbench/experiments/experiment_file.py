"""Reads an experiment file, and the robot file that it names: sound, or every problem at once."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from config.documents.problems import ConfigError, Problem, did_you_mean, did_you_mean_file
from config.documents.schema_errors import schema_problems
from config.documents.yaml_document import Location, YamlDocument, read_yaml
from config.emulation.bodies import BodyName, body_figures
from config.emulation.lab import Emulation
from config.emulation.plants import Plant
from config.loader import RobotFile
from config.paths import BUILTIN, is_file, named_model
from config.robot import Robot
from config.tasks.controllers import position_only
from config.tasks.experiment import Experiment
from daemon.recording.run_folder import describe_run
from daemon.robot.checked_robot import check_robot


@dataclass(frozen=True)
class ExperimentFile:
    """A sound experiment, with its robot, whose plant is already the overridden one."""

    path: Path
    experiment: Experiment
    file: RobotFile
    robot: Robot
    document: YamlDocument

    def problem(self, location: Location, message: str) -> Problem:
        """A problem at `location` of this file, found by a check that lives elsewhere."""
        return self.document.problem(location, message)

    def describe(
        self, folder: Path, wall_ns: int | None, seed: int, surroundings: bytes = b""
    ) -> None:
        """Write into a run's folder what is run, with which model. Raises OSError.

        wall_ns: None in virtual time. surroundings: a binary STL file, mm.
        """
        model = getattr(self.experiment.controller, "model", None)
        models = {} if model is None else {"controller": named_model(model)}
        describe_run(
            folder, self.robot, self.file.path, wall_ns, seed, models, surroundings=surroundings
        )


def load_experiment(path: Path, overrides: Mapping[str, Any] | None = None) -> ExperimentFile:
    """Raises ConfigError with every problem of the file.

    overrides: instead of the file's keys; a mapping goes into the file's, key by key.
    """
    document = read_yaml(path)
    problems = list(document.problems)
    if overrides and isinstance(document.value, dict):
        document = replace(document, value=_merged(document.value, overrides))
    if not problems:
        try:
            experiment = Experiment.model_validate(document.value)
        except ValidationError as error:
            problems += schema_problems(document, Experiment, error)
        else:
            return _with_robot(path, document, experiment)
    raise ConfigError(problems)


def _merged(values: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Another `kind` begins anew: its options are not those of the file's."""
    merged = dict(values)
    for key, value in overrides.items():
        before = values.get(key)
        merged[key] = value
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            kind = before.get("kind")
            merged[key] = {**before, **value} if value.get("kind", kind) == kind else value
    return merged


def _with_robot(path: Path, document: YamlDocument, experiment: Experiment) -> ExperimentFile:
    named = robot_path(experiment.robot, path)
    if not is_file(named):
        text = f"there is no file {named}{_robot_meant(experiment.robot, named)}"
        raise ConfigError([document.problem(("robot",), text)])
    file = check_robot(named).file
    if file.robot.emulation is None:
        text = "experiments need an emulated robot, and this one has no 'emulation'"
        raise ConfigError([document.problem(("robot",), text)])
    return _of_robot(path, document, experiment, file)


def _of_robot(
    path: Path, document: YamlDocument, experiment: Experiment, file: RobotFile
) -> ExperimentFile:
    assert file.robot.emulation is not None
    overridden = _overridden(document, file.robot.emulation, experiment)
    robot = file.robot.model_copy(update={"emulation": overridden})
    if experiment.tracking_error_mm is not None:
        allowed = {"tracking_error_mm": experiment.tracking_error_mm}
        supervision = robot.supervision.model_copy(update=allowed)
        robot = robot.model_copy(update={"supervision": supervision})
    problems = _why_not_carried_out(document, experiment, robot, path.parent)
    if problems:
        raise ConfigError(problems)
    return ExperimentFile(path, experiment, file, robot, document)


def _robot_meant(name: str, path: Path) -> str:
    """What may have been meant by the name of a robot file that is not there."""
    if not name.startswith(BUILTIN):
        return did_you_mean_file(path)
    return did_you_mean(name, (f"{BUILTIN}{file.stem}" for file in path.parent.glob("*.yaml")))


def _why_not_carried_out(
    document: YamlDocument, experiment: Experiment, robot: Robot, folder: Path
) -> list[Problem]:
    """Why the trajectory cannot be followed, as far as that is known without a controller, and
    what cannot happen on it."""
    # Who only wants to know where the robot file is does not wait for numpy.
    from daemon.control.reachability import Bounds, unreachable
    from daemon.reference.trajectories import make_trajectory

    try:
        trajectory = make_trajectory(experiment.trajectory, folder)
    except ValueError as error:
        return [document.problem(("trajectory",), str(error))]
    controller = experiment.controller
    speed = getattr(controller, "max_tip_speed_mm_s", None)
    alone = position_only(controller)
    bounds = Bounds(robot.workspace, tip_speed_mm_s=speed, position_only=alone)
    why = unreachable(trajectory, bounds)
    problems = [document.problem(("trajectory",), why)] if why else []
    for index, happening in enumerate(experiment.happenings):
        at_s, at_cycle = happening.at_s, happening.at_cycle
        if at_s is not None and at_s >= trajectory.duration_s:
            text = f"the trajectory is over after {trajectory.duration_s:g} s: this never happens"
            problems.append(document.problem(("happenings", index, "at_s"), text))
        if at_cycle is not None and at_cycle >= trajectory.cycles:
            last = trajectory.cycles - 1
            text = f"cycles count from 0, and the last one is {last}: this never happens"
            problems.append(document.problem(("happenings", index, "at_cycle"), text))
    return problems


def robot_path(name: str, path: Path) -> Path:
    """The robot file that the experiment at `path` names so."""
    if name.startswith(BUILTIN):
        return Path(str(files("config") / "robots" / f"{name.removeprefix(BUILTIN)}.yaml"))
    return path.parent / name


def _overridden(document: YamlDocument, emulation: Emulation, experiment: Experiment) -> Emulation:
    plant = emulation.plant
    below: tuple[str, ...] = ("plant",)
    try:
        other = other_plant(plant, experiment.plant)
        if experiment.pretraining is not None and experiment.pretraining.plant is not None:
            below = ("pretraining", "plant")
            other_plant(plant, experiment.pretraining.plant)
    except ValidationError as error:
        raise ConfigError(schema_problems(document, type(plant), error, *below)) from None
    update = {"plant": other, "tip_load_g": experiment.tip_load_g}
    return emulation.model_copy(update=update)


def other_plant(plant: Plant, overrides: Mapping[str, Any]) -> Plant:
    """Another body of the same kind: a named one's figures, where one is named, then the rest.

    Raises pydantic's ValidationError.
    """
    named = body_figures(plant.kind, overrides["body"]) if "body" in overrides else {}
    return type(plant).model_validate({**plant.model_dump(), **named, **overrides})


def known_plant(file: ExperimentFile) -> Plant | None:
    """The body that the controller knows before it begins, where the experiment says which.

    Raises pydantic's ValidationError.
    """
    pretraining, emulation = file.experiment.pretraining, file.file.robot.emulation
    if pretraining is None or pretraining.plant is None or emulation is None:
        return None
    return other_plant(emulation.plant, pretraining.plant)


def on_body(file: ExperimentFile, body: BodyName) -> ExperimentFile:
    """The experiment on a named body, under a name of its own.

    What the controller knows before it begins is still the body of the robot file, unless the
    experiment says which. Raises ConfigError.
    """
    name = f"{file.experiment.experiment}_{body}"
    return changed(file, {**body_fields(file.experiment, body), "experiment": name})


def body_fields(experiment: Experiment, body: BodyName) -> dict[str, Any]:
    """The experiment's fields that differ on a named body."""
    fields: dict[str, Any] = {"plant": {**experiment.plant, "body": body}}
    pretraining = experiment.pretraining
    if pretraining is not None and pretraining.plant is None:
        known = pretraining.model_copy(update={"plant": experiment.plant})
        fields["pretraining"] = known
    return fields


def changed(file: ExperimentFile, update: Mapping[str, Any]) -> ExperimentFile:
    """The experiment with other fields, on the same robot, checked as it was read.

    Raises ConfigError.
    """
    experiment = file.experiment.model_copy(update=update)
    return _of_robot(file.path, file.document, experiment, file.file)
