"""Models of emulated robots, made when they are first asked for, and kept.

A model belongs to the robot file with everything in it, the emulated body included, to what is in
the files that it names, and to how it was made. Where any of this changes, there is another model.
"""

import hashlib
import json
import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from config.loader import RobotFile
from config.robot import Robot
from config.tasks.experiment import Pretraining
from config.tasks.exploration import DesignedExploration, WaypointExploration
from daemon.array_files import ModelError
from daemon.files import models_directory
from daemon.host.progress import Progress
from daemon.learning.forward.pretrained_model import KIND, PretrainedModel
from daemon.learning.forward.pretraining import EpochErrors, PretrainingSettings, pretrain
from daemon.learning.samples.motion_samples import SamplingSettings
from daemon.workbench.experiments.experiment_file import ExperimentFile, known_plant
from daemon.workbench.experiments.named_files import robot_contents
from daemon.workbench.experiments.trial import Tell, TrialError
from daemon.workbench.pretraining.explore import Exploring, config_sha256, explore

_RECIPE: Final = 11
"""Another number for models that come out otherwise from the same settings."""
_KEY_DIGITS: Final = 16
_EXPLAINS_TOO_LITTLE: Final = 0.2
"""R²: models of the shipped bodies have 0.6 to 0.9, and one of motions as poor as Ho's 0.3. One of
0.03 held a long, supple arm six times on its way, which without a model was not held."""
_EXPLAINS_TOO_LITTLE_THAT_TURNS: Final = 0.6
"""... where axes turn round: what they do goes by sines. Whoever follows models of 0.3 to 0.46 is
led up to 20 mm off, until motions contradict them; without one it is 0.1 mm."""
_AS_SERVES_BEST: Final = Pretraining()


def pretrained(
    file: RobotFile,
    how: Pretraining = _AS_SERVES_BEST,
    seed: int = 1,
    tell: Tell = lambda _: None,
    directory: Path | None = None,
    progress: Progress | None = None,
) -> Path:
    """The model of this emulated robot with nothing at its tip: found, or made in virtual time.

    The same arguments give the same model. Not to be called from an event loop: it runs one of its
    own.
    how: it is explored and learnt; of which body, and with which seed, is not looked at here. tell,
    progress: hear what is done, where something has to be, and how far that is. directory: instead
    of the usual one.
    Raises TrialError and PretrainingError where the robot cannot be explored, OSError.
    """
    options, settings = _exploration(how), _settings(how, seed)
    folder = models_directory() if directory is None else directory
    path = folder / f"{file.robot.robot}-{_key(file, options, settings, seed)}.npz"
    if (found := _usable(path, file)) is not None:
        _tell_doubt(found, file.robot, tell)
        return path
    folder.mkdir(parents=True, exist_ok=True)
    tell(f"exploring {file.robot.robot} in virtual time: {_amount(options, file.robot)}")
    with tempfile.TemporaryDirectory(prefix="tentacled-") as run:
        dataset = explore(file, options, seed, Path(run), tell, progress=progress)
    tell(f"learning from {dataset.frames.duration_s:.0f} s of motion")
    learnt = pretrain(dataset, settings, epochs_told(settings, progress))
    model = PretrainedModel.of(learnt, dataset)
    model.save(path)
    tell(f"the model is kept in {path}")
    _tell_doubt(model, file.robot, tell)
    return path


def _exploration(how: Pretraining) -> Exploring:
    if how.waypoints is None:
        return DesignedExploration(kind="designed_exploration")
    given = {"dither_share": how.dither_share, "home_every": how.home_every}
    lines = {name: value for name, value in given.items() if value is not None}
    options = {"kind": "waypoint_exploration", "waypoints": how.waypoints, **lines}
    return WaypointExploration.model_validate(options)


def _settings(how: Pretraining, seed: int) -> PretrainingSettings:
    given = {
        "tip_mm": how.sample_tip_mm,
        "travel_share": how.sample_travel_share,
        "averaged_share": how.averaged_share,
    }
    sampling = SamplingSettings(**{key: one for key, one in given.items() if one is not None})
    return PretrainingSettings(
        fields=how.fields,
        test_share=how.test_share,
        seed=seed,
        sampling=sampling,
        lag_s=how.lag_s,
    )


def _amount(options: Exploring, robot: Robot) -> str:
    if isinstance(options, DesignedExploration):
        return f"{options.lasts_s(len(robot.axes)):.0f} s of motion"
    return f"{options.waypoints} waypoints"


def epochs_told(
    settings: PretrainingSettings, progress: Progress | None
) -> Callable[[EpochErrors], None]:
    """For `pretrain`: its epochs as progress."""
    if progress is None:
        return lambda _: None
    progress.begin("learning", float(settings.epochs))
    return lambda errors: progress.reach(float(errors.epoch))


def _usable(path: Path, file: RobotFile) -> PretrainedModel | None:
    try:
        return PretrainedModel.load(path, file.robot)
    except (ModelError, FileNotFoundError):
        return None


def _tell_doubt(model: PretrainedModel, robot: Robot, tell: Tell) -> None:
    """Whoever goes by a model that says little of the body is led astray by it."""
    turns = any(axis.period is not None for axis in robot.axes)
    enough = _EXPLAINS_TOO_LITTLE_THAT_TURNS if turns else _EXPLAINS_TOO_LITTLE
    longer = "" if turns else "explore for longer (`pretraining: {waypoints: 80}`), or "
    fit = model.fit
    if fit is not None and fit.r2 < enough:
        tell(
            f"the model explains {max(fit.r2, 0.0):.0%} of the motions that it is judged by: "
            f"{longer}leave `pretraining` out, and the controller learns from its first motions"
        )


def _key(file: RobotFile, options: Exploring, settings: PretrainingSettings, seed: int) -> str:
    made_of: dict[str, Any] = {
        "config": config_sha256(file),
        "exploration": options.model_dump(mode="json"),
        "pretraining": asdict(settings),
        "seed": seed,
        "version": version("tentacled"),
        "format": KIND,
        "recipe": _RECIPE,
    }
    files = robot_contents(file)
    if files:
        made_of["files"] = files
    text = json.dumps(made_of, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_DIGITS]


# The model that an experiment's controller begins with: made or found before the trial.


def with_model(
    file: ExperimentFile, seed: int, tell: Tell, progress: Progress | None = None
) -> ExperimentFile:
    """The experiment whose controller has its model; the same one where there is nothing to do.

    seed: the experiment's. Takes a while where the model has to be made. Not to be called from an
    event loop. Raises TrialError, OSError.
    """
    pretraining = file.experiment.pretraining
    if pretraining is None or not needs_model(file):
        return file
    path = _model(
        file, pretraining, seed if pretraining.seed is None else pretraining.seed, tell, progress
    )
    controller = file.experiment.controller.model_copy(update={"model": str(path)})
    return replace(file, experiment=file.experiment.model_copy(update={"controller": controller}))


def needs_model(file: ExperimentFile) -> bool:
    """Whether the controller knows models, and none is named."""
    controller = file.experiment.controller
    return "model" in type(controller).model_fields and getattr(controller, "model", None) is None


def _model(
    file: ExperimentFile,
    pretraining: Pretraining,
    seed: int,
    tell: Tell,
    progress: Progress | None,
) -> Path:
    """Of this experiment's body, or of the one that it says is known, with nothing at its tip.
    Where nobody is asked for the risk of the path, nobody is while it is explored."""
    # Most experiments have their model, or want none, and what learns is slow to come.
    from daemon.learning.forward.pretraining import PretrainingError
    from daemon.workbench.pretraining.model_cache import pretrained

    emulation = file.robot.emulation
    assert emulation is not None
    unloaded = emulation.model_copy(update={"tip_load_g": 0.0})
    known = known_plant(file)
    if known is not None:
        unloaded = unloaded.model_copy(update={"plant": known})
    alone: dict[str, Any] = {"emulation": unloaded}
    if not file.experiment.risk:
        alone["risk"] = file.robot.risk.model_copy(update={"model": None})
    robot_file = replace(file.file, robot=file.robot.model_copy(update=alone))
    try:
        return pretrained(robot_file, pretraining, seed, tell, progress=progress)
    except PretrainingError as error:
        raise TrialError(str(error)) from error
