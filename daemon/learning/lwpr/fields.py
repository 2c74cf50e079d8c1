"""The numbers that receptive fields are made of: one array per kind, which grow together.

Shapes: capacity c (fields there is room for), l localisation inputs, t elements of a metric's root
(l on the diagonal, l(l+1)/2 of the upper triangle, row by row), n regression inputs and zeros up
to a multiple of four (which processors work on at once), k outputs, r directions there is room for.
All in normalised units.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.learning.lwpr.settings import LwprSettings
from drivers.pose import Vector

FloatArray = NDArray[np.float64]
Records = NDArray[np.void]

OUTPUT = np.dtype(
    [
        ("mean", "f8"),  # β₀, of the output, or of what is left of it beside the inherited slope
        ("level", "f8"),  # the prediction at the mean input
        ("freedom", "f8"),  # V: degrees of freedom that the directions took
        ("transient", "f8"),  # E₀: squared errors after learning
        ("rank", "i8"),  # directions in use
    ]
)
"""Of one output in one field."""

DIRECTION = np.dtype(
    [
        ("energy", "f8"),  # S: Σ w s²
        ("covariance", "f8"),  # Σ w s y
        ("beta", "f8"),
        ("weight", "f8"),  # W: Σ w
        ("samples", "f8"),  # n
        ("forgetting", "f8"),  # λ
        ("error", "f8"),  # E: squared errors before learning, that is on samples never seen
        ("trace_h", "f8"),  # H, and below K: what a changed weight did to the older errors
        ("trace_k", "f8"),
    ]
)
"""Of one direction of one output in one field. All sums forget."""

_MASS_OF_NOTHING = 1e-10
_FIRST_CAPACITY = 16
_FIRST_RANK = 2
_AT_ONCE = 4


class FieldArrays:
    """Receptive fields 0 … count-1 in the order of their birth. See the module for the shapes."""

    _BY_FIELD = (
        "root", "rate", "log_rate", "meta_trace", "anchor", "mean", "trusted", "slope",
        "inherited", "heir", "outputs", "directions", "along", "along_sum", "load", "load_sum",
    )  # fmt: skip
    _BY_COLUMN = ("centres", "metrics")
    _BY_RANK = ("directions", "along", "along_sum", "load", "load_sum")

    def __init__(self, settings: LwprSettings, outputs: int) -> None:
        self._settings = settings
        self.sizes = len(settings.localised_on), len(settings.regressed_on), outputs
        self.count = 0
        localised, inputs, outputs = self.sizes
        elements = localised
        if not settings.diagonal_only:
            elements = localised * (localised + 1) // 2
        capacity, rank = _FIRST_CAPACITY, min(_FIRST_RANK, inputs)
        width = inputs + -inputs % _AT_ONCE
        self.centres: FloatArray = np.zeros((localised, capacity))
        self.metrics: FloatArray = np.zeros((elements, capacity))
        """Coefficients of the quadratic form: D on its diagonal, 2D beside it."""
        self.root: FloatArray = np.zeros((capacity, elements))
        """M, upper triangular: D = MᵀM."""
        self.rate: FloatArray = np.zeros((capacity, elements))
        self.log_rate: FloatArray = np.zeros((capacity, elements))
        self.meta_trace: FloatArray = np.zeros((capacity, elements))
        self.anchor: FloatArray = np.zeros((capacity, width))
        """Where the field was born: inputs that come round are measured from here."""
        self.mean: FloatArray = np.zeros((capacity, width))
        self.trusted: NDArray[np.bool_] = np.zeros(capacity, dtype=np.bool_)
        self.slope: FloatArray = np.zeros((capacity, outputs, width))
        """What all comes to: prediction = level + slope · (x - mean)."""
        self.inherited: FloatArray = np.zeros((capacity, outputs, width))
        """The slope that the field began with; directions are regressed on what it leaves."""
        self.heir: NDArray[np.bool_] = np.zeros(capacity, dtype=np.bool_)
        """It began with one, and is trusted from the start."""
        self.outputs: Records = np.zeros((capacity, outputs), dtype=OUTPUT)
        self.directions: Records = np.zeros((capacity, outputs, rank), dtype=DIRECTION)
        shape = (capacity, outputs, rank, width)
        self.along: FloatArray = np.zeros(shape)
        """u: unit vectors that inputs are projected on."""
        self.along_sum: FloatArray = np.zeros(shape)
        self.load: FloatArray = np.zeros(shape)
        """p: what of the inputs a projection explains, and is taken out of them."""
        self.load_sum: FloatArray = np.zeros(shape)
        self.largest_rank = rank

    @property
    def nbytes(self) -> int:
        """Memory of all arrays."""
        return sum(getattr(self, name).nbytes for name in (*self._BY_FIELD, *self._BY_COLUMN))

    def make_room(self) -> bool:
        """For one more field and one more direction: twice the room, when there is none left.

        True when arrays have new shapes.
        """
        full = self.count == len(self.mean)
        inputs, rank = self.sizes[1], self.along.shape[2]
        narrow = self.largest_rank == rank < inputs
        if full:
            self._resize(2 * self.count)
        if narrow:
            self._widen(min(2 * rank, inputs))
        return full or narrow

    def reserve(self, fields: int) -> None:
        """Room for so many fields, if there is less."""
        if fields > len(self.mean):
            self._resize(fields)

    def add(self, z: Vector, x: Vector, y: Vector, parent: int | None) -> None:
        """A field centred at z, with its parent's metric, count of directions and mean if any.

        z: (l,), x: (n,) and y: (k,), normalised.
        """
        j, settings = self.count, self._settings
        self.centres[:, j] = z
        self.anchor[j, : len(x)], self.anchor[j, len(x) :] = x, 0.0
        if parent is None:
            root = np.linalg.cholesky(settings.init_metric_matrix).T
            self.root[j] = pack(root, settings.diagonal_only)
            self.metrics[:, j] = coefficients(settings.init_metric_matrix, settings.diagonal_only)
            self.rate[j] = settings.init_learning_rate
            self.outputs[j]["mean"] = y
            self.outputs[j]["rank"] = min(_FIRST_RANK, len(x))
        else:
            self.root[j], self.rate[j] = self.root[parent], self.rate[parent]
            self.metrics[:, j] = self.metrics[:, parent]
            for name in ("mean", "rank"):
                self.outputs[j][name] = self.outputs[parent][name]
        self.log_rate[j] = np.log(self.rate[j] + _MASS_OF_NOTHING)
        self._forget_everything(j)
        self.count += 1

    def inherit(self, y: Vector, slope: FloatArray) -> None:
        """The newest field predicts y where it was born, and goes on with slope (k, n)."""
        j = self.count - 1
        self.heir[j] = self.trusted[j] = True
        self.mean[j], self.slope[j], self.inherited[j] = self.anchor[j], slope, slope
        self.outputs[j]["mean"] = self.outputs[j]["level"] = y

    def _forget_everything(self, j: int) -> None:
        for name in (
            "meta_trace", "mean", "trusted", "slope", "inherited", "heir", "along_sum", "load_sum"
        ):  # fmt: skip
            getattr(self, name)[j] = 0
        for name in ("level", "freedom", "transient"):
            self.outputs[j][name] = 0.0
        self.directions[j] = 0
        self.directions[j]["energy"] = self._settings.init_s2
        self.directions[j]["weight"] = self.directions[j]["samples"] = _MASS_OF_NOTHING
        self.directions[j]["forgetting"] = self._settings.forgetting_initial
        for r in range(self.along.shape[2]):
            self.along[j, :, r] = self.load[j, :, r] = 0.0
            self.along[j, :, r, r] = self.load[j, :, r, r] = 1.0

    def remove(self, j: int) -> None:
        """The last field takes its place."""
        last = self.count - 1
        for name in self._BY_FIELD:
            array = getattr(self, name)
            array[j] = array[last]
        for name in self._BY_COLUMN:
            array = getattr(self, name)
            array[:, j] = array[:, last]
        self.count = last

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Copies of what is in use, by name."""
        arrays = {name: getattr(self, name)[: self.count].copy() for name in self._BY_FIELD}
        for name in self._BY_COLUMN:
            arrays[name] = getattr(self, name)[:, : self.count].copy()
        return arrays

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """From `to_arrays`. Raises ValueError where arrays are missing or of other shapes."""
        names = (*self._BY_FIELD, *self._BY_COLUMN)
        missing = set(names) - set(arrays)
        if missing:
            raise ValueError(f"the model's arrays {', '.join(sorted(missing))} are missing")
        count, rank = len(arrays["mean"]), arrays["along"].shape[2]
        self._resize(max(count, len(self.mean)))
        self._widen(rank)
        for name in names:
            mine, given = getattr(self, name), arrays[name]
            part = mine[:, :count] if name in self._BY_COLUMN else mine[:count]
            if part.shape != given.shape or part.dtype != given.dtype:
                raise ValueError(f"the model's array {name} does not fit its settings")
            if not all(np.isfinite(column).all() for column in _columns(given)):
                raise ValueError(f"the model's array {name} is not finite")
            part[...] = given
        self.count = count
        self.largest_rank = int(self.outputs["rank"][:count].max(initial=_FIRST_RANK))

    def _resize(self, capacity: int) -> None:
        for name in self._BY_FIELD:
            old = getattr(self, name)
            new = np.zeros((capacity, *old.shape[1:]), dtype=old.dtype)
            new[: self.count] = old[: self.count]
            setattr(self, name, new)
        for name in self._BY_COLUMN:
            old = getattr(self, name)
            new = np.zeros((old.shape[0], capacity))
            new[:, : self.count] = old[:, : self.count]
            setattr(self, name, new)

    def _widen(self, rank: int) -> None:
        for name in self._BY_RANK:
            old = getattr(self, name)
            new = np.zeros((*old.shape[:2], rank, *old.shape[3:]), dtype=old.dtype)
            new[:, :, : old.shape[2]] = old[:, :, :rank]
            setattr(self, name, new)


def _columns(array: NDArray[Any]) -> list[NDArray[Any]]:
    return [array[name] for name in array.dtype.names] if array.dtype.names else [array]


def pack(matrix: NDArray[np.floating], diagonal_only: bool) -> NDArray[np.floating]:
    """The diagonal, or the upper triangle row by row."""
    if diagonal_only:
        return np.diag(matrix).copy()
    return matrix[np.triu_indices(len(matrix))]


def coefficients(metric: FloatArray, diagonal_only: bool) -> NDArray[np.floating]:
    """Of the quadratic form that `metric` is: an element beside the diagonal counts twice."""
    return pack(2.0 * metric - np.diag(np.diag(metric)), diagonal_only)


def unpack_metrics(packed: FloatArray, size: int) -> FloatArray:
    """(fields, size, size) from the coefficients of their quadratic forms, (t, fields)."""
    metrics = np.zeros((packed.shape[1], size, size))
    diagonal = np.arange(size)
    if len(packed) == size:
        metrics[:, diagonal, diagonal] = packed.T
        return metrics
    rows, columns = np.triu_indices(size)
    metrics[:, rows, columns] = packed.T
    return (metrics + metrics.transpose(0, 2, 1)) / 2.0
