"""The bench as one picture: a row for each cell, a column for each controller."""

from collections.abc import Iterator, Sequence
from math import isfinite, log
from pathlib import Path
from textwrap import wrap
from typing import Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from daemon.workbench.bench.judgement import CellFindings, Figures, cell_findings
from daemon.workbench.report.report_style import figure
from daemon.workbench.studies.findings import Findings
from daemon.workbench.studies.study_file import StudyFile

BENCH_FIGURE: Final = "bench.png"
_MOST_RATIO: Final = 5.0
"""Beyond it all are the same colour."""
_COLOURS: Final = "YlOrRd"
_FAILED: Final = "#4a4a4a"
_REFUSED: Final = "#d9d9d9"
_DARK_ABOVE: Final = 0.6
"""Of the colours: what stands on these is white."""
_LETTERS: Final = 15
"""In a line above a column."""
_ROW_INCHES: Final = 0.24
_MARGIN_INCHES: Final = 1.9
_TICKS: Final = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0)


def bench_figures(file: StudyFile, found: Findings, root: Path) -> Iterator[tuple[str, Figure]]:
    """One, where anything was run."""
    del root
    cells = cell_findings(file, found.runs)
    if cells:
        yield BENCH_FIGURE, bench_figure(file, cells)


def bench_figure(file: StudyFile, cells: Sequence[CellFindings]) -> Figure:
    """Colour: ratio of the settled error to the cell's best. Text: the settled error in mm."""
    groups = list(dict.fromkeys(cell.group for cell in cells))
    rows = len(cells) + len(groups)
    made = figure(_MARGIN_INCHES + _ROW_INCHES * rows)
    made.set_layout_engine("constrained")
    axes = made.subplots()
    row, names = 0, list[tuple[float, str]]()
    for group in groups:
        names.append((row + 0.62, group))
        row += 1
        for cell in cells:
            if cell.group == group:
                names.append((row + 0.5, cell.short_label))
                _draw_cell(axes, row, cell, file)
                row += 1
    _frame(axes, file, rows)
    axes.set_yticks(*map(list, zip(*names, strict=True)), fontsize=7)
    for label in axes.get_yticklabels():
        label.set_fontweight("bold" if label.get_text() in groups else "normal")
    bar = made.colorbar(
        ScalarMappable(LogNorm(1.0, _MOST_RATIO), mpl.colormaps[_COLOURS]),
        ax=axes,
        orientation="horizontal",
        fraction=0.03,
        pad=0.02,
        aspect=50,
        extend="max",
    )
    bar.set_ticks(list(_TICKS), labels=[f"{tick:g}" for tick in _TICKS])
    bar.ax.minorticks_off()
    bar.set_label(
        "settled error against the cell's best (figures: mm; framed: best, or within noise of it; "
        "×: slowed, and took so many times as long)"
    )
    return made


def _draw_cell(axes: Axes, row: int, cell: CellFindings, file: StudyFile) -> None:
    for column, variant in enumerate(file.study.variants):
        one = cell.of(variant.variant)
        colour, text, white = _look(cell, one)
        axes.add_patch(Rectangle((column, row), 1, 1, facecolor=colour, edgecolor="white", lw=0.8))
        axes.text(
            column + 0.5,
            row + 0.52,
            text,
            ha="center",
            va="center",
            fontsize=6.5,
            color="white" if white else "black",
        )
        if one is not None and one.within_noise:
            inner = (column + 0.03, row + 0.07)
            axes.add_patch(
                Rectangle(inner, 0.94, 0.86, fill=False, edgecolor="black", lw=1.1, zorder=3)
            )


def _look(cell: CellFindings, one: Figures | None) -> tuple[object, str, bool]:
    """Colour, text, and whether this is white."""
    if cell.refused:
        return _REFUSED, "refused", False
    if one is None:
        return "white", "", False
    if one.failed or not isfinite(one.ratio):
        return _FAILED, one.trouble.partition(" ")[2] or "failed", True
    share = min(max(log(one.ratio), 0.0) / log(_MOST_RATIO), 1.0)
    text = f"{one.settled_mm:.2f}" + ("" if one.in_time else f" × {one.times_as_long:.2f}")
    return mpl.colormaps[_COLOURS](share), text, share > _DARK_ABOVE


def _frame(axes: Axes, file: StudyFile, rows: int) -> None:
    variants = file.study.variants
    axes.set_xlim(0, len(variants))
    axes.set_ylim(rows, 0)
    axes.xaxis.tick_top()
    axes.set_xticks(
        [column + 0.5 for column in range(len(variants))],
        [_wrapped(variant.label) for variant in variants],
        fontsize=6,
    )
    axes.tick_params(length=0)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _wrapped(label: str) -> str:
    """On lines of their own: what stands between commas, and no line too long for a column."""
    lines = [line for part in label.split(", ") for line in wrap(part, _LETTERS)]
    return "\n".join(lines)
