"""Learns a forward model from an exploration, and says how well it predicts what it has not seen.

Whole lines are kept back for the test: two samples of one line are nearly the same.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.learning.forward.forward_model import forward_settings, metric_for
from daemon.learning.forward.smooth_model import (
    axes_shown,
    imagined,
    shown_lag_s,
    smooth_model,
)
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.samples.dataset import Dataset, Frames, sound_frames
from daemon.learning.samples.motion import Mask, MotionTable
from daemon.learning.samples.motion_samples import SamplingSettings, longest_step_s
from drivers.pose import Vector


class PretrainingError(ValueError):
    """Nothing can be learnt from these data; the text says why."""


# How much later than its axes the body moves: pneumatics, tubes and filters take their time.
#
# A motion of the tip that is put down to what the axes do at the same time is put down to the
# wrong thing wherever the axes turn. Here the tip's motions are explained by those of the axes
# some time before, with a Jacobian that changes linearly over the travel, and the time that
# explains them best is the lag.


_LAGS_S = np.arange(0.0, 0.401, 0.025)
_SPAN_S = 0.1
"""Length of the motions that are explained."""
_GAP_S = 0.1
_ROWS_AT_MOST = 6000
_ROWS_PER_FEATURE = 5
_RIDGE = 1e-6
_BEFORE_S = _SPAN_S + float(_LAGS_S[-1])
"""What is explained, and the earliest that may explain it."""


def body_lag_s(frames: Frames, travel: Vector) -> float:
    """Seconds, 0 or more. Raises PretrainingError where there are too few frames to tell.

    Frames that are not finite, out of order, or where the tip or an axis cannot have gone since the
    one before count as missing.
    """
    frames = sound_frames(frames, travel)
    t_s = (frames.t_ns - frames.t_ns[:1].sum()) * 1e-9
    ends_s = _ends(t_s)
    features = len(travel) * (1 + len(travel))
    if len(ends_s) < _ROWS_PER_FEATURE * features:
        raise PretrainingError(
            f"how late the body follows its axes cannot be told from {len(ends_s)} sound frames "
            f"with no gap in the {_BEFORE_S:g} s before them, {_ROWS_PER_FEATURE * features} are "
            "needed: explore for longer, or say how late it is (--lag)"
        )
    moved = _moved(t_s, frames.tip_mm, ends_s)
    left = [_unexplained(t_s, frames.u / travel, ends_s - lag_s, moved) for lag_s in _LAGS_S]
    return _lowest(np.array(left))


def _ends(t_s: Vector) -> Vector:
    """(k,) times at which a motion ends, with no gap anywhere near before."""
    if len(t_s) < 2:
        return np.zeros(0)
    gaps = np.flatnonzero(np.diff(t_s) > longest_step_s(t_s, _GAP_S))
    begins_s = np.concatenate([t_s[:1], t_s[gaps + 1]])
    sound_since = begins_s[np.searchsorted(begins_s, t_s, side="right") - 1]
    ends = t_s[t_s - sound_since >= _BEFORE_S]
    return np.asarray(ends[:: 1 + len(ends) // _ROWS_AT_MOST])


def _moved(t_s: Vector, values: Vector, ends_s: Vector) -> Vector:
    """(k, columns) what `values` changed by in the motions that end then."""
    columns = [
        np.interp(ends_s, t_s, column) - np.interp(ends_s - _SPAN_S, t_s, column)
        for column in values.T
    ]
    return np.stack(columns, axis=1)


def _unexplained(t_s: Vector, shares: Vector, ends_s: Vector, moved: Vector) -> float:
    """Mean square of the tip's motion that the axes' motions do not explain, mm²."""
    steps = _moved(t_s, shares, ends_s)
    at = np.stack([np.interp(ends_s, t_s, column) for column in shares.T], axis=1)
    at -= at.mean(axis=0)
    products = (steps[:, :, None] * at[:, None, :]).reshape(len(steps), -1)
    features = np.hstack([steps, products])
    gram = features.T @ features
    gram += _RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram))
    solution = np.linalg.solve(gram, features.T @ moved)
    return float(((moved - features @ solution) ** 2).mean())


def _lowest(left: Vector) -> float:
    """Where the parabola through the lowest value and its neighbours has its lowest point."""
    best = int(np.argmin(left))
    if best in (0, len(left) - 1):
        return float(_LAGS_S[best])
    before, here, after = left[best - 1 : best + 2].tolist()
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(_LAGS_S[best] + shift * (_LAGS_S[1] - _LAGS_S[0]))


SAMPLES_PER_FIELD = 100
"""How many samples a field needs is found by trying: with less it learns their noise."""
_SAMPLES_AT_LEAST, _SAMPLES_PER_COEFFICIENT = 50, 2
"""The lesser of both: few motions are learnt by way of a quadratic, which all frames tell, and has
nine coefficients for three axes, fourteen for four. 39 motions of a short, stiff arm of three
chambers led it to 0.2 mm, and 33 of one of four."""
_LONG_S = 60.0
"""Of an exploration."""
_FEW_MOTIONS, _IMAGINED = 2000, 4000
"""Fewer are learnt by way of a smooth model, as so many that it makes up."""
_LINES_AT_LEAST = 5


@dataclass(frozen=True)
class PretrainingSettings:
    """How a model is learnt."""

    epochs: int = 15
    fields: int | None = None
    """How many receptive fields; None: one for every hundred samples."""
    test_share: float = 0.2
    """Of the lines."""
    seed: int = 1
    """Of the lines kept back, and of the order in which the others are learnt."""
    sampling: SamplingSettings = field(default_factory=SamplingSettings)
    lag_s: float | None = None
    """Of the body. None: found in the data."""

    def __post_init__(self) -> None:
        if self.epochs < 1 or (self.fields is not None and self.fields < 1) or self.seed < 0:
            raise ValueError("epochs and fields are 1 or more, the seed 0 or more")
        if not 0.0 <= self.test_share < 1.0:
            raise ValueError(f"no {self.test_share:g} of the lines can be kept back")
        if self.lag_s is not None and not 0.0 <= self.lag_s < np.inf:
            raise ValueError(f"a body is not {self.lag_s:g} s late")


class EpochErrors(NamedTuple):
    """Root mean square of what the model says of Δp too much or too little, by coordinate, mm."""

    epoch: int
    """From 1."""
    train_mm: float
    test_mm: float
    """NaN where nothing was kept back."""
    all_mm: float


@dataclass(frozen=True)
class Pretraining:
    """A forward model, as it was after its best epoch, and how it came about."""

    model: Lwpr
    motions: MotionTable
    """All samples: those that were learnt, and those that were kept back."""
    test: Mask
    """(n,) which those are."""
    predicted_mm: Vector
    """(n, 3) Δp as the model has it."""
    errors: tuple[EpochErrors, ...]
    best_epoch: int
    sampling: SamplingSettings
    """With the lag that was found."""


def pretrain(
    dataset: Dataset,
    settings: PretrainingSettings,
    tell: Callable[[EpochErrors], None] = lambda _: None,
) -> Pretraining:
    """tell: hears of every epoch. Raises PretrainingError."""
    lag_s = settings.lag_s
    if lag_s is None:
        lag_s = _found_lag_s(dataset)
    sampling = replace(settings.sampling, lag_s=lag_s)
    motions = _motions(dataset, sampling)
    test = _kept_back(motions.line, settings)
    if len(motions) - test.sum() < _samples_at_least(motions.axes):
        raise PretrainingError(
            f"{len(motions) - int(test.sum())} motions are too few to learn from: take "
            f"shorter ones than {sampling.tip_mm:g} mm (`pretrain --sample`, or in an experiment "
            f"`pretraining: {{sample_tip_mm: {0.5 * sampling.tip_mm:g}}}`), or explore for longer "
            f"(`explore --duration`, or in an experiment `pretraining: {{waypoints: 80}}`)"
        )
    learnt = motions.of_rows(~test)
    if len(learnt) < _FEW_MOTIONS:
        smooth = smooth_model(dataset.frames, learnt.line, dataset.travel, lag_s)
        learnt = imagined(smooth, learnt, _IMAGINED, settings.seed)
    model = _empty_model(learnt, dataset.travel, settings)
    return _learnt(model, learnt, motions, test, settings, sampling, tell)


def _samples_at_least(axes: int) -> int:
    return min(_SAMPLES_AT_LEAST, _SAMPLES_PER_COEFFICIENT * axes * (axes + 3) // 2)


def _found_lag_s(dataset: Dataset) -> float:
    """From seconds of motion, or for a body that is very late, by a model that minds the lag's
    shape. Raises PretrainingError where there are too few frames to tell."""
    lag_s = body_lag_s(dataset.frames, dataset.travel)
    if dataset.frames.duration_s >= _LONG_S and lag_s < _LAGS_S[-1]:
        return lag_s
    return shown_lag_s(dataset.frames, dataset.travel)


def _motions(dataset: Dataset, sampling: SamplingSettings) -> MotionTable:
    """With the axes as the tip shows them. A short lag is a delay; a long one has a shape."""
    if sampling.lag_s < _LAGS_S[-1]:
        return dataset.motions(sampling)
    frames = dataset.frames
    t_s = (frames.t_ns - frames.t_ns[:1].sum()) * 1e-9
    shown = replace(frames, u=axes_shown(t_s, frames.u, sampling.lag_s))
    return replace(dataset, frames=shown).motions(replace(sampling, lag_s=0.0))


def _learnt(
    model: Lwpr,
    learnt: MotionTable,
    motions: MotionTable,
    test: Mask,
    settings: PretrainingSettings,
    sampling: SamplingSettings,
    tell: Callable[[EpochErrors], None],
) -> Pretraining:
    inputs, outputs = motions.inputs, motions.delta_tip_mm
    errors: list[EpochErrors] = []
    best_mm, best_epoch = np.inf, 0
    best: dict[str, NDArray[np.generic]] = {}
    predicted = np.zeros_like(outputs)

    def after(epoch: int) -> None:
        nonlocal best_mm, best_epoch, best, predicted
        said = np.array([model.predict(x) for x in inputs])
        told = _errors(epoch + 1, said - outputs, test)
        errors.append(told)
        counts_mm = told.test_mm if test.any() else told.train_mm
        if counts_mm < best_mm:
            best_mm, best_epoch, best, predicted = counts_mm, told.epoch, model.to_arrays(), said
        tell(told)

    model.fit(learnt.inputs, learnt.delta_tip_mm, settings.epochs, settings.seed, after)
    best_model = Lwpr.from_arrays(model.settings, best)
    return Pretraining(best_model, motions, test, predicted, tuple(errors), best_epoch, sampling)


def _empty_model(learnt: MotionTable, travel: Vector, settings: PretrainingSettings) -> Lwpr:
    fields = settings.fields or max(1, len(learnt) // SAMPLES_PER_FIELD)
    first_epoch = np.random.default_rng(settings.seed).permutation(len(learnt))
    metric = metric_for(learnt, travel, first_epoch, fields)
    return Lwpr(forward_settings(learnt, travel, metric))


def _kept_back(line: NDArray[np.int64], settings: PretrainingSettings) -> Mask:
    """(n,) which samples are for the test."""
    lines = np.unique(line)
    if settings.test_share <= 0.0:
        return np.zeros(len(line), dtype=np.bool_)
    if len(lines) < _LINES_AT_LEAST:
        raise PretrainingError(f"{len(lines)} lines are too few to keep any back for a test")
    count = max(1, round(settings.test_share * len(lines)))
    chosen = np.random.default_rng(settings.seed).choice(lines, count, replace=False)
    return np.isin(line, chosen)


def _errors(epoch: int, wrong_mm: Vector, test: Mask) -> EpochErrors:
    def rms(part: Vector) -> float:
        return float(np.sqrt((part**2).mean())) if len(part) else float("nan")

    return EpochErrors(epoch, rms(wrong_mm[~test]), rms(wrong_mm[test]), rms(wrong_mm))
