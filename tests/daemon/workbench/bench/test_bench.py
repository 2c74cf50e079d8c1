"""Who wins a cell, who is within noise of the best, and what is said of ours: made-up outcomes."""

import json
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path

import msgspec
import pytest

from daemon.workbench.bench.figure import bench_figure
from daemon.workbench.bench.judgement import (
    CellFindings,
    Figures,
    Verdict,
    cell_findings,
    relative_noise,
    verdict,
)
from daemon.workbench.bench.tables import bench_files, bench_tables
from daemon.workbench.experiments.measures import Measures, Recovery
from daemon.workbench.report.report_style import styled
from daemon.workbench.studies.findings import Findings
from daemon.workbench.studies.run import Outcome
from daemon.workbench.studies.study_file import StudyFile, load_study
from tests.daemon.workbench.studies import made_up

STUDY = """
study: small
matrix:
  - robot: arm
    experiment: calm.yaml
    paths:
      - path: circle
        trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 10}
        speeds_mm_s: [5, 10, 20]
variants:
  - {variant: ours, label: ours}
  - {variant: plain, label: without learning}
  - {variant: other, label: another}
judged: {ours: ours, without_learning: plain}
seeds: 2
plants: 0
"""
Errors = Mapping[str, Mapping[str, Sequence[float]]]
CELLS = ("arm_circle_5_empty", "arm_circle_10_empty", "arm_circle_20_empty")


@pytest.fixture
def file(tmp_path: Path) -> StudyFile:
    return load_study(made_up.write_study(tmp_path, STUDY))


def measures(settled_mm: float, back_s: float | None = 0.5, times_as_long: float = 1.0) -> Measures:
    return Measures(
        floor_mm=0.26,
        first_mm=2.0 * settled_mm,
        settled_mm=settled_mm,
        worst_mm=5.0 * settled_mm,
        true_first_mm=settled_mm,
        true_settled_mm=settled_mm + 0.1,
        true_worst_mm=settled_mm,
        recoveries=[
            Recovery(
                at_s=1.0,
                load_g=30.0,
                peak_mm=9.0,
                back_s=back_s,
                true_back_s=0.4,
                overshoot_mm=1.5,
            )
        ],
        effort_per_m=6.0,
        acceleration_per_s2=0.7,
        times_as_long=times_as_long,
    )


def outcomes(cell: str, variant: str, settled_mm: Sequence[float]) -> list[Outcome]:
    """A run for each error; an infinite one was given up, and what is below 0 refused."""
    made = []
    for seed, error_mm in enumerate(settled_mm, start=1):
        run = made_up.outcome([1.0], seed, cell, variant)
        changes = {
            "failure": "why" if error_mm in (inf, -1.0) else "",
            "refused": error_mm == -1.0,
            "measures": None if error_mm in (inf, -1.0) else measures(error_mm),
        }
        made.append(type(run)(**{**{n: getattr(run, n) for n in run.__struct_fields__}, **changes}))
    return made


def cells_of(file: StudyFile, errors: Errors) -> list[CellFindings]:
    return cell_findings(file, runs(errors))


def runs(errors: Errors) -> list[Outcome]:
    return [
        one
        for cell, by_variant in errors.items()
        for variant, settled in by_variant.items()
        for one in outcomes(cell, variant, settled)
    ]


def said_of(file: StudyFile, cells: Sequence[CellFindings]) -> Verdict:
    assert file.study.judged is not None
    return verdict(file.study.judged, cells)


def in_cell(cell: CellFindings, variant: str) -> Figures:
    found = cell.of(variant)
    assert found is not None
    return found


def test_the_least_settled_error_wins_and_who_differs_by_less_than_noise_is_with_it(
    file: StudyFile,
) -> None:
    errors = {"ours": [0.50, 0.54], "plain": [0.54, 0.58], "other": [0.80, 0.86]}
    (cell,) = cells_of(file, {CELLS[0]: errors})
    assert cell.best is in_cell(cell, "ours")
    assert [one.within_noise for one in cell.figures] == [True, True, False]
    assert in_cell(cell, "other").ratio == pytest.approx(0.83 / 0.52)
    assert in_cell(cell, "ours").true_settled_mm == pytest.approx(0.62)


def test_nobody_is_within_noise_by_being_unsteady(file: StudyFile) -> None:
    errors = {"ours": [0.50, 0.51], "plain": [0.40, 1.20], "other": [0.50, 0.51]}
    (cell,) = cells_of(file, {CELLS[0]: errors})
    assert relative_noise(cell.figures) < 0.03
    assert not in_cell(cell, "plain").within_noise


def test_who_failed_in_half_of_the_runs_is_the_worst(file: StudyFile) -> None:
    errors = {"ours": [0.5, inf], "plain": [3.0, 3.1], "other": [inf, inf]}
    (cell,) = cells_of(file, {CELLS[0]: errors})
    assert cell.best is in_cell(cell, "plain")
    assert [one.failed for one in cell.figures] == [True, False, True]
    assert in_cell(cell, "ours").trouble == "1 failed"
    assert in_cell(cell, "ours").ratio == inf


def test_who_slows_the_path_wins_nothing_by_it_and_is_told_with_its_time(file: StudyFile) -> None:
    kept: Errors = {CELLS[0]: {"ours": [0.5, 0.5], "plain": [0.7, 0.7]}}
    late = [
        msgspec.structs.replace(one, measures=measures(0.3, times_as_long=1.4))
        for one in outcomes(CELLS[0], "other", [0.3, 0.3])
    ]
    found = Findings(
        study="small",
        planned=6,
        commits=[],
        summaries=[],
        aims=[],
        runs=[*runs(kept), *late],
    )
    (cell,) = cell_findings(file, found.runs)
    assert cell.best is in_cell(cell, "ours")
    assert [one.within_noise for one in cell.figures] == [True, False, False]
    assert in_cell(cell, "other").ratio == pytest.approx(0.6)
    assert said_of(file, [cell]).best == 1
    winners, *_ = bench_tables(file, found)
    assert winners.sections[0].rows[0][3] == "0.30 (0.40) × 1.40"
    with styled():
        made = bench_figure(file, [cell])
    assert [text.get_text() for text in made.axes[0].texts] == ["0.50", "0.70", "0.30 × 1.40"]


def test_a_cell_that_all_refuse_counts_for_nobody(file: StudyFile) -> None:
    refused = {"ours": [-1.0, -1.0], "plain": [-1.0, -1.0], "other": [-1.0, -1.0]}
    good = {"ours": [0.5, 0.5], "plain": [0.7, 0.7], "other": [0.6, 0.6]}
    cells = cells_of(file, {CELLS[0]: good, CELLS[1]: refused})
    assert [bool(cell.refused) for cell in cells] == [False, True]
    said = said_of(file, cells)
    assert (said.cells, said.refused, said.best, said.reached) == (1, 1, 1, True)


def test_what_is_said_of_ours_names_where_it_falls_short(file: StudyFile) -> None:
    cells = cells_of(
        file,
        {
            CELLS[0]: {"ours": [0.5, 0.5], "plain": [0.7, 0.7], "other": [0.6, 0.6]},
            CELLS[1]: {"ours": [0.9, 0.9], "plain": [0.6, 0.6], "other": [1.1, 1.1]},
            CELLS[2]: {"ours": [0.9, 0.9], "plain": [1.2, 1.2], "other": [0.3, 0.3]},
        },
    )
    said = said_of(file, cells)
    assert (said.best, said.cells) == (1, 3)
    assert said.behind == [CELLS[2], CELLS[1]]
    assert said.worst_ratio == pytest.approx(3.0)
    assert said.worse_than_without_learning == [CELLS[1]]
    assert not said.reached


def test_tables_files_and_picture_hold_all_of_it(file: StudyFile) -> None:
    errors: Errors = {
        CELLS[0]: {"ours": [0.9, 0.9], "plain": [0.7, 0.7], "other": [inf, inf]},
        CELLS[1]: {"ours": [-1.0, -1.0], "plain": [-1.0, -1.0], "other": [-1.0, -1.0]},
    }
    found = Findings(
        study="small", planned=12, commits=[], summaries=[], aims=[], runs=runs(errors)
    )
    winners, behind, everything = bench_tables(file, found)
    first, second = winners.sections[0].rows
    assert first == ["circle 5 mm/s", "0.90 (1.00)", "**0.70** (0.80)", "failed: 2 failed", "0.26"]
    assert second[1:4] == ["refused"] * 3
    assert "were not tuned" in winners.note
    assert "best, or within noise of the best, in 0 of 1 cells" in winners.note
    assert behind.sections[0].rows[0][-2:] == ["1.29", "without learning"]
    assert everything.sections[0].rows[0][4:6] == ["0.50 (0.40)", "1.50"]
    files = bench_files(file, found)
    assert files["bench.csv"].decode().splitlines()[1].startswith("arm_circle_5_empty,arm,,ours,2,")
    told = json.loads(files["bench.json"])
    assert told["verdict"]["behind"] == [CELLS[0]]
    assert told["cells"][0]["figures"][2]["settled_mm"] is None
    with styled():
        made = bench_figure(file, cell_findings(file, found.runs))
    words = [text.get_text() for text in made.axes[0].texts]
    assert words == ["0.90", "0.70", "failed", "refused", "refused", "refused"]
