"""What was planned while the run went on: where it was to lead, what it risks, what came of it."""

from collections.abc import Sequence
from html import escape
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from daemon.workbench.report.report_data import PlannedInRun, RunData, Series
from daemon.workbench.report.report_style import (
    ACCENT,
    INK,
    MUTED,
    WARNING,
    figure,
    panel_grid,
    series_colour,
    shade_states,
)

_NAMES: Final = "xyz"
_PROJECTIONS: Final = ((0, 2), (1, 2), (0, 1))
_MOST_DRAWN: Final = 6
"""The last so many: more are not told from each other."""
_HEADS: Final = (
    *("planned at / s", "file", "to / mm", "lasts / s", "way of the body / mm"),
    *("contact risk", "at most", "before refining", "clearance / mm", "eq. 10"),
)


def plans_table(plans: Sequence[PlannedInRun]) -> str:
    """HTML."""
    head = "".join(f'<th class="number">{name}</th>' for name in _HEADS)
    rows = "".join(_row(plan) for plan in plans)
    note = (
        "Contact risk: how likely any part of the body touches anything anywhere on the whole "
        "path, as the planner has it, and its upper limit. Equation 10 of Thompson et al. is no "
        "chance of touching."
    )
    return f'<table><tr>{head}</tr>{rows}</table><div class="note">{escape(note)}</div>'


def _row(plan: PlannedInRun) -> str:
    told = plan.told
    cells = (
        f"{plan.t_s:.2f}",
        told.file,
        ", ".join(f"{x:.1f}" for x in told.to_mm),
        f"{told.duration_s:.1f}",
        _number(plan.figure("length_mm"), "{:.0f}"),
        _number(plan.figure("contact_risk"), "{:.2%}"),
        _number(told.contact_risk, "{:.2%}"),
        _number(plan.before, "{:.2%}"),
        _number(told.clearance_mm, "{:.1f}"),
        _number(plan.figure("body_point_risk_eq_10"), "{:.1%}"),
    )
    inner = "".join(f'<td class="number">{escape(cell)}</td>' for cell in cells)
    return f"<tr>{inner}</tr>"


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)


def plans_figure(run: RunData) -> Figure | None:
    """Where the paths lead and where the tip went, the risk along each, and what was told on the
    way; None: no path can be drawn."""
    drawn = [(place, one) for place, one in enumerate(run.plans) if one.path is not None]
    drawn = drawn[-_MOST_DRAWN:]
    if not drawn:
        return None
    made = figure(8.4)
    grid = panel_grid(made, 3, 3, apart_in=0.6, heights=(4, 2, 2), under_in=0.3)
    for column, view in enumerate(_PROJECTIONS):
        _draw_ways(made.add_subplot(grid[0, column]), drawn, run.tip, view)
    _draw_courses(made.add_subplot(grid[1, :]), drawn)
    told = made.add_subplot(grid[2, :])
    _draw_told(told, drawn, run.risk)
    shade_states(told, run.states, run.duration_s)
    told.set_xlim(0.0, max(run.duration_s, 1e-3))
    handles = [
        Line2D([], [], color=series_colour(place), ls="--", label=f"planned at {one.t_s:.1f} s")
        for place, one in drawn
    ]
    made.legend(
        handles=[*handles, Line2D([], [], color=INK, lw=0.9, label="tip")],
        loc="lower center",
        ncols=len(handles) + 1,
    )
    return made


def _draw_ways(
    panel: Axes,
    drawn: Sequence[tuple[int, PlannedInRun]],
    tip: Series | None,
    view: tuple[int, int],
) -> None:
    across, up = view
    if tip is not None:
        went = tip["tip_mm"]
        panel.plot(went[:, across], went[:, up], color=INK, lw=0.9)
    for place, one in drawn:
        assert one.path is not None
        way, colour = np.array(one.path.tip_mm), series_colour(place)
        panel.plot(way[:, across], way[:, up], color=colour, lw=1.4, ls="--")
        panel.plot(way[-1, across], way[-1, up], "o", ms=5.0, color=colour)
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel(f"{_NAMES[across]} / mm")
    panel.set_ylabel(f"{_NAMES[up]} / mm")


def _draw_courses(panel: Axes, drawn: Sequence[tuple[int, PlannedInRun]]) -> None:
    most = 0.0
    for place, one in drawn:
        if (course := one.course) is not None:
            panel.plot(*course, color=series_colour(place), lw=1.2)
            most = max(most, float(course[1].max(initial=0.0)))
    panel.set_ylim(0.0, max(1.1 * most, 0.01))
    panel.set_xlabel("time on the path / s")
    panel.set_ylabel("bodies that touch there")
    panel.set_title("Risk along each path, as planned")


def _draw_told(panel: Axes, drawn: Sequence[tuple[int, PlannedInRun]], risk: Series | None) -> None:
    for place, one in drawn:
        panel.axvline(one.t_s, color=series_colour(place), lw=1.2, ls="--", zorder=0)
    shown: list[Any] = []
    if risk is not None:
        for name, label, colour in (
            ("path", "touching on what is left of the path", ACCENT),
            ("minute", "touched in the last minute", WARNING),
        ):
            if np.isfinite(risk[name]).any():
                shown += panel.plot(risk.t_s, risk[name], color=colour, lw=0.9, label=label)
    if shown:
        panel.set_ylim(bottom=0.0)
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    else:
        where: dict[str, Any] = {"transform": panel.transAxes, "ha": "center", "color": MUTED}
        panel.text(0.5, 0.5, "no risk of a path was told", **where)
    panel.set_xlabel("time / s")
    panel.set_ylabel("probability")
