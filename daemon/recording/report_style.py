"""How a report's figures look: one typeface, few colours, units in the labels, no chart junk."""

import base64
import io
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from daemon.recording.report_data import Array

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
_VECTOR_POINTS_AT_MOST: Final = 6000

_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
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
    made = Figure(figsize=(WIDTH_IN, height_in), layout="constrained", facecolor="white")
    FigureCanvasSVG(made)
    return made


def as_data_uri(made: Figure) -> str:
    """The figure as an SVG that stands in the page itself.

    Where there are many points, their lines are a picture within it: reports get sent by mail.
    """
    for axes in made.axes:
        drawn = [*axes.lines, *axes.collections]
        if sum(_points(one) for one in drawn) > _VECTOR_POINTS_AT_MOST:
            for one in drawn:
                one.set_rasterized(True)
    # Laid out once, and for good: saving would draw it all to nowhere first, to lay it out.
    layout = made.get_layout_engine()
    if layout is not None:
        layout.execute(made)
        made.set_layout_engine("none")
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
