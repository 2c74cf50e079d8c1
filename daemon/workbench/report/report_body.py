"""Where the body was, as its mixture has it, and what stood near: what the risk was of."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from daemon.workbench.report.report_data import Series
from daemon.workbench.report.report_style import ACCENT, ALARM, MUTED, REFERENCE, figure, panels
from daemon.workbench.report.report_table import Array

_NAMES: Final = "xyz"
_PROJECTIONS: Final = ((0, 2), (1, 2), (0, 1))
_BODIES_AT_MOST: Final = 12
"""So many moments of the run are drawn, evenly spread."""


def body_figure(risk: Series) -> Figure | None:
    """Three projections: bodies of the run, and the one with least room; None: none was told."""
    known = np.isfinite(risk["clearance_mm"])
    if not known.any():
        return None
    means, places, obstacles = (
        risk[name][known] for name in ("means_mm", "place_mm", "obstacle_mm")
    )
    worst = int(np.argmin(risk["clearance_mm"][known]))
    made = figure(4.0)
    abreast = panels(made, 1, 3)[0]
    for panel, (across, up) in zip(abreast, _PROJECTIONS, strict=True):
        _draw_bodies(panel, means, (across, up))
        panel.plot(obstacles[:, across], obstacles[:, up], ".", ms=2.0, color=REFERENCE)
        _draw_worst(panel, means[worst], places[worst], obstacles[worst], (across, up))
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_xlabel(f"{_NAMES[across]} / mm")
        panel.set_ylabel(f"{_NAMES[up]} / mm")
    least = float(risk["clearance_mm"][known][worst])
    abreast[0].set_title(f"Least room: {least:.1f} mm, {risk.t_s[known][worst]:.1f} s")
    abreast[1].set_title(_turned_aside(risk))
    return made


def _turned_aside(risk: Series) -> str:
    """Where along the body something was nearest as steps were turned aside, and what the tip gave
    up for it."""
    arc_mm, given_up_mm = risk["aside_arc_mm"], risk["given_up_mm"]
    turned = np.isfinite(arc_mm)
    if not turned.any():
        return ""
    low, high = arc_mm[turned].min(), arc_mm[turned].max()
    most_mm = np.nanmax(given_up_mm[turned], initial=0.0)
    return f"Turned aside at {low:.0f} to {high:.0f} mm, tip at most {most_mm:.2f} mm a step"


def _draw_bodies(panel: Axes, means: Array, view: tuple[int, int]) -> None:
    """The middles of the mixture's components, joined from base to tip."""
    chosen = np.unique(np.linspace(0, len(means) - 1, _BODIES_AT_MOST).round().astype(int))
    for body in means[chosen]:
        along = _from_base(body)
        panel.plot(along[:, view[0]], along[:, view[1]], "o-", ms=2.5, lw=0.7, color=MUTED)


def _draw_worst(
    panel: Axes, body: Array, place: Array, obstacle: Array, view: tuple[int, int]
) -> None:
    along = _from_base(body)
    panel.plot(along[:, view[0]], along[:, view[1]], "o-", ms=4.0, lw=1.2, color=ACCENT)
    between = np.stack([place, obstacle])
    panel.plot(between[:, view[0]], between[:, view[1]], "-", lw=1.4, color=ALARM)
    panel.plot(obstacle[view[0]], obstacle[view[1]], "x", ms=6.0, color=ALARM)


def _from_base(body: Array) -> Array:
    """(K, 3) of (3 K,) in the order of their distance from the base, without unknown ones."""
    middles = body.reshape(-1, 3)
    known = middles[np.isfinite(middles).all(axis=1)]
    return np.asarray(known[np.argsort(np.linalg.norm(known, axis=1))])
