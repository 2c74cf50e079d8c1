"""Carries out a study on the command line: progress while it lasts, tables at the end."""

import argparse
import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Final, Literal, NamedTuple

from matplotlib.figure import Figure
from rich.console import Console

from config.paths import is_file
from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.compiled import compile_all, telling_progress
from daemon.commands.terminal.event_log import add_log_argument, style_of
from daemon.commands.terminal.progress_line import ProgressLine
from daemon.commands.terminal.work_sharing import add_scheduler_argument, share
from daemon.files import make_folder
from daemon.host.logs import Log, logging_to_stderr
from daemon.workbench.experiments.construction import check_happenings
from daemon.workbench.studies.error_tables import aims_text, trouble_text
from daemon.workbench.studies.findings import Findings, findings
from daemon.workbench.studies.grid import Grid
from daemon.workbench.studies.run import Outcome, PlanError, Run, plan, shared
from daemon.workbench.studies.study_file import StudyFile, load_study
from daemon.workbench.studies.table import Table
from daemon.workbench.studies.write_up import write_up

# The words on the command line that say which study, how much of it, and where to.


def add_grid_arguments(parser: argparse.ArgumentParser) -> None:
    """What is to be run, and where it goes."""
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="for runs, tables and pictures; runs that are there and finished are not done again",
    )
    parser.add_argument("--seeds", type=int, metavar="N", help="instead of the study's")
    parser.add_argument(
        "--plants", type=int, metavar="N", help="instead of the study's; 0: the robot file's own"
    )
    parser.add_argument(
        "--jobs", type=int, default=2, metavar="N", help="processes at the same time (default 2)"
    )
    parser.add_argument(
        "--share",
        type=share,
        metavar="I/N",
        help="only every N-th run, for one of N machines: put their folders into one afterwards, "
        "and run it without --share, which writes the tables",
    )
    add_scheduler_argument(parser)
    parser.add_argument(
        "--keep-recordings", action="store_true", help="16 MB for each run of 400 s"
    )
    add_log_argument(parser)


def shipped_study(name: str) -> Path:
    """The file of a shipped study, or the path that is meant itself."""
    shipped = Path(str(files("config") / "studies" / f"{name}.yaml"))
    return shipped if is_file(shipped) else Path(name)


_PAGE_WIDTH: Final = 160
"""Where there is no terminal that has one."""

Tables = Callable[[StudyFile, Findings], list[Table]]
Figures = Callable[[StudyFile, Findings, Path], Iterator[tuple[str, Figure]]]


Only = Mapping[Literal["experiments", "controllers", "experiments and controllers"], list[str]]
"""Names of what alone shall run; none: all."""


class WriteUp(NamedTuple):
    """How a study is written up."""

    tables: Tables
    figures: Figures
    files: Callable[[StudyFile, Findings], Mapping[str, bytes]] = lambda _file, _found: {}
    """More of it, by name."""


def carry_out_study(
    path: Path,
    arguments: argparse.Namespace,
    only: Only,
    written_as: Callable[[StudyFile], WriteUp],
) -> Result:
    """Do what is left of a study, and write it up. Raises ConfigError, PlanError, OSError."""
    file = load_study(path)
    how = written_as(file)
    whole, runs = _plans(file, arguments, only)
    if arguments.share is not None:
        return _carry_out_share(whole, runs, arguments)
    errors = carry_out_runs(runs, arguments)
    found = findings(file, Grid(whole, arguments.out).outcomes(), len(whole))
    made = how.tables(file, found)
    more = how.files(file, found)
    written = write_up(file, found, arguments.out, made, how.figures, more)

    def show() -> None:
        _show(file, found, made)
        print("\n".join(map(str, written)))

    told = {"study": file.study.study, "runs": len(whole), "errors": errors, "written": written}
    return Result(told, show, EXIT_FAILED if errors else EXIT_OK)


def _plans(
    file: StudyFile, arguments: argparse.Namespace, only: Only
) -> tuple[list[Run], list[Run]]:
    """All runs, and those that are wanted now. Raises ConfigError, PlanError."""
    for what, names in only.items():
        known = _names(file, what)
        unknown = [name for name in names if name not in known]
        if unknown:
            raise PlanError(
                f"there is no {', '.join(unknown)} among the study's {what}: "
                f"there are {', '.join(known)}"
            )
    seeds = file.study.seeds if arguments.seeds is None else arguments.seeds
    plants = file.study.plants if arguments.plants is None else arguments.plants
    if arguments.jobs < 1 or seeds < 1 or plants < 0:
        raise PlanError("--seeds and --jobs are 1 or more, and --plants 0 or more")
    wanted = plan(file, seeds, plants, [name for names in only.values() for name in names])
    for experiment in {run.experiment for run in wanted}:
        check_happenings(file.experiments[experiment])
    return plan(file, seeds, plants), wanted


def _names(file: StudyFile, what: str) -> list[str]:
    """Of a study's experiments, its controllers, or both."""
    controllers = [variant.variant for variant in file.study.variants]
    return [
        *(file.experiments if what != "controllers" else ()),
        *(controllers if what != "experiments" else ()),
    ]


def carry_out_runs(runs: list[Run], arguments: argparse.Namespace) -> int:
    """Returns how many runs and models could not be done. Raises OSError."""
    make_folder(arguments.out)
    with (
        telling_progress() as progress,
        logging_to_stderr("study", style=style_of(arguments)) as log,
    ):
        told = _Told(progress, log if arguments.log else None)
        grid = Grid(runs, arguments.out)
        away = arguments.scheduler or ""
        if grid.left and not away:
            compile_all()  # here, once, and not in each process
        grid.carry_out(arguments.jobs, arguments.keep_recordings, told, away)
    return told.errors


def _carry_out_share(whole: list[Run], runs: list[Run], arguments: argparse.Namespace) -> Result:
    """Without tables: a part of the runs tells nothing that is to be compared. Raises OSError."""
    mine = shared(runs, arguments.share)
    errors = carry_out_runs(mine, arguments)
    there = len(Grid(whole, arguments.out).outcomes())
    return Result(
        {"share": str(arguments.share), "mine": len(mine), "there": there, "runs": len(whole)},
        f"share {arguments.share}: {len(mine)} runs; {there} of {len(whole)} are in the folder",
        EXIT_FAILED if errors else EXIT_OK,
    )


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else _PAGE_WIDTH)


def _show(file: StudyFile, found: Findings, tables: list[Table]) -> None:
    console = _console()
    for table in tables:
        console.print(table.rich())
    for line in [*aims_text(file, found), *trouble_text(file, found)]:
        console.print(line, markup=False, highlight=False)


class _Told:
    """How far the grid is, and a line for each run."""

    def __init__(self, progress: ProgressLine, log: Log | None = None) -> None:
        """log: for the same lines, where somebody wants them on stderr."""
        self._log = log
        self.errors = 0
        """Runs and models that could not be done."""
        self._progress = progress
        self._models = self._runs = self._done = 0

    def begin(self, done: int, models: int, runs: int) -> None:
        if done:
            self._progress.tell(f"{done} runs are done already")
        self._models, self._runs, self._done = models, done + runs, done
        if models:
            self._progress.begin("models to begin with", float(models))
        elif runs:
            self._begin_runs()

    def model(self, run: Run, error: str) -> None:
        told = f": {error}" if error else ""
        self._tell(f"model for plant {run.plant}, seed {run.seed}{told}", error)
        self.errors += bool(error)
        self._models -= 1
        self._progress.advance()
        if not self._models:
            self._begin_runs()

    def run(self, run: Run, outcome: Outcome | None, error: str) -> None:
        self._tell(f"{run}: {error or _in_words(outcome)}", error)
        self.errors += bool(error)
        self._done += 1
        self._progress.reach(float(self._done), what=self._what)

    def _begin_runs(self) -> None:
        self._progress.begin(self._what, float(self._runs), float(self._done))

    @property
    def _what(self) -> str:
        return f"runs: {self._done} of {self._runs} done"

    def _tell(self, line: str, error: str) -> None:
        if self._log is None:
            self._progress.tell(line)
        else:
            level = logging.ERROR if error else logging.INFO
            self._log.tell(level, "study", line, done=self._done, runs=self._runs)


def _in_words(outcome: Outcome | None) -> str:
    if outcome is not None and outcome.refused:
        return f"refused: {outcome.failure}"
    if outcome is None or outcome.result is None or outcome.failure:
        return f"given up: {outcome.failure if outcome else '?'}"
    means = ", ".join(f"{cycle.mean_mm:.2f}" for cycle in outcome.result.cycles)
    held = f", held {outcome.result.holds} times" if outcome.result.holds else ""
    return f"{means} mm{held}"
