"""Figures over time: error, actuators, forces, risk, and how the loop kept its time."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from daemon.messages import AxisStatus
from daemon.recording.result import CycleError
from daemon.workbench.report.report_data import NO_MODEL, RunData, Series
from daemon.workbench.report.report_style import (
    ACCENT,
    ALARM,
    GRID,
    INK,
    MUTED,
    REFERENCE,
    WARNING,
    WIDTH_IN,
    figure,
    legend_height_in,
    limits_of,
    panels,
    series_colour,
    shade_states,
)
from daemon.workbench.report.report_table import Array

# Long courses over time with fewer points: a figure shows no more of them than it has columns.


COLUMNS_PER_IN = 100
"""Of a figure's width: finer than a line is wide."""


def course(t_s: Array, values: Array, width_in: float) -> tuple[Array, Array]:
    """The course (n,) for a panel so wide: of each column its lowest and highest value, in their
    order. Short ones come back as they are; columns where all is nan stay gaps."""
    columns = round(width_in * COLUMNS_PER_IN)
    each = -(-len(values) // columns)
    if each <= 2:
        return t_s, values
    whole = len(values) // each * each
    table = values[:whole].reshape(-1, each)
    lowest = np.where(np.isnan(table), np.inf, table).argmin(axis=1)
    highest = np.where(np.isnan(table), -np.inf, table).argmax(axis=1)
    first = np.arange(0, whole, each)
    kept = np.stack([first + np.minimum(lowest, highest), first + np.maximum(lowest, highest)], 1)
    places = np.concatenate([[0], kept.ravel(), np.arange(whole, len(values))])
    places = np.unique(places)
    return t_s[places], values[places]


_MS: Final = 1e3
_COLUMNS: Final = 2
_OF_A_ROTATION: Final = "N mm"
_LEGEND_COLUMNS: Final = 6
_DOTS_AT_MOST: Final = 120
"""More of them run into a line."""
_NUMBERS_AT_MOST: Final = 5
"""Along an axis of a small panel: each is drawn glyph by glyph."""
_TIME: Final = "time / s"


def error_figure(run: RunData) -> Figure | None:
    """The tip's error over time, with cycles, their means, and where the robot stood still."""
    tip = run.tip
    if tip is None or not np.isfinite(tip["error_mm"]).any():
        return None
    points = np.isfinite(tip["error_rad"]).any()
    made = figure(5.6 if points else 3.4)
    both = panels(made, 2 if points else 1, 1)
    axes = both[0, 0]
    leading = np.where((tip["running"] > 0) & (tip["cycle"] >= 0), np.nan, tip["error_mm"])
    counted = np.where((tip["running"] > 0) & (tip["cycle"] >= 0), tip["error_mm"], np.nan)
    _draw(axes, tip.t_s, leading, color=REFERENCE, lw=0.9)
    _draw(axes, tip.t_s, counted, color=ACCENT, lw=0.9)
    handles = [Line2D([], [], color=ACCENT, label="in a cycle")]
    if np.isfinite(leading).any():
        handles.append(Line2D([], [], color=REFERENCE, label="not counted"))
    if np.isfinite(tip["expected_mm"]).any():
        _draw(axes, tip.t_s, tip["expected_mm"], color=INK, lw=0.7, ls=":")
        handles.append(Line2D([], [], color=INK, lw=0.7, ls=":", label="expected (RMS)"))
    _mark_cycles(axes, tip, run.cycles)
    if run.cycles:
        handles.append(Line2D([], [], color=INK, lw=1.2, label="mean of the cycle"))
    shaded = shade_states(axes, run.states, run.duration_s)
    top = limits_of(counted if np.isfinite(counted).any() else leading)
    axes.set_ylim(0.0, None if top is None else top[1] * 1.12)
    if points:
        angle = np.where(tip["cycle"] >= 0, np.degrees(tip["error_rad"]), np.nan)
        _draw(both[1, 0], tip.t_s, angle, color=ACCENT, lw=0.9)
        most = limits_of(angle)
        both[1, 0].set_ylim(0.0, None if most is None else most[1] * 1.12)
        both[1, 0].set_ylabel("direction error / °")
    _time_axis(both[:, 0].tolist(), run)
    axes.set_ylabel("tip error / mm")
    axes.legend(handles=[*handles, *shaded], loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5)
    return made


def actuator_figure(run: RunData) -> Figure | None:
    """Each axis' place and target."""
    axes_series = run.axes
    if axes_series is None:
        return None
    count = axes_series["actual"].shape[1]
    rows = -(-count // _COLUMNS)
    made = figure(1.0 + 1.65 * rows)
    grid = panels(made, rows, _COLUMNS, sharex=True, over_in=0.25, apart_in=0.4)
    for place, panel in enumerate(grid.flat):
        if place >= count:
            panel.remove()
            continue
        name, unit = _axis_name(run.axis_status, place)
        t_s, target, actual = axes_series.t_s, axes_series["target"], axes_series["actual"]
        _draw(panel, t_s, target[:, place], _COLUMNS, color=REFERENCE, lw=1.8)
        _draw(panel, t_s, actual[:, place], _COLUMNS, color=series_colour(place), lw=0.9)
        panel.set_title(name)
        panel.set_ylabel(unit)
        panel.locator_params(nbins=_NUMBERS_AT_MOST)
        shade_states(panel, run.states, run.duration_s)
    _time_axis(
        [
            grid[(count - 1 - c) // _COLUMNS][(count - 1 - c) % _COLUMNS]
            for c in range(min(count, _COLUMNS))
        ],
        run,
    )
    made.legend(
        handles=[
            Line2D([], [], color=REFERENCE, lw=1.8, label="target"),
            Line2D([], [], color=INK, lw=0.9, label="actual"),
        ],
        loc="upper right",
        ncols=2,
    )
    return made


def force_figure(run: RunData) -> Figure | None:
    """Tensions, thrusts and torques, those of one unit together."""
    axes_series = run.axes
    if axes_series is None or not np.isfinite(axes_series["force"]).any():
        return None
    count = axes_series["force"].shape[1]
    units = [_force_unit(run.axis_status, place) for place in range(count)]
    groups = sorted(set(units), key=units.index)
    over_in = legend_height_in(max(units.count(unit) for unit in groups), _LEGEND_COLUMNS)
    made = figure(0.8 + (2.4 + over_in) * len(groups))
    apart_in = 0.45 + over_in
    column = panels(made, len(groups), 1, sharex=True, over_in=over_in, apart_in=apart_in)[:, 0]
    for panel, unit in zip(column, groups, strict=True):
        for place in range(count):
            if units[place] == unit:
                label = _axis_name(run.axis_status, place)[0]
                values = axes_series["force"][:, place]
                _draw(
                    panel, axes_series.t_s, values, color=series_colour(place), lw=0.9, label=label
                )
        what = "torque" if unit == _OF_A_ROTATION else "force"
        panel.set_ylabel(f"{what} / {unit}" if unit else what)
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=_LEGEND_COLUMNS)
        shade_states(panel, run.states, run.duration_s)
    _time_axis([column[-1]], run)
    return made


def risk_figure(run: RunData) -> Figure | None:
    """What the gate was told, and how much of each proposal it let through."""
    risk = run.risk
    if risk is None:
        return None
    made = figure(4.2)
    above, below = panels(made, 2, 1, sharex=True, apart_in=0.2, heights=(3, 2))[:, 0]
    drawn = False
    for name, label, colour in (
        ("contact", "any part of the body in contact", ACCENT),
        ("body_point", "a random point of the body in an obstacle", WARNING),
    ):
        if np.isfinite(risk[name]).any():
            drawn = True
            _draw(above, risk.t_s, risk[name], color=colour, lw=0.9, label=label)
    tip = risk["tip_statistic"]
    if np.isfinite(tip).any():
        _draw(below, risk.t_s, tip, color=WARNING, lw=0.9, label="tip not as modelled (1: alarm)")
        below.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
    above.set_ylabel("probability")
    if run.risk_sources == (NO_MODEL,):
        above.text(0.5, 0.5, NO_MODEL, transform=above.transAxes, ha="center", color=MUTED)
        above.set_yticks([])
    else:
        threshold = risk["threshold"]
        _draw(above, risk.t_s, threshold, color=ALARM, lw=1.0, ls="--", label="threshold")
        above.set_ylim(bottom=0.0)
        if not drawn:
            where = {"transform": above.transAxes, "ha": "center", "color": MUTED}
            above.text(0.5, 0.5, "no risk was computed", **where)
        above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    t_s, scale = course(risk.t_s, risk["scale"], WIDTH_IN)
    below.fill_between(t_s, scale, color=ACCENT, alpha=0.18, lw=0, step="post")
    below.plot(t_s, scale, color=ACCENT, lw=0.9, drawstyle="steps-post")
    below.set_ylim(0.0, 1.05)
    below.set_ylabel("let through (1: all)")
    for panel in (above, below):
        shade_states(panel, run.states, run.duration_s)
    _time_axis([below], run)
    return made


def timing_figure(run: RunData) -> Figure | None:
    """Lateness of bus cycles, length of control steps, and time between steps.

    None where nothing was recorded, and in virtual time, in which nothing takes time.
    """
    if run.in_virtual_time:
        return None
    intervals_ms = _step_intervals_ms(run)
    if run.loop is None and intervals_ms is None:
        return None
    made = figure(3.1)
    late, length, between = panels(made, 1, 3)[0]
    _draw_quantiles(late, run.loop, "lateness", ("p50", "p99", "max"))
    late.set_title("Lateness of bus cycles")
    _draw_quantiles(length, run.loop, "step", ("p50", "p99"))
    length.set_title("Frame to targets")
    if intervals_ms is None:
        _nothing(between)
    else:
        high = float(np.percentile(intervals_ms, 99.5)) * 1.5
        shown = np.minimum(intervals_ms, high)
        between.hist(shown, bins=60, histtype="stepfilled", color=ACCENT, alpha=0.85)
        between.set_yscale("log")
        between.yaxis.set_major_formatter("{x:g}")  # powers of ten would be set as formulas
        between.minorticks_off()
        between.set_ylim(top=4.0 * between.get_ylim()[1])
        median = float(np.median(intervals_ms))
        between.axvline(median, color=INK, lw=1.0, ls="--", label=f"median {median:.1f} ms")
        between.legend(loc="upper right")
    between.set_title("Between control steps")
    between.set_xlabel("interval / ms")
    between.set_ylabel("steps")
    return made


def _draw_quantiles(axes: Axes, loop: Series | None, what: str, quantiles: Sequence[str]) -> None:
    if loop is None:
        _nothing(axes)
        return
    dot = "." if len(loop.t_s) <= _DOTS_AT_MOST else ""
    for quantile, colour in zip(quantiles, (ACCENT, WARNING, ALARM), strict=False):
        values = loop[f"{what}_{quantile}_s"] * _MS
        axes.plot(loop.t_s, values, color=colour, lw=1.0, marker=dot, ms=2.5, label=quantile)
    highest = max(float(np.nanmax(loop[f"{what}_{quantile}_s"])) for quantile in quantiles) * _MS
    axes.set_ylim(0.0, max(1.25 * highest, 1e-3))  # room for the legend
    axes.set_xlabel(_TIME)
    axes.set_ylabel("in each second / ms")
    axes.legend(loc="upper right", ncols=3)


def _draw(axes: Axes, t_s: Array, values: Array, abreast: int = 1, **looks: Any) -> None:
    """A line in one of so many panels that stand side by side."""
    axes.plot(*course(t_s, values, WIDTH_IN / abreast), **looks)


def _nothing(axes: Axes) -> None:
    axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", color=MUTED)


def _step_intervals_ms(run: RunData) -> "np.ndarray[tuple[int], np.dtype[np.float64]] | None":
    if run.tip is None or len(run.tip.t_s) < 3:
        return None
    return np.diff(run.tip.t_s) * _MS


def _mark_cycles(axes: Axes, tip: Series, cycles: Sequence[CycleError]) -> None:
    """A line at each cycle's beginning, its number at the top, its mean across."""
    axes.grid(visible=False, axis="x")
    for row in cycles:
        mine = np.flatnonzero((tip["cycle"] == row.cycle) & (tip["running"] > 0))
        from_s, to_s = float(tip.t_s[mine[0]]), float(tip.t_s[mine[-1]])
        axes.axvline(from_s, color=GRID, lw=1.2, zorder=0)
        axes.plot([from_s, to_s], [row.mean_mm, row.mean_mm], color=INK, lw=1.2)
        if len(cycles) <= 40:
            axes.text(
                (from_s + to_s) / 2,
                0.97,
                str(row.cycle + 1),
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="top",
                color=MUTED,
            )


def _time_axis(panels: Sequence[Axes], run: RunData) -> None:
    for panel in panels:
        panel.set_xlim(0.0, max(run.duration_s, 1e-3))
        panel.set_xlabel(_TIME)
        panel.tick_params(labelbottom=True)


def _axis_name(known: Sequence[AxisStatus], place: int) -> tuple[str, str]:
    """Name and unit of the axis at this place."""
    if place < len(known):
        return known[place].name, known[place].unit
    return f"axis {place + 1}", ""


def _force_unit(known: Sequence[AxisStatus], place: int) -> str:
    return known[place].force_unit if place < len(known) else ""
