"""The laboratory that a test gets: it carries out experiments, and keeps what they leave."""

import fcntl
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from config.documents.problems import did_you_mean
from config.paths import BUILTIN
from daemon.host.writable_places import ensure_writable_places, own_temporary_folder
from daemon.recording.result import read_result
from daemon.testing.tracking_result import TrackingResult
from daemon.workbench.experiments.construction import check_happenings
from daemon.workbench.experiments.experiment_file import ExperimentFile, load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.trial import TrialError
from daemon.workbench.pretraining.model_cache import with_model
from sim_backends.lab.bodies import another_body

_COMPILING: Final = "compiling.lock"


class TrackingFailed(AssertionError):  # noqa: N818 - it is what an assertion raises
    """A run that did not come to its end. Says why, and what there is of it."""


class TestLab:
    """Experiments, one after the other. Their folders are below one of the test's own."""

    __test__ = False  # pytest takes it for tests by its name

    def __init__(self, here: Path, folder: Path, *, real_time: bool) -> None:
        """here: where relative names of files begin."""
        self.runs: list[TrackingResult] = []
        self._here, self._folder = here, folder
        self._real_time = real_time
        ensure_writable_places()
        _compile_once()

    def run(
        self,
        experiment: str | Path,
        *,
        seed: int | None = None,
        plant: int = 0,
        happenings: Sequence[Mapping[str, Any]] | None = None,
        may_end_early: bool = False,
        **overrides: Any,
    ) -> TrackingResult:
        """Carry out an experiment file; `builtin:rectangle` is one that is shipped.

        seed: instead of the file's. plant: 0 is the body of the file, others are of its design.
        happenings, overrides: instead of the file's keys of these names; a mapping goes into the
        file's, key by key. Raises ConfigError for what is wrong with the file, ValueError for a
        seed or plant below 0, and TrackingFailed where it does not come to its end, but for
        `may_end_early`.
        """
        given = {**overrides, **({} if happenings is None else {"happenings": list(happenings)})}
        if (seed or 0) < 0 or plant < 0:
            raise ValueError(f"seed {seed}, plant {plant}: neither is below 0")
        file = load_experiment(self._path(experiment), given)
        check_happenings(file)
        number = file.experiment.seed if seed is None else seed
        if plant:
            file = _on_another_body(file, plant)
        name = f"run-{len(self.runs)}"
        folder = self._folder / name
        folder.mkdir(parents=True)
        problem = ""
        try:
            self._carry_out(with_model(file, number, _quiet), number, folder)
        except TrialError as error:
            problem = str(error)
        result = read_result(folder)
        if result is None:
            raise TrackingFailed(f"{name} left nothing: {problem}")
        run = TrackingResult(name, folder, number, plant, result, problem)
        self.runs.append(run)
        if problem and not may_end_early:
            raise TrackingFailed(f"{run!r} did not come to its end: {problem}")
        return run

    def _carry_out(self, file: ExperimentFile, seed: int, folder: Path) -> None:
        if self._real_time:
            from daemon.workbench.experiments.in_real_time import carry_out_in_real_time

            carry_out_in_real_time(file, seed, folder, _quiet)
        else:
            carry_out_in_virtual_time(file, seed, folder, _quiet)

    def _path(self, experiment: str | Path) -> Path:
        name = str(experiment)
        if not name.startswith(BUILTIN):
            return self._here / name
        shipped = Path(str(files("config") / "experiments"))
        path = shipped / f"{name.removeprefix(BUILTIN)}.yaml"
        if not path.is_file():
            known = [f"{BUILTIN}{one.stem}" for one in shipped.glob("*.yaml")]
            raise FileNotFoundError(f"there is no {name}{did_you_mean(name, known)}")
        return path


def _quiet(_: str) -> None:
    """What is told meanwhile is in the recording."""


def _on_another_body(file: ExperimentFile, plant: int) -> ExperimentFile:
    assert file.robot.emulation is not None  # experiments have one
    other = another_body(file.robot.emulation, plant)
    return replace(file, robot=file.robot.model_copy(update={"emulation": other}))


def _compile_once() -> None:
    """Kernels are compiled by one of the processes that run tests, and loaded by the others: two
    that write one cache at the same time have ended in segmentation faults (numba 4807)."""
    from daemon.controllers.make_controller import warm_up
    from sim_backends.plants.shooting import warm_up as warm_up_plant

    with (own_temporary_folder() / _COMPILING).open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        warm_up()
        warm_up_plant()


def keep(folder: Path, place: Path) -> None:
    """A copy of a run, with its report where one can be drawn."""
    from daemon.workbench.report.report import write_report

    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(folder, place)
    with suppress(ValueError, OSError):
        write_report(place)
