"""Learns all that is to be known of a body from its clouds: two networks, a basis, a reach.

Also the file's word on where it all comes from, so that a model is never taken for another robot's.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from math import log, pi
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from daemon.array_files import prefixed
from daemon.workbench.body_model.clouds.cloud_dataset import BoolArray, CloudDataset
from daemon.workbench.body_model.training.network import Beginning, NetworkShape, Scaling
from daemon.workbench.body_model.training.recalibration import MOST_DOUBLED, recalibrated
from daemon.workbench.body_model.training.shape_fit import ShapeFit, coefficients_of, fit_shapes
from daemon.workbench.body_model.training.training import Check, Trained, TrainingSettings, train
from safety.risk.model.mixture import FloatArray
from safety.risk.model.risk_model import features_of
from safety.risk.model.shape_basis import ShapeBasis

Arrays = dict[str, NDArray[Any]]
Heard = Callable[[str, Check], None]
Start = Literal["arc", "plain"]
"""Where the components over places begin: along the body; or as chance has it, as in the paper,
with all layers as torch makes them."""
STARTS: Final[tuple[Start, ...]] = ("arc", "plain")

MM_PER_M: Final = 1e3
_THINNEST_MM: Final = 0.5
"""Less than the cameras' noise: no component of a cloud is thinner."""
_LEAST_SPREAD: Final = 0.1
"""The same of a coefficient, against its spread at one configuration."""
_WIDEST: Final = 3.0
"""No component is wider, against the spread of all data."""
_ASKED: Final = 1.5
"""How far it may be asked from what it has seen, against how far such data are apart."""
_APART: Final = 0.99


@dataclass(frozen=True)
class BodySettings:
    """How both networks are made and trained."""

    points: NetworkShape = field(default_factory=lambda: NetworkShape(5))
    shapes: NetworkShape = field(default_factory=lambda: NetworkShape(8))
    """As it is trained: each component becomes two. See `recalibration`."""
    coefficients: int = 8
    training: TrainingSettings = field(
        default_factory=lambda: TrainingSettings(
            steps=6000, groups=128, samples=32, learning_rate=6e-3
        )
    )
    shapes_training: TrainingSettings = field(
        default_factory=lambda: TrainingSettings(
            steps=8000, groups=128, learning_rate=6e-3, alone=1.0 / 3.0
        )
    )
    """In a step each group gives all its samples: one for each start."""

    def __post_init__(self) -> None:
        if self.shapes.components > MOST_DOUBLED:
            raise ValueError(f"a mixture over shapes is learnt as 1 to {MOST_DOUBLED} components")


@dataclass(frozen=True, eq=False)
class TrainedBody:
    """What a model's file holds."""

    arrays: Arrays
    about: dict[str, Any]
    points: Trained
    shapes: Trained
    """Before each component was made two."""


def nats_in_metres(nll_mm: float, dimensions: int = 3) -> float:
    """A negative log-likelihood of places in m, of one in mm."""
    return nll_mm - dimensions * log(MM_PER_M)


def train_body(dataset: CloudDataset, settings: BodySettings, heard: Heard) -> TrainedBody:
    """Learn from all that is not kept back to test with. Raises TrainingError, ValueError.

    heard: is told of every check, with the network's name.
    """
    learnt_from = ~dataset.test
    u = dataset.configurations[learnt_from]
    points = train_points(dataset, learnt_from, settings.points, settings.training, "arc", heard)
    fit = _fitted(dataset, learnt_from, settings.coefficients)
    shapes = _train_shapes(u, dataset.period, fit, settings, heard)
    kept = shapes.kept_back
    of_shapes, widths = recalibrated(
        shapes.arrays, shapes.activation, u[kept], fit.coefficients_mm[kept]
    )
    arrays = {
        **prefixed("points/", points.arrays),
        **prefixed("shapes/", of_shapes),
        "basis/base_mm": fit.basis.base_mm,
        "basis/modes": fit.basis.modes,
        "basis/radius_mm": fit.basis.radius_mm,
        "basis/left_out_mm": fit.basis.left_out_mm,
        "basis/arc_mm": fit.basis.arc_mm,
        "training/inputs": u.astype(np.float32),
        "training/reach": np.array(_reach(u, points.arrays["input_scale"], dataset.period)),
    }
    provenance = {
        name: dataset.provenance[name] for name in sorted(dataset.provenance) if name != "kind"
    }
    about = {
        **provenance,
        "points_activation": points.activation,
        "shapes_activation": shapes.activation,
        "clouds_sha256": dataset.sha256,
        "configurations_sha256": dataset.digests(learnt_from),
        "training": {
            "points": asdict(settings.points),
            "shapes": asdict(settings.shapes),
            "coefficients": settings.coefficients,
            **asdict(settings.training),
            "shapes_training": asdict(settings.shapes_training),
        },
        "nll_nats_m": nats_in_metres(points.best.kept_back),
        "shapes_widths": asdict(widths),
        "basis_left_out_mm": float(fit.left_out_mm.max()),
        "fit_error_mm": float(dataset.fit_error_mm.max()),
    }
    return TrainedBody(arrays, about, points, shapes)


def train_points(
    dataset: CloudDataset,
    chosen: BoolArray,
    shape: NetworkShape,
    settings: TrainingSettings,
    start: Start = "arc",
    heard: Heard = lambda *_: None,
) -> Trained:
    """The network over places of the body, from the chosen configurations. Raises TrainingError."""
    u, clouds = dataset.configurations[chosen], dataset.points_mm(chosen)
    middle = clouds.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    scale_mm = float(np.sqrt(np.square(clouds - middle, dtype=np.float64).mean()))
    limits = (-log(_WIDEST), log(scale_mm / _THINNEST_MM))
    scaling = _scaling(u, dataset.period, middle, scale_mm, limits)
    beginning = _along_arc(dataset, chosen, shape.components) if start == "arc" else None
    return train(
        u, clouds, shape, scaling, beginning, settings, lambda check: heard("points", check)
    )


def _train_shapes(
    u: FloatArray, period: FloatArray, fit: ShapeFit, settings: BodySettings, heard: Heard
) -> Trained:
    samples = fit.coefficients_mm
    spread = np.sqrt(samples.reshape(-1, fit.basis.coefficients).var(axis=0))
    usual = float(np.sqrt(np.square(spread).mean()))
    # Half way between how wide they are at one configuration, which is 1, and over all of them.
    scale_mm = usual**0.5
    limits = (-log(_WIDEST * usual / scale_mm), log(scale_mm / _LEAST_SPREAD))
    scaling = _scaling(u, period, np.zeros(spread.size), scale_mm, limits)
    beginning = Beginning(np.zeros((1, spread.size)), np.diag(np.square(0.5 * spread))[None])
    own = replace(settings.shapes_training, samples=samples.shape[1])
    return train(
        u, samples, settings.shapes, scaling, beginning, own, lambda check: heard("shapes", check)
    )


def _fitted(dataset: CloudDataset, chosen: BoolArray, coefficients: int) -> ShapeFit:
    lines, error_mm = dataset.centrelines_mm[chosen], dataset.fit_error_mm
    return fit_shapes(lines, dataset.radius_mm, coefficients, error_mm)


def coefficients_at(centrelines_mm: NDArray[Any], basis: ShapeBasis) -> FloatArray:
    """(k, s, d) of the shapes with (k, s, nodes, 3) centrelines."""
    found = coefficients_of(basis, centrelines_mm.reshape(-1, *centrelines_mm.shape[2:]))
    return found.reshape(*centrelines_mm.shape[:2], -1)


def _scaling(
    u: FloatArray,
    period: FloatArray,
    offset_mm: FloatArray,
    scale_mm: float,
    limits: tuple[float, float],
) -> Scaling:
    """Of an axis that comes round, the scale is that of its angle."""
    offset = np.where(period > 0.0, 0.0, u.mean(axis=0))
    scale = np.where(period > 0.0, period / (2.0 * pi), u.std(axis=0))
    return Scaling(offset, scale, offset_mm, scale_mm, limits, period)


def _along_arc(dataset: CloudDataset, chosen: BoolArray, components: int) -> Beginning:
    """One component for each part of the body, from base to tip, as it is on the average."""
    lines = dataset.centrelines_mm[chosen].astype(np.float64)
    nodes = lines.shape[2]
    parts = np.array_split(np.arange(nodes), components)
    means, covariances = [], []
    for number, part in enumerate(parts):
        mine = part if len(part) else np.array([number * nodes // components])
        places = lines[:, :, mine].reshape(-1, 3)
        means.append(places.mean(axis=0))
        spread = np.cov(places.T) + dataset.radius_mm**2 * np.eye(3)
        covariances.append(spread)
    return Beginning(np.array(means), np.array(covariances))


def _reach(u: FloatArray, scale: NDArray[Any], period: FloatArray) -> float:
    """How far from a configuration of the training the model may be asked, in its features."""
    there = features_of(u, 1.0 / scale, period)
    nearest = cKDTree(there).query(there, k=2)[0][:, 1]
    return _ASKED * float(np.quantile(nearest, _APART))
