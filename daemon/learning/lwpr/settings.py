"""What a locally weighted projection regression is told once: sizes, units, and how it learns."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from drivers.pose import Vector

_FLOATS = (
    "generate_below", "prune_above", "init_learning_rate", "penalty", "meta_rate", "cutoff",
    "forgetting_initial", "forgetting_final", "forgetting_tau", "init_s2", "kept_s2",
    "add_threshold",
)  # fmt: skip

Metric = tuple[float, ...] | tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class LwprSettings:
    """Names follow Vijayakumar, D'Souza and Schaal (2005). Numbers, tuples and words only.

    Sequences and arrays are taken for tuples; an impossible value is a ValueError.
    """

    inputs: int
    outputs: int
    init_metric: Metric
    """D of a new field: its diagonal, or all of it, on the normalised localisation inputs."""
    norm_in: tuple[float, ...] = ()
    """What each input is divided by; (): nothing."""
    norm_out: tuple[float, ...] = ()
    localisation: tuple[int, ...] | None = None
    """The inputs that say how near a field is. None: all."""
    regression: tuple[int, ...] | None = None
    """The inputs that a field's linear model is made of. None: all."""
    periods: tuple[float | None, ...] | None = None
    """After how much each input comes round to itself, in its own unit. None: never."""
    kernel: Literal["gaussian", "bisquare"] = "gaussian"
    generate_below: float = 0.1
    """A sample that no field weighs more than this gets a field of its own. 0: no new fields."""
    prune_above: float = 1.0
    """Of two fields that both weigh a sample more than this, one goes. 1: never."""
    init_learning_rate: float = 50.0
    """Of the metric, per element of its root."""
    penalty: float = 1e-6
    """On ΣD²: keeps fields from shrinking for nothing."""
    meta: bool = False
    """Each element's learning rate is learnt as well (incremental delta-bar-delta)."""
    meta_rate: float = 250.0
    diagonal_only: bool = True
    adapt_metric: bool = False
    forgetting_initial: float = 0.999
    forgetting_final: float = 0.99999
    """A field remembers about 1/(1 - this) of the samples that reached it."""
    forgetting_tau: float = 0.9999
    """How slowly the first goes over into the second."""
    forget_by_weight: bool = False
    """A field forgets by how much a sample weighs in it, and not as much for every one that reaches
    it: what is far from a path does not fade while the path is gone along. Fixed shapes only."""
    kept_s2: float = 0.0
    """As much evidence, Σws², speaks for the slope that a field inherited, and is never forgotten:
    along directions that samples do not show it stays."""
    init_s2: float = 1e-3
    """Σws² that a direction starts with: as much evidence for what the field inherited."""
    add_threshold: float = 0.5
    """The next direction comes when the last one made the error less than this times smaller."""
    cutoff: float = 0.001
    """A field that weighs a query no more than this has no say in it."""
    compat: bool = False
    """Separate fields for every output, and what the reference library does where it is odd.

    Else a field that is born among others goes on from their slopes and is trusted at once.
    """

    def __post_init__(self) -> None:
        for name in _FLOATS:
            self._set(name, float(getattr(self, name)))
        metric = np.asarray(self.init_metric, dtype=np.float64)
        self._set("norm_in", _ones_or(self.norm_in, self.inputs, "norm_in"))
        self._set("norm_out", _ones_or(self.norm_out, self.outputs, "norm_out"))
        self._set("localisation", self._chosen(self.localisation, "localisation"))
        self._set("regression", self._chosen(self.regression, "regression"))
        self._set("periods", self._periods())
        self._set("init_metric", _tuples(metric))
        self._check(metric)

    @property
    def init_metric_matrix(self) -> NDArray[np.float64]:
        """D of a new field, (l, l)."""
        metric = np.asarray(self.init_metric, dtype=np.float64)
        return np.diag(metric) if metric.ndim == 1 else metric

    @property
    def period_of_inputs(self) -> Vector:
        """(n,) of normalised inputs; 0 where an input never comes round."""
        periods = self.periods or (None,) * self.inputs
        normalised: Vector = np.array([p or 0.0 for p in periods]) / np.asarray(self.norm_in)
        return normalised

    @property
    def localised_on(self) -> tuple[int, ...]:
        """Localisation inputs by index."""
        return tuple(range(self.inputs)) if self.localisation is None else self.localisation

    @property
    def regressed_on(self) -> tuple[int, ...]:
        """Regression inputs by index."""
        return tuple(range(self.inputs)) if self.regression is None else self.regression

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, settings: dict[str, Any]) -> Self:
        """From what `to_dict` gave, also after JSON. ValueError for what it does not know."""
        unknown = set(settings) - {field.name for field in fields(cls)}
        if unknown:
            raise ValueError(f"no setting of a regression: {', '.join(sorted(unknown))}")
        return cls(**settings)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _chosen(self, indices: Sequence[int] | None, name: str) -> tuple[int, ...] | None:
        if indices is None:
            return None
        chosen = tuple(int(index) for index in indices)
        if not chosen or len(set(chosen)) < len(chosen):
            raise ValueError(f"{name}: name at least one input, and each once")
        if not all(0 <= index < self.inputs for index in chosen):
            raise ValueError(f"{name}: inputs are numbered 0 to {self.inputs - 1}")
        return chosen

    def _periods(self) -> tuple[float | None, ...] | None:
        if self.periods is None:
            return None
        periods = tuple(None if p is None else float(p) for p in self.periods)
        if len(periods) != self.inputs or not all(
            p is None or (math.isfinite(p) and p > 0) for p in periods
        ):
            raise ValueError(f"periods: {self.inputs} of them, each above 0 or None")
        return periods

    def _check(self, metric: NDArray[np.float64]) -> None:
        if self.inputs < 1 or self.outputs < 1:
            raise ValueError("a regression needs at least one input and one output")
        _check_metric(metric, len(self.localised_on), self.diagonal_only)
        if self.kernel not in ("gaussian", "bisquare"):
            raise ValueError("kernel: gaussian or bisquare")
        if self.forget_by_weight and (self.adapt_metric or self.compat):
            raise ValueError("forget_by_weight: with neither adapt_metric nor compat")
        for name in ("forgetting_initial", "forgetting_final", "forgetting_tau"):
            if not 0 < getattr(self, name) <= 1:
                raise ValueError(f"{name}: above 0 and up to 1")
        for name in ("init_learning_rate", "init_s2"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: above 0")
        for name in (
            "penalty",
            "kept_s2",
            "meta_rate",
            "generate_below",
            "prune_above",
            "cutoff",
            "add_threshold",
        ):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: not below 0")


def _ones_or(values: Sequence[float], count: int, name: str) -> tuple[float, ...]:
    given = tuple(float(value) for value in values) or (1.0,) * count
    if len(given) != count or not all(math.isfinite(value) and value > 0 for value in given):
        raise ValueError(f"{name}: {count} numbers above 0")
    return given


def _tuples(metric: NDArray[np.float64]) -> Metric:
    if metric.ndim == 2:
        return tuple(tuple(float(value) for value in row) for row in metric)
    return tuple(float(value) for value in np.atleast_1d(metric))


def _check_metric(metric: NDArray[np.float64], size: int, diagonal_only: bool) -> None:
    if metric.shape not in ((size,), (size, size)):
        raise ValueError(f"init_metric: {size} numbers, or {size} x {size}")
    matrix = np.diag(metric) if metric.ndim == 1 else metric
    if not np.isfinite(matrix).all() or not np.array_equal(matrix, matrix.T):
        raise ValueError("init_metric: finite and symmetric")
    if diagonal_only and np.count_nonzero(matrix - np.diag(np.diag(matrix))):
        raise ValueError("init_metric: has more than a diagonal; set diagonal_only to False")
    if np.linalg.eigvalsh(matrix)[0] <= 0:
        raise ValueError("init_metric: positive definite")
