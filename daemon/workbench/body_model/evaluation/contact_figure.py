"""The reliability of contact_risk, drawn."""

from pathlib import Path
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from daemon.workbench.body_model.evaluation.contact_calibration import ContactCalibration
from daemon.workbench.report.report_style import ACCENT, MUTED, REFERENCE, WIDTH_IN, styled

_DPI: Final = 160


def write_reliability(found: ContactCalibration, path: Path) -> None:
    """Predicted against observed collisions, and how many situations there are. Raises OSError."""
    with styled():
        drawn = Figure(figsize=(0.6 * WIDTH_IN, 6.0), layout="constrained", facecolor="white")
        FigureCanvasAgg(drawn)
        above, below = drawn.subplots(2, 1, sharex=True, height_ratios=(4, 1))
        above.plot([0, 1], [0, 1], color=REFERENCE, zorder=0)
        above.plot(
            found.predicted, found.observed, ".", color=MUTED, alpha=0.35, label="one situation"
        )
        bins = found.bins()
        above.plot(
            [predicted for predicted, _, _ in bins],
            [observed for _, observed, _ in bins],
            "o-",
            color=ACCENT,
            label=f"mean of a tenth: off by {found.expected_error:.3f}",
        )
        above.set(
            ylabel=f"share of {found.rollouts} rollouts that touched",
            title=f"{len(found.predicted)} situations",
        )
        above.legend(loc="upper left")
        below.hist(found.predicted, bins=20, range=(0.0, 1.0), color=ACCENT)
        below.set(xlabel="contact_risk", ylabel="situations")
        drawn.savefig(path, dpi=_DPI, metadata={"Software": None})
