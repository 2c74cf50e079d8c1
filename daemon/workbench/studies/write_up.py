"""What a study leaves beside its runs: tables for people and for programs, and pictures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from config.tasks.study import StudyFigure, StudyTable, Variant
from daemon.files import write_whole
from daemon.recording.run_folder import formatted_json
from daemon.reference.trajectories import make_trajectory
from daemon.workbench.experiments.carry_out import STEPS_FILE
from daemon.workbench.experiments.step_statistics import StepSeries
from daemon.workbench.report.report_style import styled
from daemon.workbench.studies.error_tables import (
    aims_text,
    comparison_table,
    error_table,
    more_table,
    trouble_text,
)
from daemon.workbench.studies.figures import Shown, comparison_figure, run_figure
from daemon.workbench.studies.findings import Findings
from daemon.workbench.studies.pose_table import pose_table
from daemon.workbench.studies.run import Outcome, run_folder
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.summary import cycle_mean_mm
from daemon.workbench.studies.table import Table

TABLES_FILE: Final = "tables.md"
DATA_FILE: Final = "tables.json"
COMPARISON_FIGURE: Final = "comparison.png"
_DPI: Final = 160
_COMMIT_DIGITS: Final = 12


def reproduction_tables(file: StudyFile, found: Findings) -> list[Table]:
    """The paper's tables with ours in them, each followed by what else was seen."""
    return [
        make(file, table, found)
        for table in file.study.tables
        for make in (_makes_poses(table), more_table)
    ]


def _makes_poses(table: StudyTable) -> Callable[[StudyFile, StudyTable, Findings], Table]:
    """By coordinates, where the paper has it so; else by cycles."""
    return pose_table if any(row.published_pose for row in table.rows) else error_table


def comparison_tables(file: StudyFile, found: Findings) -> list[Table]:
    """One."""
    return [comparison_table(file, found)]


def write_up(
    file: StudyFile,
    found: Findings,
    root: Path,
    tables: Sequence[Table],
    figures: Callable[[StudyFile, Findings, Path], Iterator[tuple[str, Figure]]],
    files: Mapping[str, bytes] | None = None,
) -> list[Path]:
    """Write everything into `root`; returns where it is. Raises OSError.

    files: more of it, by name.
    """
    pictures = []
    with styled():
        for name, made in figures(file, found, root):
            made.savefig(root / name, dpi=_DPI, metadata={"Software": None})
            pictures.append(root / name)
    write_whole(root / DATA_FILE, formatted_json(found))
    names = [picture.name for picture in pictures]
    write_whole(root / TABLES_FILE, _text(file, found, tables, names).encode())
    more = []
    for name, data in (files or {}).items():
        write_whole(root / name, data)
        more.append(root / name)
    return [root / TABLES_FILE, root / DATA_FILE, *more, *pictures]


def reproduction_figures(
    file: StudyFile, found: Findings, root: Path
) -> Iterator[tuple[str, Figure]]:
    """For each of the study's figures one picture of each variant, by the name of its file."""
    for wanted in file.study.figures:
        for variant in file.study.variants:
            rows = [
                row
                for name in wanted.experiments
                if (row := _shown(file, found, root, name, variant)) is not None
            ]
            if rows:
                title = f"{wanted.title}: {variant.label}"
                yield _picture_name(wanted, variant), run_figure(title, rows)


def comparison_figures(
    file: StudyFile, found: Findings, root: Path
) -> Iterator[tuple[str, Figure]]:
    """One, where anything was run."""
    del root
    if found.summaries:
        yield COMPARISON_FIGURE, comparison_figure(file, found)


def median_run(outcomes: Sequence[Outcome], cycle: int) -> Outcome:
    """The one in the middle by its error in this cycle; of two, the better one."""
    ordered = sorted(outcomes, key=lambda one: (cycle_mean_mm(one, cycle), one.plant, one.seed))
    return ordered[(len(ordered) - 1) // 2]


def _shown(
    file: StudyFile, found: Findings, root: Path, experiment: str, variant: Variant
) -> Shown | None:
    """None: no run of it has left its steps."""
    mine = found.of(experiment, variant.variant)
    steps: dict[int, StepSeries] = {}
    outcomes = []
    for outcome in found.runs:
        if (outcome.experiment, outcome.variant) == (experiment, variant.variant):
            series = _steps(root, outcome)
            if series is not None:
                steps[id(outcome)] = series
                outcomes.append(outcome)
    if mine is None or not outcomes:
        return None
    options = file.experiments[experiment]
    middle = median_run(outcomes, len(mine.cycles) - 1)
    return Shown(
        label=file.rows[experiment].label,
        run=steps[id(middle)],
        runs=list(steps.values()),
        cycle_s=make_trajectory(options.experiment.trajectory, options.path.parent).cycle_s,
        noise_mm=None if mine.noise_mm is None else mine.noise_mm.median,
        published=file.rows[experiment].published,
        source=file.study.source,
    )


def _steps(root: Path, outcome: Outcome) -> StepSeries | None:
    where = (outcome.experiment, outcome.variant, outcome.plant, outcome.seed)
    try:
        series = StepSeries.load(run_folder(root, *where) / STEPS_FILE)
    except (OSError, ValueError, KeyError):
        return None
    return series if len(series.t_s) > 1 else None


def _picture_name(wanted: StudyFigure, variant: Variant) -> str:
    return f"{wanted.figure}-{variant.variant}.png"


def _text(
    file: StudyFile, found: Findings, tables: Sequence[Table], pictures: Sequence[str]
) -> str:
    study = file.study
    parts = [f"# {study.description or study.study}\n", _runs_text(found)]
    parts += [table.markdown() for table in tables]
    for heading, lines in (
        ("Aims", aims_text(file, found)),
        ("What did not go well", trouble_text(file, found)),
    ):
        if lines:
            parts.append("\n".join([f"### {heading}", "", *(f"- {line}" for line in lines), ""]))
    parts += [f"![{name.removesuffix('.png')}]({name})\n" for name in pictures]
    return "\n".join(parts)


def _runs_text(found: Findings) -> str:
    text = f"{len(found.runs)} of {found.planned} runs, in virtual time."
    if found.commits:
        text += f" Made by {', '.join(map(_short, found.commits))}."
    return text + "\n"


def _short(commit: str) -> str:
    """With its `+`, where files differed from it."""
    return commit[:_COMMIT_DIGITS] + ("+" if commit.endswith("+") else "")
