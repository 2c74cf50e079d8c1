"""Figures of where the tip went: in space, from three sides, and close up."""

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from daemon.workbench.report.report_data import Series
from daemon.workbench.report.report_style import (
    ALARM,
    INK,
    MUTED,
    cycle_colours,
    figure,
    legend_height_in,
    panel_grid,
    panels,
)
from daemon.workbench.report.report_table import Array

_NAMES: Final = "xyz"
_PROJECTIONS: Final = ((0, 1), (0, 2), (1, 2))
_LEGEND_CYCLES: Final = 8
_LEGEND_COLUMNS: Final = 5
_CLOSE_UP_SAMPLES: Final = 40


def path_figure(tip: Series) -> Figure | None:
    """Reference and tip in 3-D and in three projections; None: the tip followed nothing."""
    cycles = followed_cycles(tip)
    if not cycles:
        return None
    made = figure(8.6)
    handles = _cycle_handles(cycles)
    under_in = 0.25 + legend_height_in(len(handles), _LEGEND_COLUMNS)
    grid = panel_grid(made, 2, 2, under_in=under_in, apart_in=0.8)
    space = made.add_subplot(grid[0, 0], projection="3d")
    everything = np.concatenate([points for _, points, _ in cycles])
    _draw_in_space(space, cycles)
    for place, (across, up) in enumerate(_PROJECTIONS, start=1):
        axes = made.add_subplot(grid[place // 2, place % 2])
        _draw(axes, cycles, lambda p, c=(across, up): p[:, c])
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{_NAMES[across]} / mm")
        axes.set_ylabel(f"{_NAMES[up]} / mm")
        axes.set_title(f"{_NAMES[across]}{_NAMES[up]} plane")
    _equal_box(space, everything)
    made.legend(handles=handles, loc="lower center", ncols=min(len(handles), _LEGEND_COLUMNS))
    return made


def close_up_figure(tip: Series) -> Figure | None:
    """First and last cycle in the plane of the reference, and the worst place of the last."""
    cycles = followed_cycles(tip)
    if not cycles:
        return None
    number, last, reference = cycles[-1]
    centre, plane = plane_of(reference)

    def flat(points: Array) -> Array:
        return (points - centre) @ plane.T

    made = figure(4.6)
    whole, worst = panels(made, 1, 2)[0]
    shown = [cycles[0], cycles[-1]] if len(cycles) > 1 else [cycles[-1]]
    _draw(whole, shown, flat)
    whole.set_title("In the plane of the reference")
    whole.legend(handles=_cycle_handles(shown), loc="best")
    errors = np.linalg.norm(last - reference, axis=1)
    at = int(np.nanargmax(errors))
    _draw_worst(worst, flat(last), flat(reference), at, float(errors[at]))
    worst.set_title(f"Largest error of cycle {number + 1}: {errors[at]:.2f} mm")
    for axes in (whole, worst):
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("first direction in the plane / mm")
        axes.set_ylabel("second direction / mm")
    return made


Cycle = tuple[int, Array, Array]
"""Number, tip and reference, both of shape (samples, 3), all finite, in mm."""


def followed_cycles(tip: Series) -> list[Cycle]:
    """Each cycle's samples while RUNNING for which tip and reference are known."""
    known = np.isfinite(tip["tip_mm"]).all(axis=1) & np.isfinite(tip["reference_mm"]).all(axis=1)
    use = known & (tip["running"] > 0) & (tip["cycle"] >= 0)
    numbers = sorted({int(cycle) for cycle in tip["cycle"][use]})
    return [
        (number, tip["tip_mm"][mine], tip["reference_mm"][mine])
        for number in numbers
        if (mine := use & (tip["cycle"] == number)).sum() > 1
    ]


def _draw(axes: Axes, cycles: list[Cycle], flat: Any) -> None:
    for (_, points, _), colour in zip(cycles, cycle_colours(len(cycles)), strict=True):
        axes.plot(*flat(points).T, color=colour, lw=1.1)
    axes.plot(*flat(cycles[-1][2]).T, color=INK, lw=0.9, ls=(0, (4, 3)))


def _draw_in_space(axes: Any, cycles: list[Cycle]) -> None:
    for (_, points, _), colour in zip(cycles, cycle_colours(len(cycles)), strict=True):
        axes.plot(*points.T, color=colour, lw=1.0)
    axes.plot(*cycles[-1][2].T, color=INK, lw=0.9, ls=(0, (4, 3)))
    axes.set_xlabel("x / mm")
    axes.set_ylabel("y / mm")
    axes.set_zlabel("z / mm")
    axes.set_title("In the base sensor's frame")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.set_tick_params(labelsize=7.5)
    axes.locator_params(nbins=5)


def _equal_box(axes: Any, points: Array) -> None:
    """The same scale in all directions, without wasting the flat ones."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 0.25 * float((high - low).max()) + 1e-6)
    middle = (low + high) / 2
    low, high = middle - 0.55 * size, middle + 0.55 * size
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(low[2], high[2])
    axes.set_box_aspect(tuple(high - low), zoom=0.9)


def _draw_worst(axes: Axes, tip: Array, reference: Array, at: int, error_mm: float) -> None:
    """The surroundings of one sample, with the error as lines from the reference to the tip."""
    near = slice(max(0, at - _CLOSE_UP_SAMPLES), at + _CLOSE_UP_SAMPLES + 1)
    joints = np.stack([reference[near], tip[near]], axis=1)
    axes.add_collection(LineCollection(list(joints), colors=MUTED, linewidths=0.4))
    axes.plot(*reference[near].T, color=INK, lw=1.0, ls=(0, (4, 3)), label="reference")
    axes.plot(*tip[near].T, color=cycle_colours(1)[0], lw=1.4, label="tip")
    axes.plot(
        *np.stack([reference[at], tip[at]]).T, color=ALARM, lw=1.6, label=f"{error_mm:.2f} mm"
    )
    axes.legend(loc="best")


def plane_of(reference: Array) -> tuple[Array, Array]:
    """Centre of the points and the two directions (rows) in which they spread most."""
    centre = reference.mean(axis=0)
    _, _, directions = np.linalg.svd(reference - centre, full_matrices=False)
    plane = directions[:2]
    if len(plane) < 2:
        plane = np.eye(3)[:2]
    # Signs and order are free: take those that look most like the base sensor's.
    most = np.abs(plane).argmax(axis=1)
    plane = plane * np.where(plane[[0, 1], most] < 0, -1.0, 1.0)[:, None]
    if most[0] > most[1]:
        plane = plane[::-1]
    return centre, plane


def _cycle_handles(cycles: list[Cycle]) -> list[Line2D]:
    handles = [Line2D([], [], color=INK, lw=0.9, ls=(0, (4, 3)), label="reference")]
    colours = cycle_colours(len(cycles))
    shown = min(len(cycles), _LEGEND_CYCLES)
    for place in np.linspace(0, len(cycles) - 1, shown).round().astype(int):
        label = f"tip, cycle {cycles[place][0] + 1}"
        handles.append(Line2D([], [], color=colours[place], lw=1.6, label=label))
    return handles
