"""The forward model of a robot, [p, u, Δu] → Δp, as a locally weighted projection regression.

Fields say where they are valid by p and u. Their linear models are made of Δu alone: within a
field, p and u change what a Δu does only to second order, and a model of them would learn noise.
"""

import numpy as np
from numpy.typing import NDArray

from daemon.learning.lwpr.model import Lwpr
from daemon.learning.lwpr.settings import LwprSettings
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

_GENERATE_BELOW = 0.1
_ADD_THRESHOLD = 0.9
_SPREADS = 3.0
"""The tip counts in so many of its standard deviations, as the axes count in their travel."""
_SEARCH_STEPS = 30
_METRICS = (0.05, 5e4)
"""Fields with these metrics reach over everything, or over single samples."""
_SMALLEST = 1e-9
_STOOD = 1e-3
"""Of the largest step, in shares of the axes' travel: an axis whose steps are smaller stood still,
and what it seems to have done is its encoder's."""


def forward_settings(motions: MotionTable, travel: Vector, metric: float) -> LwprSettings:
    """For motions like these. metric: of a new field, along all p and u once they are normalised.

    travel: (m,) of the axes.
    """
    axes = motions.axes
    p_mm = _SPREADS * float(np.sqrt(motions.tip_mm.var(axis=0).mean()))
    steps = np.sqrt((motions.delta_u**2).mean(axis=0))
    largest = travel * (steps / travel).max()
    steps = np.where(steps > _STOOD * largest, steps, largest)
    step_mm = float(np.sqrt((motions.delta_tip_mm**2).mean()))
    scales = np.concatenate([np.full(3, p_mm), travel, steps])
    return LwprSettings(
        inputs=3 + 2 * axes,
        outputs=3,
        norm_in=tuple(np.maximum(scales, _SMALLEST)),
        norm_out=(max(step_mm, _SMALLEST),) * 3,
        localisation=tuple(range(3 + axes)),
        regression=tuple(range(3 + axes, 3 + 2 * axes)),
        init_metric=(metric,) * (3 + axes),
        generate_below=_GENERATE_BELOW,
        add_threshold=_ADD_THRESHOLD,
    )


def metric_for(
    motions: MotionTable, travel: Vector, order: NDArray[np.int64], fields: int
) -> float:
    """The metric with which these motions, in this order, make so many fields, or nearly.

    order: row numbers. Wider fields are fewer; how many they are is counted, and bisected.
    """
    settings = forward_settings(motions, travel, 1.0)
    places = (
        motions.inputs[order][:, : 3 + motions.axes]
        / np.array(settings.norm_in)[: 3 + motions.axes]
    )
    low, high = np.log(_METRICS)
    best, best_off = 1.0, np.inf
    for _ in range(_SEARCH_STEPS):
        middle = 0.5 * (low + high)
        metric = float(np.exp(middle))
        count = _fields_made(places, metric, 2 * fields)
        if abs(count - fields) < best_off:
            best, best_off = metric, abs(count - fields)
        if count == fields:
            break
        low, high = (low, middle) if count > fields else (middle, high)
    return best


def _fields_made(places: Vector, metric: float, most: int) -> int:
    """How many fields come: one wherever no other one is as active as it must be. Up to `most`."""
    nearest = -2.0 * np.log(_GENERATE_BELOW) / metric
    centres = np.empty((most + 1, places.shape[1]))
    count = 0
    for place in places:
        away = centres[:count] - place
        if count == 0 or np.einsum("fd,fd->f", away, away).min() >= nearest:
            centres[count] = place
            count += 1
            if count > most:
                break
    return count


def receptive_fields(model: Lwpr) -> ReceptiveFields:
    """Where a forward model's fields are: for local controllers that live on the same fields."""
    d = len(model.settings.localised_on)
    scale = np.array(model.settings.norm_in)[:d]
    return ReceptiveFields(model.centres, model.metrics, scale)


def slopes_by_step(model: Lwpr, tip_mm: Vector, u: Vector) -> Vector:
    """(3, m) mm per mm or rad: what a step of the axes does to the tip, here."""
    axes = len(u)
    x = np.concatenate([tip_mm, u, np.zeros(axes)])
    return np.asarray(model.slopes(x)[:, 3 + axes :])
