"""Carries out one run of a study, in whatever process it is called."""

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import msgspec

from daemon.controllers.make_controller import make_controller
from daemon.files import models_directory, write_whole
from daemon.learning.forward.forward_fit import ForwardFit
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.recording.result import read_result
from daemon.recording.run_folder import PROVENANCE_FILE, RUN_FILES, Provenance
from daemon.workbench.experiments.construction import why_too_fast
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.measures import measures_of
from daemon.workbench.experiments.trial import RefusedTrialError, TrialError
from daemon.workbench.pretraining.model_cache import with_model
from daemon.workbench.studies.run import Outcome, Run, write_outcome


def carry_out_run(run: Run, root: Path, keep_recording: bool) -> Outcome:
    """Leaves a folder that is there whole or not at all. Raises OSError, ModelError.

    keep_recording: 16 MB for an experiment of 400 s.
    """
    folder = run.folder(root)
    partial = folder.with_name(f".{folder.name}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    outcome = _outcome(run, partial)
    write_outcome(partial, outcome)
    if not keep_recording:
        for recording in partial.glob(RUN_FILES):
            recording.unlink()
    shutil.rmtree(folder, ignore_errors=True)
    partial.rename(folder)
    return outcome


def make_model(run: Run) -> None:
    """Make what the run's controller has to know before, unless it is there. Raises as above."""
    with_model(_with_one_that_needs_it(run), run.seed, _nobody)


def _with_one_that_needs_it(run: Run) -> ExperimentFile:
    """The experiment with a controller that wants the model, if only the one that is asked whether
    the path can be followed."""
    return as_asked(run) if run.foreseen else run.file


# On a machine that shares no disk with ours: what is needed goes there, what comes out comes home.


Files = dict[str, bytes]
"""By name."""


def carry_out_run_away(run: Run, keep_recording: bool, models: Files) -> tuple[Outcome, Files]:
    """As `carry_out_run`, with the files that it would leave in the run's folder.

    models: those that may be wanted, as `make_model_away` has made them.
    """
    _take_models(models)
    with tempfile.TemporaryDirectory(prefix="tentacled-") as name:
        root = Path(name)
        outcome = carry_out_run(run, root, keep_recording)
        folder = run.folder(root)
        return outcome, {path.name: path.read_bytes() for path in folder.iterdir()}


def make_model_away(run: Run) -> Files:
    """As `make_model`, with the model's file."""
    file = with_model(_with_one_that_needs_it(run), run.seed, _nobody)
    path = Path(str(getattr(file.experiment.controller, "model", "")))
    return {path.name: path.read_bytes()}


def bring_home(run: Run, root: Path, files: Files) -> None:
    """Leaves the run's folder whole or not at all. Raises OSError."""
    folder = run.folder(root)
    partial = folder.with_name(f".{folder.name}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for name, data in files.items():
        write_whole(partial / Path(name).name, data)
    shutil.rmtree(folder, ignore_errors=True)
    partial.rename(folder)


def _take_models(models: Files) -> None:
    """Where they are not there yet: making one takes longer than a run."""
    folder = models_directory()
    for name, data in models.items():
        path = folder / Path(name).name
        if not path.is_file():
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(path, data)


def _outcome(run: Run, folder: Path) -> Outcome:
    refusal, failure, fit = "", "", None
    fingerprint = run.fingerprint  # of files as they are now, and not when it has ended
    try:
        refusal = _why_forbidden(run) if run.foreseen else ""
        if not refusal:
            file = with_model(run.file, run.seed, _nobody)
            fit = _fit(file)
            carry_out_in_virtual_time(file, run.seed, folder, _nobody)
    except RefusedTrialError as error:
        refusal = str(error)
    except TrialError as error:
        failure = str(error)
    return Outcome(
        experiment=run.experiment,
        variant=run.variant,
        plant=run.plant,
        seed=run.seed,
        fingerprint=fingerprint,
        fit=fit,
        failure=failure or refusal,
        refused=bool(refusal),
        measures=measures_of(run.file, folder),
        result=read_result(folder),
        commit=_commit(folder),
    )


def _why_forbidden(run: Run) -> str:
    """Why the axes are too slow for the path, whichever controller follows it; empty: they are not,
    or the experiment has no pre-training, and nobody knows.

    The model may have to be made. Raises TrialError, OSError.
    """
    if run.file.experiment.pretraining is None:
        return ""
    ready = with_model(as_asked(run), run.seed, _nobody)
    controller = make_controller(ready.experiment.controller, ready.robot, run.seed)
    return why_too_fast(ready, controller) or ""


def as_asked(run: Run) -> ExperimentFile:
    """The experiment with the controller that is asked whether its path can be followed."""
    experiment = run.file.experiment.model_copy(update={"controller": run.asked})
    return replace(run.file, experiment=experiment)


def _fit(file: ExperimentFile) -> ForwardFit | None:
    """Of the model that it begins with. None: there is none, or it does not say."""
    model = getattr(file.experiment.controller, "model", None)
    if file.experiment.pretraining is None or model is None:
        return None
    return PretrainedModel.load(Path(model), file.robot).fit


def _commit(folder: Path) -> str | None:
    try:
        data = (folder / PROVENANCE_FILE).read_bytes()
        read = msgspec.json.decode(data, type=Provenance)
    except (OSError, msgspec.MsgspecError):
        return None
    return read.version if read.commit is None else read.commit + ("+" if read.modified else "")


def _nobody(line: str) -> None:
    """Hears what happens."""
