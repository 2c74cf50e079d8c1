"""How a report looks: its page's style sheet, in words that every browser knows, and its figures.

Figures have one typeface, few colours, units in the labels, and no chart junk.
"""

import base64
import io
from collections.abc import Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from daemon.workbench.report.report_table import Array

PAGE_STYLE: Final = """\
:root { --ink: #1f2933; --muted: #616e7c; --line: #e4e7eb; --soft: #f5f7fa; --accent: #0b6bcb;
  --warning: #9a5b0f; --warning-soft: #fdf3e3; --alarm: #a32020; --alarm-soft: #fcebeb;
  --good: #1d7a49; --good-soft: #e8f6ee; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--soft); color: var(--ink); line-height: 1.45;
  font: 15px/1.45 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1080px; margin: 0 auto; padding: 28px 20px 60px; }
header { margin-bottom: 18px; }
h1 { font-size: 26px; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 17px; margin: 0 0 10px; }
p { margin: 0 0 10px; }
.about { color: var(--muted); }
.badge { display: inline-block; padding: 2px 10px; margin-left: 6px; border-radius: 999px;
  font-size: 12px; font-weight: 600; letter-spacing: 0.04em; vertical-align: 4px;
  background: var(--line); color: var(--muted); }
.badge.good { background: var(--good-soft); color: var(--good); }
.badge.warning { background: var(--warning-soft); color: var(--warning); }
.badge.alarm { background: var(--alarm-soft); color: var(--alarm); }
section { background: #fff; border: 1px solid var(--line); border-radius: 10px;
  padding: 18px 20px; margin: 0 0 16px; }
.notice { border-left: 4px solid var(--warning); background: var(--warning-soft);
  color: var(--warning); padding: 10px 14px; margin: 0 0 16px; border-radius: 6px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px;
  margin: 0 0 16px; }
.tile { background: #fff; border: 1px solid var(--line); border-radius: 10px; padding: 12px 16px; }
.tile b { display: block; font-size: 22px; font-variant-numeric: tabular-nums; }
.tile span { color: var(--muted); font-size: 13px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { color: var(--muted); font-weight: 600; font-size: 13px; white-space: nowrap; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.bar { width: 34%; padding-left: 12px; vertical-align: middle; }
td.bar svg { display: block; width: 100%; height: 10px; border-radius: 3px; fill: var(--accent); }
tr.state td { background: #eef5fc; font-weight: 600; }
tr.warning td { background: var(--warning-soft); }
tr.alarm td { background: var(--alarm-soft); }
.facts { width: auto; }
.facts td { border: 0; padding: 2px 18px 2px 0; overflow-wrap: anywhere; }
.facts td:first-child { color: var(--muted); white-space: nowrap; }
figure { margin: 0; }
figure img { width: 100%; height: auto; display: block; }
figcaption, .note { color: var(--muted); font-size: 13px; margin-top: 8px; }
details summary { cursor: pointer; color: var(--accent); }
pre { overflow: auto; font-size: 12px; background: var(--soft); padding: 12px; }
@media print { body { background: #fff; } section, .tile { break-inside: avoid; } }
"""


INK: Final = "#1f2933"
MUTED: Final = "#7b8794"
GRID: Final = "#e4e7eb"
REFERENCE: Final = "#9aa5b1"
ACCENT: Final = "#0b6bcb"
WARNING: Final = "#d9822b"
ALARM: Final = "#c23030"

SERIES: Final = ("#0b6bcb", "#d9822b", "#2a9d62", "#c23030", "#8250c4", "#0aa2b5", "#946038")
"""For the axes of a robot, in their order; then again from the first."""

STATE_COLOURS: Final = {"hold": WARNING, "fault": ALARM, "estop": ALARM}
"""States that a time axis is shaded for."""

WIDTH_IN: Final = 10.0
_DPI: Final = 180
_LEFT_IN: Final = 0.7
_RIGHT_IN: Final = 0.15
_BETWEEN_IN: Final = 0.8
"""Beside the panels: a label and the widest numbers of an axis."""
_TOP_IN: Final = 0.3
"""Over the panels: a title or one line of a legend."""
_BOTTOM_IN: Final = 0.48
_LEGEND_LINE_IN: Final = 0.2
_VECTOR_POINTS_AT_MOST: Final = 6000

_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # to look for a place free of ticks would cost an eighth of the drawing
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.2,
    "lines.solid_joinstyle": "round",
    "svg.hashsalt": "tentacled",
}


def styled() -> Any:
    """Within it, figures get the report's style, and nothing outside is changed."""
    return mpl.rc_context(_STYLE)


def figure(height_in: float) -> Figure:
    """An empty figure of a page's width."""
    made = Figure(figsize=(WIDTH_IN, height_in), facecolor="white")
    FigureCanvasSVG(made)
    return made


def panel_grid(
    made: Figure,
    rows: int,
    columns: int,
    *,
    over_in: float = 0.0,
    under_in: float = 0.0,
    apart_in: float = 0.0,
    heights: Sequence[float] | None = None,
) -> GridSpec:
    """Where panels stand, with room for titles, labels and numbers around each.

    over_in, under_in: more room above and below them all. apart_in: between one row and the next.
    To find out by drawing how much room is needed would take longer than the drawing.
    """
    width_in, height_in = WIDTH_IN, float(made.get_figheight())
    top_in, bottom_in = _TOP_IN + over_in, _BOTTOM_IN + under_in
    panel_width_in = (width_in - _LEFT_IN - _RIGHT_IN - (columns - 1) * _BETWEEN_IN) / columns
    panel_height_in = (height_in - top_in - bottom_in - (rows - 1) * apart_in) / rows
    return made.add_gridspec(
        rows,
        columns,
        left=_LEFT_IN / width_in,
        right=1.0 - _RIGHT_IN / width_in,
        bottom=bottom_in / height_in,
        top=1.0 - top_in / height_in,
        wspace=_BETWEEN_IN / panel_width_in,
        hspace=apart_in / panel_height_in,
        height_ratios=heights,
    )


def panels(made: Figure, rows: int, columns: int, *, sharex: bool = False, **spacing: Any) -> Any:
    """Panels on a `panel_grid`: an array of Axes of shape (rows, columns)."""
    return panel_grid(made, rows, columns, **spacing).subplots(sharex=sharex, squeeze=False)


def legend_height_in(entries: int, columns: int) -> float:
    """What a legend needs beyond its first line, for which there is room."""
    return _LEGEND_LINE_IN * max(0, -(-entries // columns) - 1)


def as_data_uri(made: Figure) -> str:
    """The figure as an SVG that stands in the page itself.

    Where there are many points, their lines are a picture within it: reports get sent by mail.
    """
    for axes in made.axes:
        drawn = [*axes.lines, *axes.collections]
        if sum(_points(one) for one in drawn) > _VECTOR_POINTS_AT_MOST:
            for one in drawn:
                one.set_rasterized(True)
    buffer = io.BytesIO()
    made.savefig(buffer, format="svg", dpi=_DPI, metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def _points(drawn: Artist) -> int:
    if isinstance(drawn, Line2D):
        return int(np.size(drawn.get_xdata()))
    if isinstance(drawn, Collection):
        return sum(len(path) for path in drawn.get_paths())
    return 0


def cycle_colours(count: int) -> list[Any]:
    """From light to dark: the last cycle is the darkest."""
    shades = np.linspace(0.30, 0.95, count) if count > 1 else np.array([0.8])
    return [mpl.colormaps["Blues"](shade) for shade in shades]


def series_colour(place: int) -> str:
    """Of the axis at this place."""
    return SERIES[place % len(SERIES)]


def shade_states(axes: Axes, states: list[tuple[float, str]], end_s: float) -> list[Patch]:
    """Colour the times of HOLD, FAULT and ESTOP. Returns what the legend needs for them."""
    ends = [t_s for t_s, _ in states[1:]] + [end_s]
    shown: dict[str, Patch] = {}
    for (from_s, state), to_s in zip(states, ends, strict=True):
        colour = STATE_COLOURS.get(state)
        if colour is not None:
            axes.axvspan(from_s, max(to_s, from_s), color=colour, alpha=0.15, lw=0)
            shown.setdefault(state, Patch(color=colour, alpha=0.25, label=state.upper()))
    return list(shown.values())


def limits_of(values: Array, margin: float = 0.06) -> tuple[float, float] | None:
    """The range of what is finite, with a margin; None: nothing is."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = float(finite.min()), float(finite.max())
    pad = max((high - low) * margin, 1e-9 + abs(high) * 1e-6)
    return low - pad, high + pad
