"""An arm of one arc that never comes to rest quite the same: its shapes, and both mixtures of them.

Shapes come from random curvatures, as friction would leave them. The mixture over places is one
normal distribution for each fifth of the body, the mixture over coefficients one over those of
polynomials: what trained networks would say of one actuation vector.
"""

from dataclasses import dataclass

import numpy as np

from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis

LENGTH_MM, RADIUS_MM, NODES = 200.0, 6.0, 41
_PARTS = 5
_POWERS = [(axis, power) for axis in (0, 1) for power in (2, 3, 4)] + [(2, 3), (2, 4)]
_FLOOR_MM = 0.1
ARC_MM = np.linspace(0.0, LENGTH_MM, NODES)


@dataclass(frozen=True)
class Pose:
    """A curvature per mm, the side it bends to, and how differently it comes to rest."""

    curvature: float
    turn_rad: float
    spread: float = 3e-4
    """Of the curvature in both directions, per mm."""


def shapes(pose: Pose, count: int, seed: int) -> FloatArray:
    """(count, NODES, 3) centrelines from the origin, along z at first."""
    random = np.random.default_rng(seed)
    bend = pose.curvature * np.array([np.cos(pose.turn_rad), np.sin(pose.turn_rad)])
    bends = bend + pose.spread * random.standard_normal((count, 2))
    curvature = np.linalg.norm(bends, axis=1)[:, None]
    towards = bends / curvature
    angle = curvature * ARC_MM
    aside = (1.0 - np.cos(angle)) / curvature
    return np.stack(
        [aside * towards[:, :1], aside * towards[:, 1:], np.sin(angle) / curvature], axis=2
    )


def points_mixture(pose: Pose) -> Mixture:
    """Where a random point of the body is, its thickness included."""
    random = np.random.default_rng(1)
    centres = shapes(pose, 400, seed=0)
    means, factors = [], []
    for part in np.array_split(centres[:, 1:], _PARTS, axis=1):
        cloud = part.reshape(-1, 3)
        skin = random.standard_normal(cloud.shape)
        cloud = cloud + RADIUS_MM * skin / np.linalg.norm(skin, axis=1, keepdims=True)
        means.append(cloud.mean(axis=0))
        factors.append(np.linalg.cholesky(np.linalg.inv(np.cov(cloud.T))).T)
    return Mixture.checked(np.full(_PARTS, 1.0 / _PARTS), means, factors)


def shape_mixture(pose: Pose) -> tuple[ShapeBasis, Mixture]:
    """Polynomials along the body, and how their coefficients are distributed."""
    share = ARC_MM / LENGTH_MM
    modes = np.zeros((len(_POWERS), NODES, 3))
    for mode, (axis, power) in zip(modes, _POWERS, strict=True):
        mode[:, axis] = share**power
    base = np.column_stack([np.zeros((NODES, 2)), ARC_MM])
    basis = ShapeBasis.checked(base, modes, np.full(NODES, RADIUS_MM), np.zeros(NODES), ARC_MM)
    wanted = (shapes(pose, 400, seed=0) - base).reshape(400, -1)
    fit = np.linalg.lstsq(modes.reshape(len(modes), -1).T, wanted.T, rcond=None)[0]
    covariance = np.cov(fit) + _FLOOR_MM**2 * np.eye(len(modes))
    factor = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return basis, Mixture.checked([1.0], [fit.mean(axis=1)], [factor])
