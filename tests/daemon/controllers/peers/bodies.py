"""A body that is a formula: where its tip is, what its motions are, and what an exploration saw."""

from typing import Any

import numpy as np

from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.motion_samples import SamplingSettings
from drivers.pose import Vector

AXES = 4
SCALE = np.array([50.0, 50.0, 50.0, 2.0])
_LINEAR = 40.0 * np.random.default_rng(3).normal(size=(3, AXES))
_BENT = 15.0 * np.random.default_rng(4).normal(size=(3, AXES, AXES))


def tip(u: Vector, bent: float = 1.0) -> Vector:
    """(3,) mm."""
    x = u / SCALE
    return np.asarray(_LINEAR @ x + bent * np.einsum("rij,i,j->r", _BENT, x, x))


def true_jacobian(u: Vector, bent: float = 1.0) -> Vector:
    """(3, m) mm per mm or rad."""
    x = u / SCALE
    by_share = _LINEAR + bent * np.einsum("rij,j->ri", _BENT + _BENT.transpose(0, 2, 1), x)
    return np.asarray(by_share / SCALE)


def motions(
    count: int = 600, noise_mm: float = 0.0, bent: float = 1.0, seed: int = 1
) -> MotionTable:
    """Of an exploration of all of the travel, in lines of ten."""
    random = np.random.default_rng(seed)
    u = SCALE * random.uniform(0.0, 1.0, (count, AXES))
    delta_u = 0.05 * SCALE * random.normal(size=(count, AXES))
    before = np.array([tip(one, bent) for one in u])
    after = np.array([tip(one, bent) for one in u + delta_u])
    moved = after - before + noise_mm * random.normal(size=before.shape)
    return MotionTable(before, u, delta_u, moved, np.arange(count) // 10)


def model_of(table: MotionTable) -> PretrainedModel:
    """What pre-training makes of it, but for the regression, which the peers do not look at."""
    regression: Any = None
    return PretrainedModel(regression, table, SamplingSettings(), {})
