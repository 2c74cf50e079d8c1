"""One picture of all controllers: the mean error by cycle, experiment by experiment."""

from collections.abc import Sequence
from math import isfinite
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from config.tasks.study import Variant
from daemon.workbench.report.report_style import SERIES, figure
from daemon.workbench.studies.findings import Findings
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.summary import Summary

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
    handles, labels = panels.flat[0].get_legend_handles_labels()
    made.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
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
