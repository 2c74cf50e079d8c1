"""Reward-weighted sums of all fields over all samples at once: one exponential, one product."""

import numpy as np

from daemon.learning.inverse.local_controller_kernels import exponents
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.reward import LEAST_MEAN_COST, reward_scale
from drivers.pose import Vector


def reward_scales(
    settings: LocalControllerSettings, weights: Vector, cost: Vector
) -> tuple[Vector, Vector]:
    """(f,) σ² and (f,) Σ w of (f, n) weights and (n,) costs."""
    sums = np.column_stack([np.ones(len(cost)), cost])
    mass, costs = np.ascontiguousarray((weights @ sums).T)
    if settings.sigma_rule == "ess":
        return np.array([reward_scale(settings, row, cost) for row in weights]), mass
    mean_cost = costs / np.where(mass > 0.0, mass, 1.0)
    if settings.sigma_rule == "printed":
        return mean_cost, mass
    return settings.sharpness / np.maximum(mean_cost, LEAST_MEAN_COST), mass


def rewarded_products(
    log_weights: Vector, cost: Vector, scales: Vector, products: Vector, work: Vector, out: Vector
) -> None:
    """Write into `out` (f, F) Σ_k W_k φ_k, each row times a factor that makes its largest W 1.

    log_weights and work: (f, n or more), ln w and what is overwritten. cost: (n,). products:
    (n or more, F) φ.
    """
    exponents(log_weights, cost, scales, work)
    rewarded = work[:, : len(cost)]
    np.exp(rewarded, out=rewarded)
    np.dot(rewarded, products[: len(cost)], out=out)
