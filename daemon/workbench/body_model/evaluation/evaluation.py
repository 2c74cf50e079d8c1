"""What a learned model of a body is worth, on configurations that it has not seen.

Which those are, the model's own file says and not the data's: see `ModelFile.learnt_at`.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from daemon.host.progress import Progress
from daemon.risk.model_file import ModelFile
from daemon.workbench.body_model.clouds.cloud_dataset import BoolArray, CloudDataset, SingleArray
from daemon.workbench.body_model.training.body_training import (
    coefficients_at,
    nats_in_metres,
    train_points,
)
from daemon.workbench.body_model.training.calibration import CURVE, LEVELS, Scores, scores
from daemon.workbench.body_model.training.network import NetworkShape
from daemon.workbench.body_model.training.reference_mixture import reference_mixture
from daemon.workbench.body_model.training.training import TrainingSettings
from safety.risk.model.mixture import FloatArray
from safety.risk.model.mixture_network import MixtureNetwork
from safety.risk.model.risk_model import RiskModel

_RESAMPLED: Final = 2000
_POINTS: Final = 512
"""Of a configuration's clouds that are scored."""
_INTERVAL: Final = (0.025, 0.975)
_TRAINING: Final = 8
"""One of so many configurations of the training is scored: there are nine times as many."""
_OFF: Final = (0.5, 0.99)


@dataclass(frozen=True)
class AgainstReference:
    """The network beside a mixture of each configuration by itself, at equal K. Nats, places in m.

    Fitted to the clouds of half the starts, and scored, as the network is, on the other half; then
    the other way round. The halves are the first and the last: clouds of one start belong together,
    and what creeps remembers the start before. Of every other start, a mixture would know what no
    model of u can know: of the soft arm, half of how a shape differs from the mean is in the next.
    """

    configurations: int
    network: float
    reference: float
    in_sample: float
    """The reference scored on what it was fitted to."""
    interval: tuple[float, float]
    """95 % of network − reference, configurations drawn again and again."""

    @property
    def difference(self) -> float:
        """Below zero, the network is better."""
        return self.network - self.reference


@dataclass(frozen=True)
class BlockTrial:
    """A network that has never been in a part of the configurations. Nats, places in m."""

    configurations: int
    inside: float
    """Its NLL there."""
    outside: float
    """The same at the test configurations elsewhere."""
    knowing: float | None
    """NLL there of the model that was trained there too; None: it was not."""
    coverage: tuple[float, ...]
    """Of LEVELS, there."""


@dataclass(frozen=True, eq=False)
class AgainstTruth:
    """What it costs that shapes are learnt from what is fitted to clouds: beside true centrelines.

    Only an emulated body's are known. Their nodes are put evenly along them, as fitted ones have
    them: which part of a body has stretched, nobody sees from outside.
    """

    shapes: Scores
    """The true ones, in the mixtures over shapes."""
    tip_error_mm: float
    """Root mean square of the true tip against the mean of the mixture over shapes."""
    fit_off_mm: tuple[float, float]
    """Median and 99 % of how far fitted nodes are off the true centreline, across it; behind its
    end also along it."""
    fit_error_mm: tuple[float, float]
    """Root mean square of that, over the nodes, and what the data say that it is."""


@dataclass(frozen=True)
class Unseen:
    """What a model is tested with: configurations kept back by the data that it has not seen."""

    test: BoolArray
    """(n,) which of the data's."""
    learnt: BoolArray
    """(n,) which of them the model was trained at, or with."""
    left_out: int
    """That the data call tests, and the model was trained at."""
    same_clouds: bool
    """Whether these are the data it was trained with, to the last bit."""

    @classmethod
    def by(cls, file: ModelFile, dataset: CloudDataset) -> "Unseen":
        """Raises ValueError where there is none."""
        every = np.ones(len(dataset), np.bool_)
        learnt = file.learnt_at(dataset.configurations) | file.learnt_from(dataset.digests(every))
        test = dataset.test & ~learnt
        left_out = int(dataset.test.sum() - test.sum())
        if not test.any():
            raise ValueError(
                f"nothing to test with: the model was trained at all {left_out} configurations "
                "that these data keep back. Collect others, with another --seed"
            )
        return cls(test, learnt, left_out, file.about.get("clouds_sha256") == dataset.sha256)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Of one model, and data of its body."""

    unseen: Unseen
    points: Scores
    shapes: Scores
    training_nll_mm: float | None
    """None: what it was trained with is not among these data."""
    reference: AgainstReference
    block: BlockTrial | None
    least_weight: float
    """The smallest mean weight of a component."""
    tip_error_mm: float
    """Root mean square of the tip against the mean of the mixture over shapes."""
    tip_spread_mm: float
    """The same against its mean over the starts: no model of u alone has less."""
    known: float
    """Share of the test configurations that the model says it knows."""
    truth: AgainstTruth | None

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        block = self.block
        return {
            "test_configurations": int(self.unseen.test.sum()),
            "left_out_because_trained_at": self.unseen.left_out,
            "clouds_of_the_training": self.unseen.same_clouds,
            "nll_nats_m": nats_in_metres(self.points.mean_nll_mm),
            "nll_nats_mm": self.points.mean_nll_mm,
            "training_nll_nats_m": None
            if self.training_nll_mm is None
            else nats_in_metres(self.training_nll_mm),
            "reference": {**vars(self.reference), "difference": self.reference.difference},
            "coverage": _by_level(self.points),
            "curve": dict(zip(map(str, CURVE), self.points.coverage(CURVE).tolist(), strict=True)),
            "shapes": {
                "nll_nats_mm": self.shapes.mean_nll_mm,
                "coverage": _by_level(self.shapes),
                "tip_error_mm": self.tip_error_mm,
                "tip_spread_mm": self.tip_spread_mm,
            },
            "true_shapes": None
            if self.truth is None
            else {
                "nll_nats_mm": self.truth.shapes.mean_nll_mm,
                "coverage": _by_level(self.truth.shapes),
                "tip_error_mm": self.truth.tip_error_mm,
                "fit_off_mm": {"median": self.truth.fit_off_mm[0], "p99": self.truth.fit_off_mm[1]},
                "fit_error_mm": {
                    "true": self.truth.fit_error_mm[0],
                    "stated": self.truth.fit_error_mm[1],
                },
            },
            "block": None if block is None else vars(block),
            "least_mean_weight": self.least_weight,
            "known_share": self.known,
        }


def _by_level(scored: Scores) -> dict[str, float]:
    return dict(zip(map(str, LEVELS), scored.coverage().tolist(), strict=True))


def evaluate(
    file: ModelFile,
    dataset: CloudDataset,
    seed: int,
    references: int,
    block: tuple[NetworkShape, TrainingSettings] | None,
    progress: Progress,
) -> Evaluation:
    """Raises TrainingError; ValueError, also where the model has seen all of the data.

    references: how many test configurations get a mixture of their own. block: how to train the
    network that never was in the block; None: that is not tried. progress: hears of each part.
    """
    model, unseen = file.model, Unseen.by(file, dataset)
    test, u = unseen.test, dataset.configurations[unseen.test]
    lines = dataset.centrelines_mm[test]
    progress.begin("likelihood and coverage", 0.0)
    points = scores(model.points, u, some_points(dataset, test, seed), seed)
    training = _training_nll_mm(model, dataset, unseen.learnt, seed)
    shapes = scores(model.shapes, u, coefficients_at(lines, model.basis), seed)
    reference = against_reference(model.points, dataset, test, references, seed, progress)
    tried = None
    if block is not None:
        tried = _block(model, dataset, unseen.learnt, *block, seed, progress)
    error, spread = _tip(model, u, lines)
    return Evaluation(
        unseen,
        points,
        shapes,
        training,
        reference,
        tried,
        float(weights_at(model.points, u).mean(axis=0).min()),
        error,
        spread,
        float(np.mean([model.knows(one) for one in u])),
        _against_truth(model, dataset, test, seed),
    )


def _training_nll_mm(
    model: RiskModel, dataset: CloudDataset, learnt: BoolArray, seed: int
) -> float | None:
    if not learnt.any():
        return None
    some = some_points(dataset, learnt, seed)[::_TRAINING]
    return scores(model.points, dataset.configurations[learnt][::_TRAINING], some, seed).mean_nll_mm


def _against_truth(
    model: RiskModel, dataset: CloudDataset, test: BoolArray, seed: int
) -> AgainstTruth | None:
    if dataset.true_centrelines_mm is None:
        return None
    u, true = dataset.configurations[test], _evenly_along(dataset.true_centrelines_mm[test])
    found = scores(model.shapes, u, coefficients_at(true, model.basis), seed)
    off = off_curves(dataset.centrelines_mm[test], true)
    median, most = np.quantile(off, _OFF).tolist()
    errors = float(np.sqrt(np.square(off).mean())), _rms(dataset.fit_error_mm[:, None])
    return AgainstTruth(found, _tip(model, u, true)[0], (median, most), errors)


def _evenly_along(lines_mm: SingleArray) -> SingleArray:
    """(k, s, nodes, 3) of the same curves, their nodes as far apart one from the other."""
    lines = lines_mm.reshape(-1, *lines_mm.shape[2:]).astype(np.float64)
    nodes = lines.shape[1]
    found = np.empty_like(lines)
    for line, even in zip(lines, found, strict=True):
        chords = np.linalg.norm(np.diff(line, axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(chords)])
        even[:] = CubicSpline(arc, line)(np.linspace(0.0, arc[-1], nodes))
    return found.reshape(lines_mm.shape).astype(np.float32)


def off_curves(nodes_mm: NDArray[Any], lines_mm: NDArray[Any]) -> FloatArray:
    """(..., nodes) distances of (..., nodes, 3) from the curves through as many nodes of others."""
    line = lines_mm.astype(np.float64)
    pieces, begins = np.diff(line, axis=-2), line[..., :-1, :]
    way = nodes_mm[..., :, None, :] - begins[..., None, :, :]
    squares = np.square(pieces).sum(axis=-1)[..., None, :]
    share = np.clip((way * pieces[..., None, :, :]).sum(axis=-1) / squares, 0.0, 1.0)
    away = np.linalg.norm(way - share[..., None] * pieces[..., None, :, :], axis=-1)
    return np.asarray(away.min(axis=-1))


def weights_at(network: MixtureNetwork, u: FloatArray) -> FloatArray:
    """(n, K) of the mixtures at (n, m) u."""
    mixtures = [network.mixture(one) for one in u]
    return np.array([mixture.weights for mixture in mixtures if mixture is not None])


def against_reference(
    network: MixtureNetwork,
    dataset: CloudDataset,
    test: BoolArray,
    count: int,
    seed: int,
    progress: Progress,
) -> AgainstReference:
    """At `count` of the test configurations, or all there are."""
    chosen = np.flatnonzero(test)[:count]
    rows = []
    half = dataset.clouds_mm.shape[1] // 2
    if not half:
        raise ValueError("a reference needs clouds of two starts or more")
    progress.begin("mixtures of each configuration by itself", float(len(chosen)))
    for i in chosen.tolist():
        clouds = dataset.clouds_mm[i].astype(np.float64)
        mixture = network.mixture(dataset.configurations[i])
        assert mixture is not None
        halves = [part.reshape(-1, 3) for part in (clouds[:half], clouds[half:])]
        found = []
        for fitted, kept in (halves, halves[::-1]):
            own = reference_mixture(fitted, network.components, seed)
            tried = ((mixture, kept), (own, kept), (own, fitted))
            found.append([-one.log_density(places).mean() for one, places in tried])
        rows.append(np.mean(found, axis=0))
        progress.advance()
    nll = np.array(rows)
    away = nll[:, 0] - nll[:, 1]
    random = np.random.default_rng(seed)
    again = away[random.integers(len(away), size=(_RESAMPLED, len(away)))].mean(axis=1)
    low, high = np.quantile(again, _INTERVAL).tolist()
    means = [nats_in_metres(float(value)) for value in nll.mean(axis=0)]
    return AgainstReference(len(chosen), means[0], means[1], means[2], (low, high))


def _block(
    model: RiskModel,
    dataset: CloudDataset,
    learnt: BoolArray,
    shape: NetworkShape,
    settings: TrainingSettings,
    seed: int,
    progress: Progress,
) -> BlockTrial:
    inside = dataset.block
    if not inside.any() or inside.all():
        raise ValueError("these data have no block that could be kept back")
    progress.begin("a network that has never been in the block", float(settings.steps))
    trained = train_points(
        dataset,
        ~dataset.test & ~inside,
        shape,
        settings,
        heard=lambda _, check: progress.reach(float(check.step)),
    )
    stranger = MixtureNetwork(trained.arrays, trained.activation)

    def scored(network: MixtureNetwork, chosen: BoolArray) -> Scores:
        return scores(
            network, dataset.configurations[chosen], some_points(dataset, chosen, seed), seed
        )

    within = scored(stranger, inside)
    return BlockTrial(
        int(inside.sum()),
        nats_in_metres(within.mean_nll_mm),
        nats_in_metres(scored(stranger, dataset.test & ~inside).mean_nll_mm),
        nats_in_metres(scored(model.points, inside).mean_nll_mm)
        if (inside & learnt).any()
        else None,
        tuple(within.coverage().tolist()),
    )


def _tip(model: RiskModel, u: FloatArray, centrelines_mm: SingleArray) -> tuple[float, float]:
    """Of (k, s, nodes, 3) at (k, m) u: see `Evaluation`."""
    tips = centrelines_mm[:, :, -1].astype(np.float64)
    base, modes = model.basis.base_mm[-1], model.basis.modes[:, -1]
    expected = np.empty((len(u), 1, 3))
    for i, place in enumerate(u):
        mixture = model.shapes.mixture(place)
        assert mixture is not None
        expected[i, 0] = base + mixture.weights @ mixture.means_mm @ modes
    middle = tips.mean(axis=1, keepdims=True)
    return _rms(tips - expected), _rms(tips - middle)


def _rms(away: FloatArray) -> float:
    return float(np.sqrt(np.square(away).sum(axis=-1).mean()))


def some_points(dataset: CloudDataset, chosen: BoolArray, seed: int) -> Any:
    """(k, p, 3) of the chosen configurations' points, the same share from every start."""
    clouds = dataset.clouds_mm[chosen]
    each = max(1, min(clouds.shape[2], _POINTS // clouds.shape[1]))
    which = np.random.default_rng(seed).permutation(clouds.shape[2])[:each]
    return clouds[:, :, which].reshape(len(clouds), -1, 3)
