"""Locally weighted projection regression: a model of many small linear models, learnt as one goes.

Vijayakumar, D'Souza, Schaal: Incremental Online Learning in High Dimensions (2005). Each receptive
field is a bell over the localisation inputs with a linear model of the regression inputs; what the
fields say is averaged by their weights. Fields come where samples come, learn their own shape if
told to, and forget at a given rate. By default all outputs share the fields, and a field that is
born among others goes on from what they say: with few samples and many inputs it would otherwise
be silent for long. With `settings.compat` each output has fields of its own, and the results are
those of the authors' C library.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daemon.learning.lwpr.field_set import FieldSet
from daemon.learning.lwpr.settings import LwprSettings
from drivers.pose import Vector

FloatArray = NDArray[np.float64]

_SUMS = ("energy", "covariance", "weight", "error", "trace_h", "trace_k")
"""What a direction keeps that grows with the weight of the samples."""


class Lwpr:
    """n inputs, k outputs, in the caller's own units. Queries never change the model.

    What is not finite is refused with a ValueError, and changes nothing.
    """

    def __init__(self, settings: LwprSettings) -> None:
        self.settings = settings
        norm_out = np.array(settings.norm_out)
        scales = [norm_out[k : k + 1] for k in range(len(norm_out))] if settings.compat else None
        self._sets = [FieldSet(settings, scale) for scale in scales or [norm_out]]

    @property
    def counts(self) -> tuple[int, ...]:
        """Fields of each output in `compat`, else the one number of fields."""
        return tuple(fields.arrays.count for fields in self._sets)

    @property
    def count(self) -> int:
        """All fields."""
        return sum(self.counts)

    @property
    def pruned(self) -> tuple[int, ...]:
        """Fields that went again, in the order of `counts`."""
        return tuple(fields.pruned for fields in self._sets)

    def reserve(self, fields: int) -> None:
        """Room for so many fields (of each output) ahead of time: no update then stops to grow."""
        for field_set in self._sets:
            field_set.reserve(fields)

    @property
    def nbytes(self) -> int:
        """Memory that the fields take."""
        return sum(fields.arrays.nbytes for fields in self._sets)

    def update(self, x: ArrayLike, y: ArrayLike) -> Vector:
        """Learns the sample (x (n,), y (k,)); gives (k,) what the model predicts for it now."""
        x, y = _vector(x), _vector(y)
        if not self.settings.compat:
            return self._sets[0].update(x, y)
        self._check_output(y)
        parts = [fields.update(x, y[k : k + 1]) for k, fields in enumerate(self._sets)]
        return np.concatenate(parts)

    def fit(
        self,
        inputs: ArrayLike,
        outputs: ArrayLike,
        epochs: int = 1,
        seed: int = 0,
        after_epoch: Callable[[int], None] | None = None,
    ) -> None:
        """Learns (samples, n) and (samples, k) `epochs` times, each time in another order."""
        x, y = np.array(inputs, dtype=np.float64), np.array(outputs, dtype=np.float64)
        if x.ndim != 2 or y.ndim != 2 or len(x) != len(y):
            raise ValueError("a batch is one row of inputs and one of outputs per sample")
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ValueError("a sample of the batch is not finite: the batch is refused")
        generator = np.random.default_rng(seed)
        for epoch in range(epochs):
            for i in generator.permutation(len(x)):
                self.update(x[i], y[i])
            if after_epoch is not None:
                after_epoch(epoch)

    def predict(self, x: ArrayLike) -> Vector:
        """(k,) at x (n,); 0 where no field has anything to say."""
        x = _vector(x)
        if len(self._sets) == 1:
            return self._sets[0].predict(x)
        return np.concatenate([fields.predict(x) for fields in self._sets])

    def confidence(self, x: ArrayLike) -> Vector:
        """(k,) one standard deviation of the prediction at x; infinite where no field can tell."""
        x = _vector(x)
        return np.concatenate([fields.confidence(x) for fields in self._sets])

    def jacobian(self, x: ArrayLike) -> FloatArray:
        """(k, n): the derivative of `predict` at x."""
        x = _vector(x)
        return np.concatenate([fields.jacobian(x) for fields in self._sets])

    def slopes(self, x: ArrayLike) -> FloatArray:
        """(k, n): how the outputs answer to the inputs near x, for control.

        The mean of the fields' slopes by weight: without the part of the derivative that comes from
        one field handing over to the next, which is mostly noise.
        """
        x = _vector(x)
        return np.concatenate([fields.slopes(x) for fields in self._sets])

    def weights(self, x: ArrayLike) -> Vector:
        """(fields,) how much each field weighs x, in the order of `centres`."""
        x = _vector(x)
        return np.concatenate([fields.weights(x) for fields in self._sets])

    def activation(self, x: ArrayLike) -> float:
        """The largest weight at x: 1 in the middle of a field, 0 far from all."""
        x = _vector(x)
        return max(fields.activation(x) for fields in self._sets)

    @property
    def centres(self) -> FloatArray:
        """(fields, l) of the normalised localisation inputs."""
        return np.concatenate([fields.centres for fields in self._sets])

    @property
    def metrics(self) -> FloatArray:
        """(fields, l, l): D, on the normalised localisation inputs."""
        return np.concatenate([fields.metrics for fields in self._sets])

    def fields_by_output(self) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """For each output its fields' centres and metrics, and how many directions each has."""
        if self.settings.compat:
            return [(f.centres, f.metrics, f.ranks[:, 0]) for f in self._sets]
        (shared,) = self._sets
        return [(shared.centres, shared.metrics, ranks) for ranks in shared.ranks.T]

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Everything that was learnt, as copies; `set 1`, `set 2` … belong to further outputs."""
        return {
            _key(number, name): array
            for number, fields in enumerate(self._sets)
            for name, array in fields.to_arrays().items()
        }

    @classmethod
    def from_arrays(cls, settings: LwprSettings, arrays: dict[str, NDArray[np.generic]]) -> Self:
        """Goes on from `to_arrays` to the last bit. ValueError where they do not fit `settings`."""
        model = cls(settings)
        for number, fields in enumerate(model._sets):
            prefix = _key(number, "")
            fields.restore(
                {
                    name.removeprefix(prefix): array
                    for name, array in arrays.items()
                    if name.startswith(prefix)
                }
            )
        return model

    def _check_output(self, y: Vector) -> None:
        """Before the first output learns what the last one would refuse."""
        if y.shape != (self.settings.outputs,) or not np.isfinite(y).all():
            raise ValueError("the output is not finite, or of another size: the sample is refused")


def with_memory(model: Lwpr, samples: float, *, by_weight: bool = False) -> Lwpr:
    """A copy whose fields remember so many of the samples that reach them, and of what they know
    believe no more than as many would tell. No new fields come.

    by_weight: samples count, and make forget, by how much they weigh in a field.

    Pre-training ends with a memory of 1e5 samples: at three samples a second a change of the body
    would be learnt in a day.
    """
    forgetting = 1.0 - 1.0 / samples
    settings = replace(
        model.settings,
        forgetting_initial=forgetting,
        forgetting_final=forgetting,
        generate_below=0.0,
        forget_by_weight=by_weight,
    )
    arrays: dict[str, NDArray[Any]] = {**model.to_arrays()}
    if model.settings == settings:
        return Lwpr.from_arrays(settings, arrays)
    for prefix in {name.rpartition("/")[0] for name in arrays}:
        directions = arrays[f"{prefix}/directions"]
        weight = directions["weight"][:, :, :1]
        kept = np.minimum(1.0, samples / np.maximum(weight, np.finfo(float).tiny))
        for name in _SUMS:
            directions[name] *= kept
        directions["forgetting"] = forgetting
        for name in ("along_sum", "load_sum"):
            arrays[f"{prefix}/{name}"] *= kept[..., None]
        arrays[f"{prefix}/outputs"]["transient"] *= kept[:, :, 0]
    return Lwpr.from_arrays(settings, arrays)


def with_corrections(model: Lwpr, samples: float, kept_s2: float) -> Lwpr:
    """A copy whose fields go on from what they say, and learn what is to be added to it: no more of
    the past than so many samples by weight, and along directions that are not seen nothing.

    kept_s2: how much evidence for the slopes as they are never fades, on normalised inputs.
    """
    copy = with_memory(model, samples, by_weight=True)
    settings = replace(copy.settings, kept_s2=kept_s2)
    arrays: dict[str, NDArray[Any]] = {**copy.to_arrays()}
    for prefix in {name.rpartition("/")[0] for name in arrays}:
        slope, outputs = arrays[f"{prefix}/slope"], arrays[f"{prefix}/outputs"]
        off = arrays[f"{prefix}/mean"] - arrays[f"{prefix}/anchor"]
        arrays[f"{prefix}/inherited"] = slope.copy()
        arrays[f"{prefix}/heir"][:] = arrays[f"{prefix}/trusted"]
        outputs["mean"] = outputs["level"] - np.einsum("ckw,cw->ck", slope, off)
        directions = arrays[f"{prefix}/directions"]
        for name in ("energy", "covariance", "beta", "error", "trace_h", "trace_k"):
            directions[name] = 0.0
        for name in ("along", "load"):
            arrays[f"{prefix}/{name}"][:] = np.eye(*slope.shape[2:] * 2)[: directions.shape[2]]
            arrays[f"{prefix}/{name}_sum"][:] = 0.0
    return Lwpr.from_arrays(settings, arrays)


def warm_up() -> None:
    """Compiles, or loads what was compiled before: to be done when nothing is in a hurry."""
    model = Lwpr(LwprSettings(1, 1, (1.0,), adapt_metric=True))
    for _ in range(2):
        model.update([0.0], [0.0])
    for ask in (model.predict, model.confidence, model.jacobian, model.slopes):
        ask([0.0])


def _vector(values: ArrayLike) -> Vector:
    """A copy in one piece: what the compiled code was compiled for."""
    vector: Vector = np.array(values, dtype=np.float64)
    if vector.ndim != 1:
        raise ValueError(f"one vector at a time, not an array of shape {vector.shape}")
    return vector


def _key(number: int, name: str) -> str:
    return f"set{number}/{name}"
