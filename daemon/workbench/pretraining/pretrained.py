"""The model that an experiment's controller begins with: made or found before the trial."""

from dataclasses import replace
from pathlib import Path

from config.experiment import Pretraining
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.trial import Tell, TrialError


def with_model(file: ExperimentFile, seed: int, tell: Tell) -> ExperimentFile:
    """The experiment whose controller has its model; the same one where there is nothing to do.

    seed: the experiment's. Takes a while where the model has to be made. Not to be called from an
    event loop. Raises TrialError, OSError.
    """
    pretraining = file.experiment.pretraining
    if pretraining is None or not needs_model(file):
        return file
    path = _model(file, pretraining, seed if pretraining.seed is None else pretraining.seed, tell)
    controller = file.experiment.controller.model_copy(update={"model": str(path)})
    return replace(file, experiment=file.experiment.model_copy(update={"controller": controller}))


def needs_model(file: ExperimentFile) -> bool:
    """Whether the controller knows models, and none is named."""
    controller = file.experiment.controller
    return "model" in type(controller).model_fields and getattr(controller, "model", None) is None


def _model(file: ExperimentFile, pretraining: Pretraining, seed: int, tell: Tell) -> Path:
    """Of this experiment's body, with nothing at its tip."""
    # Most experiments have their model, or want none, and what learns is slow to come.
    from daemon.learning.forward.pretraining import PretrainingError
    from daemon.workbench.pretraining.model_cache import pretrained

    emulation = file.robot.emulation
    assert emulation is not None
    unloaded = emulation.model_copy(update={"tip_load_g": 0.0})
    robot_file = replace(file.file, robot=file.robot.model_copy(update={"emulation": unloaded}))
    try:
        return pretrained(robot_file, pretraining.waypoints, seed, tell)
    except PretrainingError as error:
        raise TrialError(str(error)) from error
