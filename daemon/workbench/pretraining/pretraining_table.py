"""The errors of a pre-training on the terminal."""

from math import isfinite

from rich.console import Console
from rich.table import Table

from daemon.learning.forward.pretraining import Pretraining


def print_table(pretraining: Pretraining, console: Console | None = None) -> None:
    """Epoch by epoch, the best one marked, and what was learnt in one line above."""
    motions, sampling = pretraining.motions, pretraining.sampling
    out = console or Console(highlight=False)
    out.print(
        f"{len(motions)} motions, {int(pretraining.test.sum())} of them kept back; "
        f"the body lags {sampling.lag_s * 1e3:.0f} ms behind its axes; "
        f"{pretraining.model.count} receptive fields"
    )
    table = Table(title="RMS error of Δp per coordinate / mm", title_justify="left")
    for name in ("epoch", "learnt from", "kept back", "all"):
        table.add_column(name, justify="right")
    for errors in pretraining.errors:
        best = errors.epoch == pretraining.best_epoch
        figures = [_figure(value) for value in errors[1:]]
        table.add_row(str(errors.epoch), *figures, style="bold green" if best else "")
    out.print(table)
    spread_mm = float(motions.delta_tip_mm.std())
    out.print(f"best after epoch {pretraining.best_epoch}; Δp itself has {spread_mm:.3f} mm")


def _figure(value: float) -> str:
    return f"{value:.3f}" if isfinite(value) else "-"
