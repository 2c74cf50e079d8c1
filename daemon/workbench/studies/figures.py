"""A study's pictures: runs as papers show them, and all controllers beside each other.

Of a run: its path, a corner of it, and the error over time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from config.tasks.study import Published, Variant
from daemon.workbench.experiments.step_statistics import Array, StepSeries
from daemon.workbench.report.report_paths import plane_of
from daemon.workbench.report.report_style import (
    ACCENT,
    INK,
    MUTED,
    SERIES,
    WARNING,
    cycle_colours,
    figure,
)
from daemon.workbench.studies.findings import Findings
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.summary import Summary

_ROW_IN: Final = 2.9
_TRUE: Final = SERIES[2]
_DASHES: Final = (0, (4, 3))
_CORNER_SHARE: Final = 0.11
"""Of the path's larger side, to each side of the corner; less where errors are small ..."""
_CORNER_MM: Final = 3.0
"""... but not less than this."""
_SMOOTH_S: Final = 1.0
_BAND_EVERY_S: Final = 0.5


@dataclass(frozen=True)
class Shown:
    """One row of a figure: an experiment with one controller."""

    label: str
    run: StepSeries
    """The one that stands for all: the median one in its last cycle."""
    runs: Sequence[StepSeries]
    """All of them, this one too."""
    cycle_s: float
    noise_mm: float | None
    published: Published | None
    source: str


def run_figure(title: str, rows: Sequence[Shown]) -> Figure:
    """One row of three panels for each experiment."""
    made = figure(0.9 + _ROW_IN * len(rows))
    made.suptitle(title, x=0.01, ha="left", fontweight="bold")
    panels = made.subplots(len(rows), 3, squeeze=False, width_ratios=(1.0, 1.0, 2.6))
    for row, (path, corner, error) in zip(rows, panels, strict=True):
        centre, plane = plane_of(row.run.reference_mm)
        _draw_path(path, row.run, row.run.cycles, centre, plane)
        _draw_path(corner, row.run, [row.run.cycles[0], row.run.cycles[-1]], centre, plane)
        _draw_truth(corner, row.run, centre, plane)
        flat = (row.run.reference_mm - centre) @ plane.T
        _close_up(corner, flat, float(row.run.error_mm.max()))
        _draw_error(error, row)
        path.set_title(row.label)
        corner.set_title("A corner of it")
        error.set_title("Error over time")
    cycles = max((row.run.cycles for row in rows), key=len)
    made.legend(handles=_handles(rows, cycles), loc="outside lower center", ncols=5)
    return made


def _draw_path(
    axes: Axes, run: StepSeries, shown: Sequence[int], centre: Array, plane: Array
) -> None:
    cycles = run.cycles
    for number, colour in zip(cycles, cycle_colours(len(cycles)), strict=True):
        if number in shown:
            tip = (run.tip_mm[run.cycle == number] - centre) @ plane.T
            axes.plot(*tip.T, color=colour, lw=1.0)
    reference = (run.reference_mm[run.cycle == cycles[0]] - centre) @ plane.T
    axes.plot(*reference.T, color=INK, lw=0.9, ls=_DASHES)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("mm")
    axes.set_ylabel("mm")


def _draw_truth(axes: Axes, run: StepSeries, centre: Array, plane: Array) -> None:
    """Of the last cycle: what the tracker makes of it looks much rougher."""
    true = run.true_mm[run.cycle == run.cycles[-1]]
    if np.isfinite(true).all():
        axes.plot(*((true - centre) @ plane.T).T, color=_TRUE, lw=1.3)


def _close_up(axes: Axes, flat: Array, worst_mm: float) -> None:
    """Only the corner farthest along both directions of the plane, as near as errors permit.

    flat: (n, 2) the reference in its plane.
    """
    size = np.ptp(flat, axis=0)
    at = flat[int(np.argmax((flat / np.maximum(size, 1e-9)).sum(axis=1)))]
    half = min(_CORNER_SHARE * float(size.max()), max(_CORNER_MM, 2.0 * worst_mm))
    axes.set_aspect("equal", adjustable="box", anchor="N")
    axes.set_xlim(at[0] - 1.4 * half, at[0] + 0.6 * half)
    axes.set_ylim(at[1] - 1.4 * half, at[1] + 0.6 * half)


def _draw_error(axes: Axes, row: Shown) -> None:
    run = row.run
    grid_s = np.arange(0.0, float(run.t_s[-1]), _BAND_EVERY_S)
    if len(row.runs) > 1:
        courses = np.stack([_course(one, grid_s) for one in row.runs])
        low, high = np.nanmin(courses, axis=0), np.nanmax(courses, axis=0)
        axes.fill_between(grid_s, low, high, color=ACCENT, alpha=0.15, lw=0)
    axes.plot(run.t_s, run.error_mm, color=ACCENT, lw=0.5, alpha=0.4)
    axes.plot(grid_s, _course(run, grid_s), color=ACCENT, lw=1.2)
    for number in run.cycles:
        from_s, to_s = number * row.cycle_s, (number + 1) * row.cycle_s
        axes.axvline(to_s, color=MUTED, lw=0.9, ls=":")
        mean_mm = float(run.error_mm[run.cycle == number].mean())
        axes.plot([from_s, to_s], [mean_mm, mean_mm], color=INK, lw=1.3)
        if row.published is not None and number < len(row.published.mean_mm):
            published_mm = row.published.mean_mm[number]
            if published_mm is not None:
                axes.plot(
                    [from_s, to_s], [published_mm, published_mm], color=WARNING, lw=1.3, ls=_DASHES
                )
    if row.noise_mm is not None:
        axes.axhline(row.noise_mm, color=MUTED, lw=0.9)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(0.0, max(len(run.cycles) * row.cycle_s, float(run.t_s[-1])))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time / s")
    axes.set_ylabel("tip error / mm")


def _course(run: StepSeries, grid_s: Array) -> Array:
    """The error's mean over a second at each time; nan after the run's end."""
    sums = np.concatenate([[0.0], np.cumsum(run.error_mm)])
    first = np.searchsorted(run.t_s, grid_s - _SMOOTH_S / 2)
    last = np.searchsorted(run.t_s, grid_s + _SMOOTH_S / 2)
    count = last - first
    means = (sums[last] - sums[first]) / np.maximum(count, 1)
    return np.where(count > 0, means, np.nan)


def _handles(rows: Sequence[Shown], cycles: Sequence[int]) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=INK, lw=0.9, ls=_DASHES, label="reference")
    ]
    for number, colour in zip(cycles, cycle_colours(len(cycles)), strict=True):
        handles.append(Line2D([], [], color=colour, lw=1.6, label=f"tip, cycle {number + 1}"))
    if any(np.isfinite(row.run.true_mm).any() for row in rows):
        label = f"true tip, cycle {cycles[-1] + 1}"
        handles.append(Line2D([], [], color=_TRUE, lw=1.6, label=label))
    handles.append(Line2D([], [], color=ACCENT, lw=1.2, label="error over 1 s, median run"))
    if any(len(row.runs) > 1 for row in rows):
        handles.append(Patch(color=ACCENT, alpha=0.15, label="all runs"))
    handles.append(Line2D([], [], color=INK, lw=1.3, label="mean of the cycle"))
    if any(row.published is not None for row in rows):
        label = f"mean, {rows[0].source}"
        handles.append(Line2D([], [], color=WARNING, lw=1.3, ls=_DASHES, label=label))
    if any(row.noise_mm is not None for row in rows):
        handles.append(Line2D([], [], color=MUTED, lw=0.9, label="tracker's noise"))
    return handles


# All controllers: the mean error by cycle, experiment by experiment.


_ACROSS: Final = 3
_SPREAD_OF_LINES: Final = 0.36
"""Of the distance between two cycles: bars of different controllers stand beside each other."""
_TICKS_MM: Final = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 20.0, 50.0)


def comparison_figure(file: StudyFile, found: Findings) -> Figure:
    """A panel for each experiment that was run, with a line for each controller."""
    shown = [name for name in file.rows if any(s.experiment == name for s in found.summaries)]
    rows = -(-len(shown) // _ACROSS)
    made = figure(1.1 + 3.1 * rows)
    panels = made.subplots(rows, min(_ACROSS, len(shown)), squeeze=False, sharey=True)
    variants = file.study.variants
    shifts = np.linspace(-0.5, 0.5, len(variants)) * _SPREAD_OF_LINES if len(variants) > 1 else [0]
    for place, panel in enumerate(panels.flat):
        if place >= len(shown):
            panel.remove()
            continue
        for variant, shift in zip(variants, shifts, strict=True):
            mine = found.of(shown[place], variant.variant)
            if mine is not None:
                _draw(panel, mine, variant, variants, float(shift))
        panel.set_title(file.rows[shown[place]].label)
        _axes(panel, [one for one in found.summaries if one.experiment == shown[place]])
        if place % _ACROSS == 0:
            panel.set_ylabel("mean tip error / mm")
    drawn = {
        label: handle
        for panel in panels.flat[: len(shown)]
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    ordered = [one.label for one in variants if one.label in drawn]
    made.legend(
        [drawn[label] for label in ordered],
        ordered,
        loc="outside lower center",
        ncols=min(len(ordered), 6),
    )
    return made


def _draw(
    axes: Axes, mine: Summary, variant: Variant, variants: Sequence[Variant], shift: float
) -> None:
    """Medians with bars from the best run to the worst."""
    offline = variant.controller.get("learning") is False
    colour = _colour(variant, variants)
    places = np.array([cycle.cycle + 1 + shift for cycle in mine.cycles])
    means = [cycle.mean_mm for cycle in mine.cycles]
    middle = np.array([mean.median if isfinite(mean.median) else np.nan for mean in means])
    low = np.array([mean.low for mean in means])
    high = np.array([mean.high if isfinite(mean.high) else _TICKS_MM[-1] for mean in means])
    axes.vlines(places, np.minimum(low, high), high, color=colour, lw=1.6, alpha=0.45)
    axes.plot(
        places,
        middle,
        color=colour,
        lw=1.3,
        ls="--" if offline else "-",
        marker="o",
        ms=4.5,
        mfc="white" if offline else colour,
        label=variant.label,
    )


def _colour(variant: Variant, variants: Sequence[Variant]) -> str:
    """The same for one kind, learning or not."""
    kinds = list(dict.fromkeys(str(one.controller.get("kind")) for one in variants))
    return SERIES[kinds.index(str(variant.controller.get("kind"))) % len(SERIES)]


def _axes(axes: Axes, shown: Sequence[Summary]) -> None:
    count = max(len(one.cycles) for one in shown)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(FixedLocator(list(_TICKS_MM)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", length=0)
    axes.set_xticks(range(1, count + 1))
    axes.set_xlim(0.6, count + 0.4)
    axes.set_xlabel("cycle")
    axes.grid(visible=False, axis="x")
