"""Figures of mixture density networks, after figures 4 and 5 of Thompson et al."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
from daemon.workbench.body_model.evaluation.component_sweep import Counted, by_start, recommended
from daemon.workbench.body_model.evaluation.evaluation import Evaluation
from daemon.workbench.body_model.training.body_training import Start
from daemon.workbench.body_model.training.calibration import CURVE
from daemon.workbench.report.report_style import (
    ACCENT,
    ALARM,
    MUTED,
    REFERENCE,
    SERIES,
    WARNING,
    WIDTH_IN,
    styled,
)
from safety.risk.model.risk_model import RiskModel

_DPI: Final = 160
_POINTS: Final = 1500
_ELLIPSE: Final = 2.0
"""Standard deviations."""
_STARTS: Final[dict[Start, tuple[str, str]]] = {
    "arc": (ACCENT, "components begin along the body"),
    "plain": (WARNING, "they begin as chance has it"),
}
_ABOVE: Final[dict[Start, int]] = {"arc": 8, "plain": -18}
_COLLAPSED: Final = "collapsed: a component without weight at so many configurations"


def write_sweep(found: Sequence[Counted], path: Path) -> None:
    """NLL over K for each start, what collapsed and what is recommended marked.

    Raises OSError, ValueError.
    """
    with styled():
        made = _figure(0.8 * WIDTH_IN, 4.2)
        axes = made.subplots()
        for start, part in by_start(found).items():
            colour, begins = _STARTS[start]
            counts = [one.components for one in part]
            axes.plot(
                counts, [one.test for one in part], "o-", color=colour, label=f"kept back; {begins}"
            )
            axes.plot(counts, [one.learnt_from for one in part], ":", color=colour)
        _mark_collapsed([one for one in found if one.collapsed], axes)
        best = recommended(next(iter(by_start(found).values())))
        if best is not None:
            axes.axvline(best, color=REFERENCE, zorder=0, label=f"recommended: {best}")
        axes.plot([], [], ":", color=MUTED, label="learnt from")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="components", ylabel="negative log-likelihood / nats (places in m)")
        axes.legend()
        made.savefig(path, dpi=_DPI, metadata={"Software": None})


def _mark_collapsed(bad: Sequence[Counted], axes: Axes) -> None:
    if not bad:
        return
    counts, nll = [one.components for one in bad], [one.test for one in bad]
    axes.plot(counts, nll, "x", color=ALARM, markersize=9, label=_COLLAPSED)
    for one in bad:
        axes.annotate(
            f"{one.useless:.0%}",
            (one.components, one.test),
            (0, _ABOVE[one.start]),
            textcoords="offset points",
            ha="center",
            color=ALARM,
        )


def write_evaluation(
    made: Evaluation, model: RiskModel, dataset: CloudDataset, folder: Path
) -> list[Path]:
    """`coverage.png` and `samples.png`. Raises OSError."""
    written = []
    with styled():
        for name, drawn in (
            ("coverage", _coverage(made)),
            ("samples", _samples(made, model, dataset)),
        ):
            path = folder / f"{name}.png"
            drawn.savefig(path, dpi=_DPI, metadata={"Software": None})
            written.append(path)
    return written


def _coverage(made: Evaluation) -> Figure:
    drawn = _figure(0.6 * WIDTH_IN, 4.2)
    axes = drawn.subplots()
    axes.plot([0, 1], [0, 1], color=REFERENCE, zorder=0)
    levels = (0.0, *CURVE, 1.0)
    for label, scores, colour in (
        ("points of the body", made.points, ACCENT),
        ("coefficients of its shape", made.shapes, WARNING),
    ):
        axes.plot(levels, [0.0, *scores.coverage(CURVE), 1.0], color=colour, label=label)
    axes.set(
        xlabel="probability of the mixture's densest region",
        ylabel="share of what was seen that lies in it",
        aspect="equal",
    )
    axes.legend()
    return drawn


def _samples(made: Evaluation, model: RiskModel, dataset: CloudDataset) -> Figure:
    """What was seen at two test configurations, samples of the mixture, and its components."""
    order = np.argsort(made.points.nll_mm)
    middle, poor = int(order[len(order) // 2]), int(order[(9 * len(order)) // 10])
    test = np.flatnonzero(made.unseen.test)
    drawn = _figure(WIDTH_IN, 8.0)
    grid = drawn.subplots(2, 3, sharex="col", sharey=True)
    random = np.random.default_rng(0)
    for row, (which, label) in zip(
        grid, ((middle, "median NLL"), (poor, "NLL at 90 %")), strict=True
    ):
        mixture = model.points.mixture(dataset.configurations[test[which]])
        if mixture is None:
            continue
        cloud = dataset.clouds_mm[test[which]].reshape(-1, 3)
        seen = cloud[random.permutation(len(cloud))[:_POINTS]]
        sampled = mixture.sample(len(seen), random)
        for axes, (points, colour, what) in zip(
            row,
            ((seen, MUTED, "seen"), (sampled, ACCENT, "sampled"), (seen, MUTED, "x, z")),
            strict=True,
        ):
            _scatter(axes, points, colour)
            axes.set_title(f"{label}: {what}" if axes is row[0] else what)
        _scatter(row[2], sampled, ACCENT)
        covariances = np.linalg.inv(
            mixture.factors_per_mm.transpose(0, 2, 1) @ mixture.factors_per_mm
        )
        for k, (mean, covariance) in enumerate(zip(mixture.means_mm, covariances, strict=True)):
            colour = SERIES[k % len(SERIES)]
            outline = _ellipse(mean[[0, 2]], covariance[np.ix_([0, 2], [0, 2])])
            row[2].plot(*outline, color=colour, label=f"w = {mixture.weights[k]:.2f}")
        row[2].legend(fontsize=7)
        row[2].set_title(f"both, and components to {_ELLIPSE:g} σ")
    for axes in grid[-1]:
        axes.set_xlabel("x / mm")
    for axes in grid[:, 0]:
        axes.set_ylabel("z / mm")
    return drawn


def _scatter(axes: Axes, points: NDArray[Any], colour: str) -> None:
    axes.plot(points[:, 0], points[:, 2], ".", color=colour, markersize=1.2, rasterized=True)
    axes.set_aspect("equal")


def _ellipse(mean: NDArray[Any], covariance: NDArray[Any]) -> NDArray[Any]:
    """(2, n) outline."""
    turn = np.linspace(0.0, 2.0 * np.pi, 80)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    outline: NDArray[Any] = mean[:, None] + _ELLIPSE * np.linalg.cholesky(covariance) @ circle
    return outline


def _figure(width_in: float, height_in: float) -> Figure:
    made = Figure(figsize=(width_in, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(made)
    return made
