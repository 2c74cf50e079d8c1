"""Carries out the runs of a study in several processes, and again only what is not done yet."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from pathlib import Path
from typing import Protocol, TypeVar

from daemon.host.processes import worker_processes
from daemon.workbench.cluster.cluster_workers import cluster_workers
from daemon.workbench.pretraining.model_cache import needs_model
from daemon.workbench.studies.run import Outcome, Run, read_outcome
from daemon.workbench.studies.worker import (
    Files,
    bring_home,
    carry_out_run,
    carry_out_run_away,
    make_model,
    make_model_away,
)

T = TypeVar("T")


class GridProgress(Protocol):
    """Hears how far it is."""

    def begin(self, done: int, models: int, runs: int) -> None:
        """`done` runs are there; `models` and `runs` are to be made."""
        ...

    def model(self, run: Run, error: str) -> None:
        """A model was made for this run and others; or not, and why."""
        ...

    def run(self, run: Run, outcome: Outcome | None, error: str) -> None:
        """A run is done; or it could not be done, and why."""
        ...


class Grid:
    """All runs, done or not."""

    def __init__(self, runs: Sequence[Run], root: Path) -> None:
        self._runs = runs
        self._root = root

    def outcomes(self) -> list[Outcome]:
        """Of all runs that are done, in the order of the plan."""
        found = (read_outcome(run, self._root) for run in self._runs)
        return [outcome for outcome in found if outcome is not None]

    @property
    def left(self) -> list[Run]:
        """All that are not done."""
        return [run for run in self._runs if read_outcome(run, self._root) is None]

    def carry_out(
        self, jobs: int, keep_recordings: bool, progress: GridProgress, scheduler: str = ""
    ) -> None:
        """Do what is left. A run that cannot be done is told, and the others go on.

        jobs: processes at the same time. keep_recordings: 16 MB for an experiment of 400 s.
        scheduler: of a dask cluster, instead of processes here. Raises ClusterError,
        ClusterMismatchError, OSError.
        """
        left = self.left
        models = _one_for_each_model(left)
        progress.begin(len(self._runs) - len(left), len(models), len(left))
        if not left:
            return
        if scheduler:
            with cluster_workers(scheduler) as workers:
                self._carry_out_away(workers, models, left, keep_recordings, progress)
            return
        with worker_processes(min(jobs, len(left))) as workers:
            for run, made in _each(workers, models, make_model):
                progress.model(run, _error(made))
            for run, future in _each(workers, left, carry_out_run, self._root, keep_recordings):
                error = _error(future)
                progress.run(run, None if error else future.result(), error)

    def _carry_out_away(
        self,
        workers: Executor,
        models: list[Run],
        left: list[Run],
        keep_recordings: bool,
        progress: GridProgress,
    ) -> None:
        """What comes out of each run is written here, as soon as it has come home."""
        made_there: Files = {}
        for run, made in _each(workers, models, make_model_away):
            error = _error(made)
            made_there.update({} if error else made.result())
            progress.model(run, error)
        tasks = _each(workers, left, carry_out_run_away, keep_recordings, made_there)
        for run, future in tasks:
            error, outcome = _error(future), None
            if not error:
                outcome, files = future.result()
                bring_home(run, self._root, files)
            progress.run(run, outcome, error)


def _one_for_each_model(runs: Iterable[Run]) -> list[Run]:
    """Runs whose models are all that are needed: two processes must not make the same."""
    models: dict[tuple[object, ...], Run] = {}
    for run in runs:
        experiment = run.file.experiment
        if experiment.pretraining is not None and (run.foreseen or needs_model(run.file)):
            seed = experiment.pretraining.seed
            known = experiment.pretraining.plant
            body = (experiment.robot, str(experiment.plant), run.plant)
            if known is not None:
                body = (experiment.robot, str(known), -1)
            how = experiment.pretraining.model_dump_json(exclude={"plant", "seed"})
            # Who is asked for the risk of the path is asked while the body is explored, too.
            asked = experiment.risk and run.file.robot.risk.model is not None
            of = (body, how, run.seed if seed is None else seed, asked)
            models.setdefault(of, run)
    return list(models.values())


def _each(
    workers: Executor, runs: Iterable[Run], task: Callable[..., T], *more: object
) -> Iterator[tuple[Run, "Future[T]"]]:
    """Each run when its task has ended, whatever came first."""
    futures = {workers.submit(task, run, *more): run for run in runs}
    for future in as_completed(futures):
        yield futures[future], future


def _error(future: "Future[T]") -> str:
    error = future.exception()
    return "" if error is None else f"{type(error).__name__}: {error}"
