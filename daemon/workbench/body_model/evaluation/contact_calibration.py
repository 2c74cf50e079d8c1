"""Whether contact_risk is what happens: beside it, how often an emulated body really collides.

A risk is easily right far from everything and deep inside something. So solid blocks are put, at
random, near the skin of one of the shapes that the body may have: posts, plates, and edges of large
blocks that it just touches, or just does not.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.random import Generator
from numpy.typing import NDArray

from daemon.risk.grid_cache import fitting_spacing_mm
from daemon.risk.model_file import ModelFile
from daemon.workbench.body_model.evaluation.rollouts import Rollouts
from daemon.workbench.body_model.evaluation.shapes import box
from daemon.workbench.report.report_style import ACCENT, MUTED, REFERENCE, WIDTH_IN, styled
from safety.risk.contact import ContactModel
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import Environment, Mesh, environment

_SMALLEST_MM, _LARGEST_MM = 8.0, 80.0
_NEAR_BASE: Final = 0.3
"""Of the body's length, where nothing is put: there it hardly moves."""
_LEAST_SPREAD_MM: Final = 0.5
_WIDER: Final = 1.5
"""How far from touching blocks are put, against the spread of the shapes there."""
_FINE: Final = 5
"""Pieces of each piece of the centreline, of which distances are taken."""
_CUTS: Final = 4


@dataclass(frozen=True, eq=False)
class Block:
    """A solid box."""

    size_mm: FloatArray
    """(3,) of its edges."""
    axes: FloatArray
    """(3, 3) columns: directions of its edges."""
    centre_mm: FloatArray

    def distances_mm(self, places_mm: NDArray[Any]) -> FloatArray:
        """(n,) from the surface of (n, 3) places, negative inside: without any mesh."""
        beyond = np.abs((places_mm - self.centre_mm) @ self.axes) - 0.5 * self.size_mm
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))

    def touched(self, centrelines_mm: NDArray[Any], radius_mm: float) -> NDArray[np.bool_]:
        """(r,) which of (r, n, 3) bodies of this radius touch it."""
        share = np.arange(_FINE)[:, None, None, None] / _FINE
        lines = np.asarray(centrelines_mm, np.float64)
        between = (1.0 - share) * lines[:, :-1] + share * lines[:, 1:]
        count = len(lines)
        places = np.concatenate(
            [np.swapaxes(between, 0, 1).reshape(count, -1, 3), lines[:, -1:]], 1
        )
        away = self.distances_mm(places.reshape(-1, 3)).reshape(count, -1)
        return np.asarray(away.min(axis=1) <= radius_mm)

    def environment(self) -> Environment:
        """The same as triangles."""
        mesh = box(self.size_mm.tolist(), [0.0] * 3, _CUTS)
        vertices = mesh.vertices_mm @ self.axes.T + self.centre_mm
        return environment(*Mesh(vertices, mesh.triangles), free="outside")


def grazed_block(centrelines_mm: NDArray[np.float32], radius_mm: float, random: Generator) -> Block:
    """A block near the skin of one of (r, n, 3) shapes that a body may have."""
    shapes, nodes = centrelines_mm.shape[:2]
    node = int(random.integers(int(_NEAR_BASE * nodes), nodes - 1))
    line = centrelines_mm[random.integers(shapes)].astype(np.float64)
    along = line[node + 1] - line[node]
    away = np.cross(along, random.normal(size=3))
    away /= np.linalg.norm(away)
    spread_mm = float(np.std(centrelines_mm[:, node] @ away))
    gap_mm = random.normal() * _WIDER * max(spread_mm, _LEAST_SPREAD_MM)
    size = np.exp(random.uniform(np.log(_SMALLEST_MM), np.log(_LARGEST_MM), 3))
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    if random.random() < 0.5:  # a side towards the body, not a corner
        axes = np.linalg.qr(np.column_stack([away, axes[:, 1:]]))[0]
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    nearest = -0.5 * axes @ (np.sign(axes.T @ away) * size)
    if random.random() < 0.5 and abs(float(axes[:, 0] @ away)) > 1.0 - 1e-9:
        nearest = -0.5 * away * size[0]  # the middle of that side, not its corner
    return Block(size, axes, line[node] + (radius_mm + gap_mm) * away - nearest)


BINS: Final = 10
_MARGIN_MM: Final = 10.0
"""Beyond the body's radius, to which the grid is exact."""
_FULL: Final = 20
_UNDECIDED: Final = (0.02, 0.98)


@dataclass(frozen=True, eq=False)
class ContactCalibration:
    """Of n situations: a configuration, and something solid near the body."""

    predicted: FloatArray
    """(n,) the estimate of contact_risk."""
    upper_limit: FloatArray
    """(n,) what the gate goes by."""
    observed: FloatArray
    """(n,) share of the rollouts that touched."""
    rollouts: int
    """Of each situation."""
    unknown: int
    """Configurations that the model says it does not know: left out."""
    learnt: int
    """Configurations that it was trained at: left out as well."""

    @property
    def expected_error(self) -> float:
        """Mean over all situations of |predicted − observed|, both averaged in their bin (ECE)."""
        return float(sum(abs(p - o) * n for p, o, n in self.bins()) / len(self.predicted))

    @property
    def largest_error(self) -> float:
        """Of a bin with twenty situations or more, if there is one."""
        bins = self.bins()
        full = [(p, o) for p, o, n in bins if n >= _FULL]
        return float(max(abs(p - o) for p, o in full or [(p, o) for p, o, _ in bins]))

    @property
    def single_error(self) -> float:
        """Mean of |predicted − observed| of each situation by itself."""
        return float(np.abs(self.predicted - self.observed).mean())

    @property
    def undecided(self) -> float:
        """Share of the situations in which it was not as good as certain what happens."""
        low, high = _UNDECIDED
        return float(((self.observed > low) & (self.observed < high)).mean())

    @property
    def exceeded(self) -> float:
        """Share of the situations with more collisions than the upper limit says."""
        return float((self.observed > self.upper_limit).mean())

    def bins(self) -> list[tuple[float, float, int]]:
        """(mean predicted, mean observed, situations) of each tenth that has any."""
        which = np.minimum((self.predicted * BINS).astype(np.int64), BINS - 1)
        return [
            (float(self.predicted[mine].mean()), float(self.observed[mine].mean()), int(mine.sum()))
            for mine in (which == b for b in range(BINS))
            if mine.any()
        ]

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "situations": len(self.predicted),
            "rollouts": self.rollouts,
            "unknown_configurations": self.unknown,
            "left_out_because_trained_at": self.learnt,
            "expected_calibration_error": self.expected_error,
            "largest_bin_error": self.largest_error,
            "mean_absolute_error": self.single_error,
            "undecided_share": self.undecided,
            "above_upper_limit_share": self.exceeded,
            "bins": [{"predicted": p, "observed": o, "situations": n} for p, o, n in self.bins()],
        }


def contact_calibration(
    file: ModelFile,
    rollouts: Rollouts,
    obstacles: int,
    samples: int,
    grid_mm: float | None,
    seed: int,
    advance: Callable[[int], None],
) -> ContactCalibration:
    """Put `obstacles` blocks near the body at each configuration, and ask and look.

    Where they are depends on the rollouts, not on the model. samples: of contact_risk. grid_mm:
    None: what fits the body, as where a robot file gives none. advance: hears of each
    configuration. Raises ValueError.
    """
    model = file.model
    exact_mm = model.basis.thickest_mm + _MARGIN_MM
    thinnest_mm = float(model.basis.radius_mm.min())
    found: list[tuple[float, float, float]] = []
    unknown, learnt = 0, file.learnt_at(rollouts.u)
    for number, (u, lines) in enumerate(zip(rollouts.u, rollouts.centrelines_mm, strict=True)):
        if learnt[number]:
            advance(1)
            continue
        mixture = model.shapes.mixture(u) if model.knows(u) else None
        if mixture is None:
            unknown += 1
            advance(1)
            continue
        random = np.random.default_rng([seed, number])
        for _ in range(obstacles):
            block = grazed_block(lines, rollouts.radius_mm, random)
            around = block.environment()
            spacing_mm = grid_mm or fitting_spacing_mm(around, thinnest_mm, exact_mm)
            grid = distance_grid(around, spacing_mm, exact_mm)
            risk = ContactModel(model.basis, grid, None, samples).risk(mixture)
            touched = float(block.touched(lines, rollouts.radius_mm).mean())
            found.append((risk.probability, risk.upper_limit, touched))
        advance(1)
    if not found:
        raise ValueError(
            f"of {len(rollouts.u)} configurations the model was trained at {int(learnt.sum())}, "
            f"and {unknown} it does not know: none is left to try. Take another --seed"
        )
    predicted, limit, observed = np.array(found).T
    count = rollouts.centrelines_mm.shape[1]
    return ContactCalibration(predicted, limit, observed, count, unknown, int(learnt.sum()))


# The reliability of contact_risk, drawn.


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
