"""What a motion is worth: its cost against the null-space attractor (Ho 2018, equations 7–11).

The reward of a sample is exp(−½ σ² C). The density's factor σ is dropped: it is the same for all
samples of a field, and only the ridge would notice it.
"""

import numpy as np

from daemon.learning.inverse.local_controller_kernels import exponents
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from drivers.pose import Vector

LEAST_MEAN_COST = 1e-9
"""Below it all steps are as good as the attractor's own, and rewards tell nothing apart."""

_BISECTIONS = 40


def attractor_step(settings: LocalControllerSettings, u: Vector, posture: Vector) -> Vector:
    """(…, m) Δu₀ = K_a (u₀ − u), no longer than `attractor_steps`, counted in axis_steps.

    Equation 8 prints u − u₀, which would drive away from u₀.
    """
    step: Vector = settings.attractor_gain * (posture - u) / settings.axis_steps
    if settings.attractor_steps is not None:
        typical = np.sqrt((step * step).sum(axis=-1, keepdims=True) / settings.axes)
        step = step / np.maximum(1.0, typical / settings.attractor_steps)
    return step


def costs(settings: LocalControllerSettings, u: Vector, delta_u: Vector, posture: Vector) -> Vector:
    """(…,) C = (Δu − Δu₀)ᵀ N (Δu − Δu₀) of (…, m) motions Δu that began at (…, m) u."""
    away = delta_u / settings.axis_steps - attractor_step(settings, u, posture)
    result: Vector = ((away @ settings.weighting_matrix) * away).sum(axis=-1)
    return result


def reward_scale(settings: LocalControllerSettings, weights: Vector, cost: Vector) -> float:
    """σ² of one field, whose (n,) samples have `weights` w and cost C. 0: no sample counts."""
    mass = float(weights.sum())
    if not mass > 0.0:
        return 0.0
    mean_cost = float(weights @ cost) / mass
    if settings.sigma_rule == "printed":
        return mean_cost
    sharpest = settings.sharpness / max(mean_cost, LEAST_MEAN_COST)
    if settings.sigma_rule == "inverse_mean":
        return sharpest
    return _sharpest_with(settings.least_effective_samples, weights, cost, sharpest)


def effective_samples(weights: Vector, cost: Vector, scale: float) -> float:
    """Kish's (Σ w r)² / Σ (w r)²: how many equal samples would say as much."""
    rewarded = weights * np.exp(-0.5 * scale * (cost - cost.min()))
    rewarded = rewarded / rewarded.max()
    return float(rewarded.sum() ** 2 / (rewarded @ rewarded))


def _sharpest_with(least: float, weights: Vector, cost: Vector, sharpest: float) -> float:
    if effective_samples(weights, cost, 0.0) <= least:
        return 0.0
    if effective_samples(weights, cost, sharpest) >= least:
        return sharpest
    enough, too_sharp = 0.0, sharpest
    for _ in range(_BISECTIONS):
        middle = 0.5 * (enough + too_sharp)
        if effective_samples(weights, cost, middle) >= least:
            enough = middle
        else:
            too_sharp = middle
    return enough


# Reward-weighted sums of all fields over all samples at once: one exponential, one product.


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
