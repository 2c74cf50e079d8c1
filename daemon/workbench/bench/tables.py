"""The bench as tables: who wins where, what is said of ours, and every figure of every cell."""

import csv
import io
from collections.abc import Sequence
from math import isfinite
from typing import Final

import msgspec

from daemon.recording.run_folder import formatted_json
from daemon.workbench.bench.judgement import (
    CRITERION,
    CellFindings,
    Figures,
    Verdict,
    cell_findings,
    verdict,
)
from daemon.workbench.studies.findings import Findings
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.table import Section, Table, number

CSV_FILE: Final = "bench.csv"
JSON_FILE: Final = "bench.json"
_WINNERS: Final = (
    "Settled error in mm: the median of the means of the last cycles (the later half, without "
    "the first) of the filtered tip, medians over seeds, with the true tip's in brackets. "
    "**Bold**: the best, or within noise of the best. failed: held, unstable, given up or refused "
    "in half of the runs or more. × 1.2: the path was slowed, and took so many times as long. "
    "Floor: the filtered error for the tracker's noise alone. "
)
_ALL: Final = (
    "Errors of the filtered tip in mm (of the true tip). First: mean of the first cycle. Worst: "
    "the worst moment. Back: from a load's change until the error is below 1 mm for a whole "
    "second, the slowest of all changes (∞: not before the next one). Over: how far the tip then "
    "went to the other side. Effort: way of all axes together, in travels, per metre of the "
    "reference's path. Acceleration: of all axes, root mean square by second differences, in "
    "travels per s²: the less the smoother. Expected: errors by what the controller itself "
    "expected, both root mean square, without the seconds after a load's change; about 1 where it "
    "knows how sure it may be. Time: in times of what the path says. Ratio: of the settled error "
    "to the cell's best."
)


def bench_tables(file: StudyFile, found: Findings) -> list[Table]:
    """Who wins where; where ours does not; everything."""
    cells = cell_findings(file, found.runs)
    tables = [_winners(file, cells)]
    if file.study.judged is not None:
        said = verdict(file.study.judged, cells)
        if said.behind:
            tables.append(_behind(file, cells, said))
    return [*tables, _everything(file, cells)]


def bench_files(file: StudyFile, found: Findings) -> dict[str, bytes]:
    """The same for programs."""
    cells = cell_findings(file, found.runs)
    judged = file.study.judged
    whole = _Bench(
        study=file.study.study,
        criterion=CRITERION,
        tuned=file.searched,
        verdict=None if judged is None else verdict(judged, cells),
        cells=cells,
    )
    return {CSV_FILE: _csv(cells), JSON_FILE: formatted_json(whole)}


def verdict_text(said: Verdict) -> str:
    """What the cells say of ours, in a sentence or two."""
    text = (
        f"{said.ours} is best, or within noise of the best, in {said.best} of {said.cells} cells; "
        f"at worst its error is {number(said.worst_ratio)} times the best one's. Learning makes "
        f"{len(said.worse_than_without_learning)} cells worse by more than noise"
    )
    worse = said.worse_than_without_learning
    text += f" ({', '.join(worse)})." if worse else "."
    if said.refused:
        text += f" {said.refused} cells are refused before the start: the axes are too slow."
    return text + (" All of this was aimed at." if said.reached else " More was aimed at.")


class _Bench(msgspec.Struct, frozen=True, kw_only=True):
    study: str
    criterion: str
    tuned: str
    verdict: Verdict | None
    cells: list[CellFindings]


def _winners(file: StudyFile, cells: Sequence[CellFindings]) -> Table:
    variants = file.study.variants
    head = ["", *(variant.label for variant in variants), "floor"]
    judged = file.study.judged
    said = "" if judged is None else f" {verdict_text(verdict(judged, cells))}"
    tuned = file.searched or "The controllers were not tuned: their figures are the study's own."
    note = f"{_WINNERS}{CRITERION} {tuned}{said}"
    table = Table(file.study.description or file.study.study, head, note=note)
    for heading in dict.fromkeys(cell.group for cell in cells):
        section = Section(heading)
        for cell in cells:
            if cell.group == heading:
                words = [_cell_text(cell, variant.variant) for variant in variants]
                floors = [one.floor_mm for one in cell.figures if one.floor_mm is not None]
                floor = number(min(floors)) if floors else "–"
                section.rows.append([cell.short_label, *words, floor])
        table.sections.append(section)
    return table


def _cell_text(cell: CellFindings, variant: str) -> str:
    figures = cell.of(variant)
    if cell.refused:
        return "refused"
    if figures is None:
        return ""
    if figures.failed:
        return f"failed: {figures.trouble}"
    text = number(figures.settled_mm)
    text = f"**{text}**" if figures.within_noise else text
    longer = "" if figures.in_time else f" × {figures.times_as_long:.2f}"
    return f"{text} ({number(figures.true_settled_mm)}){longer}"


def _behind(file: StudyFile, cells: Sequence[CellFindings], said: Verdict) -> Table:
    labels = {variant.variant: variant.label for variant in file.study.variants}
    by_name = {cell.cell: cell for cell in cells}
    title = f"Where {labels[said.ours]} is not best, the farthest behind first"
    table = Table(title, ["", "ours mm", "best mm", "ratio", "best is"])
    section = Section("")
    for name in said.behind:
        cell = by_name[name]
        ours, best = cell.of(said.ours), cell.best
        assert ours is not None and best is not None
        section.rows.append(
            [
                cell.label,
                number(ours.settled_mm),
                number(best.settled_mm),
                number(ours.ratio),
                labels[best.variant],
            ]
        )
    table.sections.append(section)
    return table


_COLUMNS: Final = (
    *("", "settled", "first", "worst", "back s", "over mm", "effort", "acceleration"),
    *("expected", "time", "ratio", "runs"),
)


def _everything(file: StudyFile, cells: Sequence[CellFindings]) -> Table:
    table = Table("Every controller in every cell", _COLUMNS, note=_ALL)
    labels = {variant.variant: variant.label for variant in file.study.variants}
    for cell in cells:
        section = Section(cell.label)
        if cell.refused:
            section.rows.append(["refused", *[""] * (len(_COLUMNS) - 1)])
        else:
            section.rows += [_whole_row(labels[one.variant], one) for one in cell.figures]
        table.sections.append(section)
    return table


def _whole_row(label: str, one: Figures) -> list[str]:
    return [
        label,
        f"{number(one.settled_mm)} ({number(one.true_settled_mm)})",
        f"{number(one.first_mm)} ({number(one.true_first_mm)})",
        f"{number(one.worst_mm)} ({number(one.true_worst_mm)})",
        ""
        if one.recovery_s is None
        else f"{number(one.recovery_s)} ({number(one.true_recovery_s)})",
        number(one.overshoot_mm),
        number(one.effort_per_m, 1),
        number(one.acceleration_per_s2),
        number(one.against_expected),
        number(one.times_as_long),
        number(one.ratio) + (" ✓" if one.within_noise else ""),
        f"{one.runs}: {one.trouble}" if one.trouble else str(one.runs),
    ]


_CSV_COLUMNS: Final = (
    *("settled_mm", "first_mm", "worst_mm", "true_settled_mm", "true_first_mm", "true_worst_mm"),
    *("floor_mm", "recovery_s", "true_recovery_s", "overshoot_mm", "effort_per_m"),
    *("acceleration_per_s2", "against_expected", "times_as_long", "ratio"),
)


def _csv(cells: Sequence[CellFindings]) -> bytes:
    """A line for each controller in each cell; what failed has no figures."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    head = ("cell", "robot", "body", "variant", "runs", "trouble", *_CSV_COLUMNS, "within_noise")
    writer.writerow(head)
    for cell in cells:
        for one in cell.figures:
            values = [getattr(one, name) for name in _CSV_COLUMNS]
            shown = [f"{v:.4f}" if v is not None and isfinite(v) else "" for v in values]
            about = [cell.cell, cell.robot, cell.body or "", one.variant, one.runs, one.trouble]
            writer.writerow([*about, *shown, int(one.within_noise)])
    return lines.getvalue().encode()
