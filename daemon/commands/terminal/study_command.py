"""Carries out a study on the command line: progress while it lasts, tables at the end."""

import argparse
import sys
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from config.problems import ConfigError
from daemon.commands.terminal.command_line import EXIT_FAILED, EXIT_OK, EXIT_USAGE
from daemon.workbench.studies.error_tables import aims_text, trouble_text
from daemon.workbench.studies.findings import Findings, findings
from daemon.workbench.studies.grid import Grid
from daemon.workbench.studies.run import Outcome, PlanError, Run, plan
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
        "--keep-recordings", action="store_true", help="16 MB for each run of 400 s"
    )


def shipped_study(name: str) -> Path:
    """The file of a shipped study, or the path that is meant itself."""
    shipped = Path(str(files("config") / "studies" / f"{name}.yaml"))
    return shipped if shipped.is_file() else Path(name)


_PAGE_WIDTH: Final = 160
"""Where there is no terminal that has one."""

Tables = Callable[[StudyFile, Findings], list[Table]]
Figures = Callable[[StudyFile, Findings, Path], Iterator[tuple[str, Figure]]]


def carry_out_study(
    path: Path, arguments: argparse.Namespace, only: list[str], tables: Tables, figures: Figures
) -> int:
    """Do what is left of a study, and write it up. Returns the exit code."""
    try:
        file = load_study(path)
        whole, runs = _plans(file, arguments, only)
        errors = _carry_out(runs, arguments)
        found = findings(file, Grid(whole, arguments.out).outcomes(), len(whole))
        made = tables(file, found)
        written = write_up(file, found, arguments.out, made, figures)
    except PlanError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    except (ConfigError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    _show(file, found, made)
    print("\n".join(map(str, written)))
    return EXIT_FAILED if errors else EXIT_OK


def _plans(
    file: StudyFile, arguments: argparse.Namespace, only: list[str]
) -> tuple[list[Run], list[Run]]:
    """All runs, and those that are wanted now. Raises PlanError."""
    known = [*file.experiments, *(variant.variant for variant in file.study.variants)]
    unknown = [name for name in only if name not in known]
    if unknown:
        raise PlanError(
            f"there is no {', '.join(unknown)} in this study: there are {', '.join(known)}"
        )
    seeds = file.study.seeds if arguments.seeds is None else arguments.seeds
    plants = file.study.plants if arguments.plants is None else arguments.plants
    if arguments.jobs < 1 or seeds < 1 or plants < 0:
        raise PlanError("--seeds and --jobs are 1 or more, and --plants 0 or more")
    return plan(file, seeds, plants), plan(file, seeds, plants, only)


def _carry_out(runs: list[Run], arguments: argparse.Namespace) -> int:
    """Returns how many runs and models could not be done. Raises OSError."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    with _Bar(_console()) as bar:
        Grid(runs, arguments.out).carry_out(arguments.jobs, arguments.keep_recordings, bar)
    return bar.errors


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else _PAGE_WIDTH)


def _show(file: StudyFile, found: Findings, tables: list[Table]) -> None:
    console = _console()
    for table in tables:
        console.print(table.rich())
    for line in [*aims_text(file, found), *trouble_text(file, found)]:
        console.print(line, markup=False, highlight=False)


class _Bar:
    """How far the grid is: a bar on a terminal, and a line for each run in any case."""

    def __init__(self, console: Console) -> None:
        self.errors = 0
        """Runs and models that could not be done."""
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._console = console
        self._models = self._runs = self._progress.add_task("", visible=False)

    def __enter__(self) -> "_Bar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def begin(self, done: int, models: int, runs: int) -> None:
        if done:
            self._tell(f"{done} runs are done already")
        if models:
            self._models = self._progress.add_task("pre-training", total=models)
        self._runs = self._progress.add_task("runs", total=done + runs, completed=done)

    def model(self, run: Run, error: str) -> None:
        if error:
            self.errors += 1
        self._tell(f"model for plant {run.plant}, seed {run.seed}{f': {error}' if error else ''}")
        self._progress.advance(self._models)

    def run(self, run: Run, outcome: Outcome | None, error: str) -> None:
        if error:
            self.errors += 1
        self._tell(f"{run}: {error or _in_words(outcome)}")
        self._progress.advance(self._runs)

    def _tell(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False)


def _in_words(outcome: Outcome | None) -> str:
    if outcome is None or outcome.result is None or outcome.failure:
        return f"given up: {outcome.failure if outcome else '?'}"
    means = ", ".join(f"{cycle.mean_mm:.2f}" for cycle in outcome.result.cycles)
    held = f", held {outcome.result.holds} times" if outcome.result.holds else ""
    return f"{means} mm{held}"
