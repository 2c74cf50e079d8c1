"""Figures of a pre-training, after figures 4 and 5 of Ho 2018."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from daemon.learning.forward.pretraining import EpochErrors, Pretraining
from daemon.workbench.report.report_style import (
    ACCENT,
    INK,
    MUTED,
    REFERENCE,
    WARNING,
    WIDTH_IN,
    styled,
)
from drivers.pose import Vector

_DPI: Final = 160
_COORDINATES: Final = "xyz"
_HEADROOM: Final = 1.15
_BINS: Final = 41
_SHOWN_SHARE: Final = 0.998
"""Of the samples: a few far out ones must not make all others a dot."""


def write_figures(pretraining: Pretraining, stem: Path) -> list[Path]:
    """`<stem>.epochs.png` and `<stem>.regression.png`. Raises OSError."""
    written = []
    with styled():
        for name, made in (
            ("epochs", epochs_figure(pretraining)),
            ("regression", regression_figure(pretraining)),
        ):
            path = stem.with_name(f"{stem.name}.{name}.png")
            made.savefig(path, dpi=_DPI, metadata={"Software": None})
            written.append(path)
    return written


def epochs_figure(pretraining: Pretraining) -> Figure:
    """Root mean square error over epochs, with the best one marked."""
    made, errors = _figure(0.62 * WIDTH_IN, 3.6), pretraining.errors
    axes = made.subplots()
    epochs = [one.epoch for one in errors]
    for label, field, colour, marker in (
        ("learnt from", "train_mm", ACCENT, "o"),
        ("kept back", "test_mm", WARNING, "s"),
        ("all", "all_mm", MUTED, None),
    ):
        values = [getattr(one, field) for one in errors]
        if np.isfinite(values).all():
            axes.plot(epochs, values, color=colour, marker=marker, markersize=3.5, label=label)
    best = errors[pretraining.best_epoch - 1]
    axes.axvline(best.epoch, color=REFERENCE, linewidth=1.0, zorder=0)
    axes.annotate(
        f" lowest after epoch {best.epoch}: {_shown_mm(best):.2f} mm ",
        (best.epoch, 0.99),
        xycoords=("data", "axes fraction"),
        va="top",
        ha="left" if best.epoch <= 0.6 * len(errors) else "right",
        color=INK,
        fontsize=8.5,
    )
    axes.set_ylim(0.0, _HEADROOM * np.nanmax([one[1:] for one in errors]))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="epoch", ylabel="RMS error of Δp per coordinate / mm")
    axes.set_title(
        f"Forward model, {pretraining.model.count} receptive fields, "
        f"{len(pretraining.motions)} motions"
    )
    axes.legend(loc="lower left")
    return made


def regression_figure(pretraining: Pretraining) -> Figure:
    """What the model says of Δp against what was observed, and the distribution of the errors."""
    chosen = pretraining.test if pretraining.test.any() else ~pretraining.test
    observed = pretraining.motions.delta_tip_mm[chosen]
    predicted = pretraining.predicted_mm[chosen]
    wrong = predicted - observed
    reach = 1.05 * float(np.quantile(np.abs(observed).max(axis=1), _SHOWN_SHARE))
    widest = float(np.quantile(np.abs(wrong).max(axis=1), _SHOWN_SHARE))
    made = _figure(WIDTH_IN, 6.2)
    grid = made.subplots(2, 3, height_ratios=(1.5, 1.0), sharex="row", sharey="row")
    for column, name in enumerate(_COORDINATES):
        _regression(grid[0, column], name, observed[:, column], predicted[:, column], reach)
        _histogram(grid[1, column], name, wrong[:, column], widest)
    grid[0, 0].set_ylabel("predicted / mm")
    grid[1, 0].set_ylabel("share of motions")
    kept = "motions kept back" if pretraining.test.any() else "motions learnt from"
    made.suptitle(
        f"Motion of the tip Δp, {len(observed)} {kept}", x=0.01, ha="left", fontweight="bold"
    )
    return made


def _regression(axes: Axes, name: str, observed: Vector, predicted: Vector, reach: float) -> None:
    axes.plot((-reach, reach), (-reach, reach), color=REFERENCE, linewidth=1.0, zorder=0)
    axes.plot(observed, predicted, ".", color=ACCENT, markersize=2.5, alpha=0.35, markeredgewidth=0)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel=f"observed Δ{name} / mm")
    axes.set_aspect("equal", adjustable="box")
    explained = 1.0 - float(((predicted - observed) ** 2).mean() / observed.var())
    axes.set_title(f"Δ{name}")
    axes.text(0.04, 0.96, f"R² = {explained:.3f}", transform=axes.transAxes, va="top", fontsize=8.5)


def _histogram(axes: Axes, name: str, wrong: Vector, widest: float) -> None:
    weights = np.full(len(wrong), 1.0 / len(wrong))
    edges = np.linspace(-widest, widest, _BINS)
    axes.hist(wrong, bins=edges.tolist(), weights=weights, color=ACCENT, alpha=0.75)
    axes.axvline(0.0, color=REFERENCE, linewidth=1.0)
    axes.grid(visible=False, axis="x")
    rms = float(np.sqrt((wrong**2).mean()))
    axes.text(0.04, 0.95, f"RMS {rms:.2f} mm", transform=axes.transAxes, va="top", fontsize=8.5)
    axes.set_xlabel(f"error of Δ{name} / mm")


def _shown_mm(errors: EpochErrors) -> float:
    return errors.test_mm if np.isfinite(errors.test_mm) else errors.train_mm


def _figure(width_in: float, height_in: float) -> Figure:
    made = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(made)
    return made
