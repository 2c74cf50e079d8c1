"""How long locally weighted projection regression takes to learn a sample, and to answer.

The stream is that of an arm of two arcs: what
small motions do to its tip, [u, Δu] (12) to Δp (3), with fields on u.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from daemon.learning.lwpr.model import Lwpr, warm_up
from daemon.learning.lwpr.settings import LwprSettings
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.daemon.learning.streams import FloatArray, arm, cross, cross_of

SAMPLES = 30_000
CALLS = 4000
QUERIES = 1000
METRICS = {140: 15.5, 340: 24.0, 2000: 55.0}
"""By about how many fields they lead to."""
STILL: dict[str, Any] = {"adapt_metric": True, "init_learning_rate": 1e-6}
"""Everything is computed, and the fields stay as many as they are."""
MODES: dict[str, dict[str, Any]] = {
    "diagonal": STILL,
    "full": STILL | {"diagonal_only": False},
    "full_meta": STILL | {"diagonal_only": False, "meta": True, "meta_rate": 1e-6},
}
_SCALES: dict[str, Any] = {"norm_in": (1.0,) * 6 + (0.1,) * 6, "norm_out": (12.0,) * 3}


def measure(tiny: bool = False) -> Figures:
    """Microseconds per call, all three outputs, with the cost of calling from Python."""
    warm_up()
    samples, calls = (50, 20) if tiny else (SAMPLES, CALLS)
    named: dict[str, Callable[[], Figures]] = {
        f"{fields}_fields": partial(_speed, samples, calls, metric, asked=True)
        for fields, metric in METRICS.items()
    }
    for mode, settings in MODES.items():
        for fields in (140, 340):
            named[f"{fields}_fields_{mode}"] = partial(
                _speed, samples, calls, METRICS[fields], **settings
            )
    named["error_by_variance_cross"] = partial(_cross, 100 if tiny else 50_000)
    named["error_by_variance_arm"] = partial(_arm, samples)
    return pieces(named)


def _shared(metric: float, **settings: Any) -> Lwpr:
    return Lwpr(
        LwprSettings(12, 3, (metric,) * 6, localisation=tuple(range(6)), **_SCALES, **settings)
    )


def _apart(metric: float) -> Lwpr:
    """As the reference library: fields of its own for every output, distances over all inputs."""
    metrics = (metric,) * 6 + (1e-6,) * 6
    return Lwpr(LwprSettings(12, 3, metrics, init_s2=1e-10, compat=True, **_SCALES))


def _speed(
    samples: int, calls: int, metric: float, asked: bool = False, **settings: Any
) -> Figures:
    model = _shared(metric, **settings)
    x, y = arm(samples, seed=0)
    for i in range(samples):
        model.update(x[i], y[i])
    queries, _ = arm(QUERIES, seed=1)
    active = np.mean([(model.weights(query) > 1e-3).sum() for query in queries])

    def update(i: int) -> object:
        return model.update(x[i % samples], y[i % samples])

    figures: Figures = {"fields": model.count, "active": round(float(active), 1)}
    figures["update_us"] = _timed(update, calls)
    figures["predict_us"] = _timed(_asking(model.predict, queries), calls)
    if asked:
        figures["slopes_us"] = _timed(_asking(model.slopes, queries), calls)
        figures["confidence_us"] = _timed(_asking(model.confidence, queries), calls)
        figures["jacobian_us"] = _timed(_asking(model.jacobian, queries), calls)
        figures["activation_us"] = _timed(_asking(model.activation, queries), calls)
    return figures


def _asking(ask: Callable[[FloatArray], object], queries: FloatArray) -> Callable[[int], object]:
    return lambda i: ask(queries[i % QUERIES])


def _timed(call: Callable[[int], object], calls: int) -> Figures:
    spent = []
    for i in range(calls):
        began_ns = time.perf_counter_ns()
        call(i)
        spent.append(time.perf_counter_ns() - began_ns)
    return percentiles(spent, 1e-3)


def _cross(samples: int) -> Figures:
    """Noisy samples, asked on a grid without noise."""
    settings = LwprSettings(
        2, 1, (25.0, 25.0), generate_below=0.2, kernel="bisquare", diagonal_only=False,
        adapt_metric=True, init_learning_rate=250.0, meta=True,
    )  # fmt: skip
    model = Lwpr(settings)
    model.fit(*cross(samples, seed=0))
    side = np.linspace(-1.0, 1.0, 41)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return {"fields": model.count, "error": _errors(model, grid, cross_of(grid))}


def _arm(samples: int) -> Figures:
    """Fields of its own for every output, and no more fields in all, shared."""
    x, y = arm(samples, seed=0)
    queries, truth = arm(QUERIES, seed=1)
    figures: Figures = {}
    for name, model in {
        "apart_small": _apart(15.5),
        "shared_small": _shared(26.0),
        "apart_middle": _apart(24.0),
        "shared_middle": _shared(39.0),
    }.items():
        for i in range(samples):
            model.update(x[i], y[i])
        figures[name] = {"fields": model.count, "error": _errors(model, queries, truth)}
    return figures


def _errors(model: Lwpr, x: FloatArray, y: FloatArray) -> list[float]:
    predicted = np.array([model.predict(query) for query in x])
    errors = ((predicted - y) ** 2).mean(axis=0) / y.var(axis=0)
    return [round(float(error), 4) for error in errors]
