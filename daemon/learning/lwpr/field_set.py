"""One set of receptive fields that learns one or more outputs: a sample in, all steps in order."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from daemon.learning.lwpr.fields import FieldArrays, unpack_metrics
from daemon.learning.lwpr.learning_kernels import (
    DirectionRule,
    LearningFields,
    Sample,
    Scales,
    ShapeRule,
    Shapes,
    adapt,
    close,
    learn,
)
from daemon.learning.lwpr.query_kernels import (
    Active,
    Bells,
    Inputs,
    Models,
    Projections,
    activate,
    blend_confidence,
    blend_slopes,
    derivative,
    predict,
)
from daemon.learning.lwpr.settings import LwprSettings
from drivers.pose import Vector

_LEARNT_ABOVE = 1e-3
"""A field that weighs a sample no more than this does not learn from it."""
_INHERITS_ABOVE = 0.1
"""A new field takes over from the nearest if that weighs it more than this of `generate_below`."""

_NO_CONFIDENCE = 1e20

_Found = tuple[int, NDArray[np.int64], Vector]
"""As `Active`, but made faster."""


class _Direct:
    """A kernel, called past numba's dispatcher once it is compiled for the types of a first call.

    At every call the dispatcher looks up the type of each array in each named tuple, which takes
    about a microsecond per ten of them: a quarter of what a query takes. The types of all arguments
    must be those of the first call, that is float64 in one piece where there are arrays.
    """

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        self._compiled: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        if self._compiled is None:
            signature = tuple(
                numba.typeof(argument)  # type: ignore[no-untyped-call]
                for argument in arguments
            )
            self._kernel.compile(signature)
            self._compiled = self._kernel.overloads[signature].entry_point
        return self._compiled(*arguments)


_activate, _predict, _blend_confidence, _derivative, _learn, _adapt, _close = map(
    _Direct, (activate, predict, blend_confidence, derivative, learn, adapt, close)
)


class FieldSet:
    """Fields for the outputs that `norm_out` scales. x and y: as measured, float64, contiguous."""

    def __init__(self, settings: LwprSettings, norm_out: Vector) -> None:
        self._settings = settings
        self._norm_in = np.array(settings.norm_in)
        self._norm_out = norm_out
        self._derivative_scale: NDArray[np.float64] = norm_out[:, None] / self._norm_in
        self._localised = np.array(settings.localised_on, dtype=np.int64)
        self._regressed = np.array(settings.regressed_on, dtype=np.int64)
        periods = settings.period_of_inputs
        selected = (
            self._localised,
            periods[self._localised],
            self._regressed,
            periods[self._regressed],
        )
        self._inputs = Inputs(self._norm_in, *selected)
        self._scales = Scales(self._norm_in, norm_out, *selected)
        self._direction_rule = DirectionRule(
            float(settings.forgetting_initial), float(settings.forgetting_final),
            float(settings.forgetting_tau), float(settings.init_s2), float(settings.add_threshold),
        )  # fmt: skip
        self._by_weight = bool(settings.forget_by_weight)
        self._kept_s2 = float(settings.kept_s2)
        self._bisquare, self._cutoff = settings.kernel == "bisquare", float(settings.cutoff)
        self._shape_rule = ShapeRule(
            self._bisquare, float(settings.penalty), bool(settings.meta),
            float(settings.meta_rate), bool(settings.compat),
        )  # fmt: skip
        self.arrays = FieldArrays(settings, len(norm_out))
        self.pruned = 0
        self._make_workspace()

    def _make_workspace(self) -> None:
        shape = self.arrays.along.shape
        self._fields = np.empty(shape[0], dtype=np.int64)
        self._weights = np.empty(shape[0])
        self._errors = np.empty((*shape[:2], 2))
        arrays = self.arrays
        self._bells = Bells(arrays.centres, arrays.metrics, self._bisquare)
        self._models = _gathered(Models, arrays)
        self._projections = _gathered(Projections, arrays)
        self._learning = _gathered(LearningFields, arrays)
        self._shapes = _gathered(Shapes, arrays)

    def reserve(self, fields: int) -> None:
        """Room for so many fields."""
        self.arrays.reserve(fields)
        self._make_workspace()

    def update(self, x: Vector, y: Vector) -> Vector:
        """Learns from one sample; gives what the fields predict for it now."""
        arrays, settings = self.arrays, self._settings
        if arrays.make_room():
            self._make_workspace()
        fields, weights = self._fields, self._weights
        found, nearest, next_nearest, largest, second_largest = _activate(
            x, self._inputs, self._bells, arrays.count, _LEARNT_ABOVE, fields, weights
        )
        predicted = np.empty(len(self._norm_out))
        sample = Sample(x, y, found, fields, weights)
        _learn(
            self._scales,
            sample,
            self._learning,
            self._errors,
            predicted,
            self._by_weight,
            self._kept_s2,
        )
        if settings.adapt_metric:
            _adapt(
                self._scales, sample, self._learning, self._shapes, self._errors, self._shape_rule
            )
        largest_rank = _close(sample, self._learning, len(self._regressed), self._direction_rule)
        arrays.largest_rank = max(arrays.largest_rank, largest_rank)
        if largest <= settings.generate_below and (settings.compat or settings.generate_below > 0):
            shaped_by = nearest if largest > _INHERITS_ABOVE * settings.generate_below else None
            self._add(x, y, shaped_by, (found, fields, weights))
        elif second_largest > settings.prune_above:
            self._prune(nearest, next_nearest)
        return predicted

    def predict(self, x: Vector) -> Vector:
        """(k,) at x."""
        predicted = np.empty(len(self._norm_out))
        _predict(
            x, self._inputs, self._norm_out, self._bells, self._models, self.arrays.count,
            self._cutoff, predicted,
        )  # fmt: skip
        return predicted

    def confidence(self, x: Vector) -> Vector:
        """(k,) one standard deviation of the prediction."""
        confidence = np.empty(len(self._norm_out))
        _blend_confidence(
            x, self._inputs, Active(*self._look(x, self._cutoff)), self._models, self._projections,
            self._settings.compat, confidence,
        )  # fmt: skip
        known = confidence < _NO_CONFIDENCE
        confidence[known] *= self._norm_out[known]
        return confidence

    def jacobian(self, x: Vector) -> NDArray[np.float64]:
        """(k, n) derivative of the prediction."""
        jacobian = np.empty(self._derivative_scale.shape)
        active = Active(*self._look(x, self._cutoff))
        _derivative(x, self._inputs, active, self._bells, self._models, jacobian)
        jacobian *= self._derivative_scale
        return jacobian

    def slopes(self, x: Vector) -> NDArray[np.float64]:
        """(k, n) mean slope by weight."""
        slopes = np.zeros(self._derivative_scale.shape)
        blended = self._blend_slopes(self._look(x, self._cutoff))
        slopes[:, self._regressed] = blended[:, : len(self._regressed)]
        slopes *= self._derivative_scale
        return slopes

    def weights(self, x: Vector) -> Vector:
        """(count,) of all fields at x."""
        return self._look(x, -1.0)[2]

    def activation(self, x: Vector) -> float:
        """The largest weight at x."""
        found, _, weights = self._look(x, self._cutoff)
        return float(weights[:found].max(initial=0.0))

    @property
    def centres(self) -> NDArray[np.float64]:
        """(count, l) normalised."""
        return self.arrays.centres[:, : self.arrays.count].T.copy()

    @property
    def metrics(self) -> NDArray[np.float64]:
        """(count, l, l) on normalised inputs."""
        return unpack_metrics(self.arrays.metrics[:, : self.arrays.count], len(self._localised))

    @property
    def ranks(self) -> NDArray[np.float64]:
        """(count, k) directions of each output in each field."""
        return np.array(self.arrays.outputs["rank"][: self.arrays.count], dtype=np.float64)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """All that was learnt."""
        return self.arrays.to_arrays() | {"pruned": np.array(self.pruned)}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Raises ValueError where arrays do not fit."""
        self.arrays.restore(arrays)
        self.pruned = int(arrays.get("pruned", 0))
        self._make_workspace()

    def _look(self, x: Vector, cutoff: float) -> _Found:
        """Reads only: has its own memory, so that a query disturbs nothing."""
        count = self.arrays.count
        fields, weights = np.empty(count, dtype=np.int64), np.empty(count)
        found = _activate(x, self._inputs, self._bells, count, cutoff, fields, weights)[0]
        return found, fields, weights

    def _add(self, x: Vector, y: Vector, nearest: int | None, active: _Found) -> None:
        """A field at x, which takes the shape of the nearest if that is given."""
        arrays, (found, fields, _) = self.arrays, active
        scaled, y = x / self._norm_in, y / self._norm_out
        parent = nearest if nearest is not None and arrays.trusted[nearest] else None
        arrays.add(scaled[self._localised], scaled[self._regressed], y, parent)
        if not self._settings.compat and arrays.trusted[fields[:found]].any():
            arrays.inherit(y, self._blend_slopes(active))

    def _blend_slopes(self, active: _Found) -> NDArray[np.float64]:
        """(k, n and zeros) of normalised inputs and outputs."""
        blended = np.empty(self.arrays.slope.shape[1:])
        blend_slopes(*active, self.arrays.trusted, self.arrays.slope, blended)
        return blended

    def _prune(self, nearest: int, next_nearest: int) -> None:
        """Of two fields in the same place the one that predicts worse goes."""
        self.arrays.remove(self._worse_of(nearest, next_nearest))
        self.pruned += 1

    def _worse_of(self, a: int, b: int) -> int:
        if self._settings.compat:
            # The wider one, which the reference library's own manual would keep.
            return a if self._spread(a) < self._spread(b) else b
        return a if self._unseen_error(a) > self._unseen_error(b) else b

    def _spread(self, j: int) -> float:
        """Trace of D."""
        return float(np.sum(self.arrays.root[j] ** 2))

    def _unseen_error(self, j: int) -> float:
        """Mean squared error on samples not learnt yet; a field too young has no idea."""
        total, inputs = 0.0, len(self._regressed)
        for output, directions in zip(
            self.arrays.outputs[j], self.arrays.directions[j], strict=True
        ):
            last = directions[output["rank"] - 1]
            if last["samples"] <= 2 * inputs and output["rank"] > 1:
                last = directions[output["rank"] - 2]
            total += last["error"] / last["weight"] if last["error"] > 0.0 else np.inf
        return float(total)


def _gathered(kind: Any, arrays: FieldArrays) -> Any:
    """The arrays that the kernels want together; to be made anew when arrays are."""
    return kind(*(getattr(arrays, name) for name in kind._fields))
