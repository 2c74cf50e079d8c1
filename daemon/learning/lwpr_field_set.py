"""One set of receptive fields that learns one or more outputs: a sample in, all steps in order."""

import numpy as np
from numpy.typing import NDArray

from daemon.learning.lwpr_fields import FieldArrays, unpack_metrics
from daemon.learning.lwpr_metric import adapt
from daemon.learning.lwpr_prediction import blend_confidence, blend_slopes, derivative
from daemon.learning.lwpr_query import activate, predict
from daemon.learning.lwpr_regression import close, learn
from daemon.learning.lwpr_settings import LwprSettings
from drivers.pose import Vector

_LEARNT_ABOVE = 1e-3
"""A field that weighs a sample no more than this does not learn from it."""
_INHERITS_ABOVE = 0.1
"""A new field takes over from the nearest if that weighs it more than this of `generate_below`."""

_NO_CONFIDENCE = 1e20


_Active = tuple[int, NDArray[np.int64], Vector]
"""How many fields weigh a point, which, and how much: only so many of either are set."""


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
        self._localised_period = periods[self._localised]
        self._regressed_period = periods[self._regressed]
        self._forgetting = (
            settings.forgetting_initial,
            settings.forgetting_final,
            settings.forgetting_tau,
        )
        self._bisquare = settings.kernel == "bisquare"
        self.arrays = FieldArrays(settings, len(norm_out))
        self.pruned = 0
        self._make_workspace()

    def _make_workspace(self) -> None:
        shape = self.arrays.along.shape
        self._fields = np.empty(shape[0], dtype=np.int64)
        self._weights = np.empty(shape[0])
        self._errors = np.empty((*shape[:2], 2))

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
        found, nearest, next_nearest, largest, second_largest = activate(
            x, self._norm_in, self._localised, self._localised_period, arrays.centres,
            arrays.metrics, arrays.count, self._bisquare, _LEARNT_ABOVE, fields, weights,
        )  # fmt: skip
        predicted = np.empty(len(self._norm_out))
        learn(
            x, y, self._norm_in, self._norm_out, self._regressed, self._regressed_period, found,
            fields, weights, arrays.anchor, arrays.mean, arrays.inherited, arrays.heir,
            arrays.trusted, arrays.outputs, arrays.directions, arrays.along, arrays.along_sum,
            arrays.load, arrays.load_sum, arrays.slope, self._errors, predicted,
        )  # fmt: skip
        if settings.adapt_metric:
            self._adapt(x, (found, fields, weights))
        largest_rank = close(
            found, fields, arrays.outputs, arrays.directions, arrays.along, arrays.load,
            arrays.inherited, arrays.slope, len(self._regressed), self._forgetting,
            settings.init_s2, settings.add_threshold,
        )  # fmt: skip
        arrays.largest_rank = max(arrays.largest_rank, largest_rank)
        if largest <= settings.generate_below and (settings.compat or settings.generate_below > 0):
            shaped_by = nearest if largest > _INHERITS_ABOVE * settings.generate_below else None
            self._add(x, y, shaped_by, (found, fields, weights))
        elif second_largest > settings.prune_above:
            self._prune(nearest, next_nearest)
        return predicted

    def _adapt(self, x: Vector, active: _Active) -> None:
        arrays, settings = self.arrays, self._settings
        adapt(
            x, self._norm_in, self._localised, self._localised_period, *active, self._regressed,
            self._regressed_period, arrays.anchor, arrays.mean,
            arrays.along, arrays.load, arrays.centres, arrays.metrics, arrays.root, arrays.rate,
            arrays.log_rate, arrays.meta_trace, arrays.outputs, arrays.directions, self._errors,
            self._bisquare, settings.penalty, settings.meta, settings.meta_rate, settings.compat,
        )  # fmt: skip

    def predict(self, x: Vector) -> Vector:
        """(k,) at x."""
        arrays, predicted = self.arrays, np.empty(len(self._norm_out))
        predict(
            x, self._norm_in, self._norm_out, self._localised, self._localised_period,
            self._regressed, self._regressed_period, arrays.centres, arrays.metrics, arrays.count,
            self._bisquare, self._settings.cutoff, arrays.anchor, arrays.mean, arrays.trusted,
            arrays.outputs, arrays.slope, predicted,
        )  # fmt: skip
        return predicted

    def confidence(self, x: Vector) -> Vector:
        """(k,) one standard deviation of the prediction."""
        arrays, active = self.arrays, self._look(x, self._settings.cutoff)
        confidence = np.empty(len(self._norm_out))
        blend_confidence(
            x, self._norm_in, self._regressed, self._regressed_period, *active, arrays.anchor,
            arrays.mean, arrays.trusted, arrays.outputs, arrays.directions, arrays.along,
            arrays.load, arrays.slope, self._settings.compat, confidence,
        )  # fmt: skip
        known = confidence < _NO_CONFIDENCE
        confidence[known] *= self._norm_out[known]
        return confidence

    def jacobian(self, x: Vector) -> NDArray[np.float64]:
        """(k, n) derivative of the prediction."""
        arrays, active = self.arrays, self._look(x, self._settings.cutoff)
        jacobian = np.empty(self._derivative_scale.shape)
        derivative(
            x, self._norm_in, self._localised, self._localised_period, self._regressed,
            self._regressed_period, *active, self._bisquare, arrays.centres, arrays.metrics,
            arrays.anchor, arrays.mean, arrays.trusted, arrays.outputs, arrays.slope, jacobian,
        )  # fmt: skip
        jacobian *= self._derivative_scale
        return jacobian

    def slopes(self, x: Vector) -> NDArray[np.float64]:
        """(k, n) mean slope by weight."""
        slopes = np.zeros(self._derivative_scale.shape)
        blended = self._blend_slopes(self._look(x, self._settings.cutoff))
        slopes[:, self._regressed] = blended[:, : len(self._regressed)]
        slopes *= self._derivative_scale
        return slopes

    def weights(self, x: Vector) -> Vector:
        """(count,) of all fields at x."""
        return self._look(x, -1.0)[2]

    def activation(self, x: Vector) -> float:
        """The largest weight at x."""
        found, _, weights = self._look(x, self._settings.cutoff)
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

    def _look(self, x: Vector, cutoff: float) -> _Active:
        """Reads only: has its own memory, so that a query disturbs nothing."""
        arrays = self.arrays
        count = arrays.count
        fields, weights = np.empty(count, dtype=np.int64), np.empty(count)
        found = activate(
            x, self._norm_in, self._localised, self._localised_period, arrays.centres,
            arrays.metrics, count, self._bisquare, cutoff, fields, weights,
        )[0]  # fmt: skip
        return found, fields, weights

    def _add(self, x: Vector, y: Vector, nearest: int | None, active: _Active) -> None:
        """A field at x, which takes the shape of the nearest if that is given."""
        arrays, (found, fields, _) = self.arrays, active
        scaled, y = x / self._norm_in, y / self._norm_out
        parent = nearest if nearest is not None and arrays.trusted[nearest] else None
        arrays.add(scaled[self._localised], scaled[self._regressed], y, parent)
        if not self._settings.compat and arrays.trusted[fields[:found]].any():
            arrays.inherit(y, self._blend_slopes(active))

    def _blend_slopes(self, active: _Active) -> NDArray[np.float64]:
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
