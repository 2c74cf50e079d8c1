"""A Gaussian mixture of one cloud by itself: what a network is measured against.

Expectation and maximisation from several beginnings. It finds a good mixture, not surely the best:
a reference, not a bound.
"""

from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray, Mixture

_FIRST_ROUNDS: Final = 15
"""From every beginning; the best goes on."""
_MOST_ROUNDS: Final = 300
_ENOUGH: Final = 1e-6
"""Nats per point and round."""
_LEAST: Final = 1e-12


def reference_mixture(
    points_mm: NDArray[Any],
    components: int,
    seed: int,
    beginnings: int = 10,
    thinnest_mm: float = 0.5,
) -> Mixture:
    """K normal distributions that (n, d) points could be of. Raises ValueError for too few points.

    thinnest_mm: no standard deviation is smaller, as for the networks.
    """
    points = np.asarray(points_mm, np.float64)
    if len(points) <= components * (points.shape[1] + 1):
        raise ValueError(f"{len(points)} points are too few for {components} components")
    middle = points.mean(axis=0)
    fit = _Fit(points - middle, thinnest_mm)
    random = np.random.default_rng(seed)
    chances = np.stack([fit.beginning(components, random) for _ in range(beginnings)])
    for _ in range(_FIRST_ROUNDS):
        chances, likelihood = fit.round(chances)
    chances = chances[np.argmax(likelihood)][None]
    before = -np.inf
    for _ in range(_MOST_ROUNDS):
        chances, likelihood = fit.round(chances)
        if likelihood[0] - before < _ENOUGH:
            break
        before = likelihood[0]
    weights, means, covariances = (part[0] for part in fit.moments(chances))
    factors = np.linalg.cholesky(np.linalg.inv(covariances)).transpose(0, 2, 1)
    return Mixture.checked(weights / weights.sum(), means + middle, np.triu(factors))


class _Fit:
    """Rounds of EM, several fits at once. Chances: (fits, K, n) that a point is of a component."""

    def __init__(self, points: FloatArray, thinnest_mm: float) -> None:
        n, d = points.shape
        self._points = points
        self._least = thinnest_mm**2 * np.eye(d)
        products = (points[:, :, None] * points[:, None, :]).reshape(n, d * d)
        self._features = np.concatenate([np.ones((n, 1)), points, products], axis=1)

    def beginning(self, components: int, random: Generator) -> FloatArray:
        """(K, n) of points that are far from each other, with all that is nearest to each."""
        points = self._points
        centres = points[random.integers(len(points))][None]
        for _ in range(components - 1):
            square = np.square(points[:, None] - centres).sum(axis=2).min(axis=1)
            total = square.sum()
            share = square / total if total > 0.0 else None
            centres = np.concatenate([centres, points[random.choice(len(points), 1, p=share)]])
        nearest = np.square(points[:, None] - centres).sum(axis=2).argmin(axis=1)
        return np.asarray(nearest == np.arange(components)[:, None], np.float64)

    def moments(self, chances: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights (fits, K), means (fits, K, d), covariances (fits, K, d, d)."""
        d = self._points.shape[1]
        sums = chances @ self._features
        counts = np.maximum(sums[..., 0], _LEAST)
        means = sums[..., 1 : d + 1] / counts[..., None]
        second = sums[..., d + 1 :].reshape(*counts.shape, d, d) / counts[..., None, None]
        covariances = second - means[..., :, None] * means[..., None, :]
        return counts / len(self._points), means, covariances + self._least

    def round(self, chances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Better chances, and (fits,) the mean log-likelihood of what these chances made."""
        weights, means, covariances = self.moments(chances)
        d = means.shape[-1]
        precision = np.linalg.inv(covariances)
        _, log_determinant = np.linalg.slogdet(precision)
        pulled = np.einsum("fkij,fkj->fki", precision, means)
        constant = np.einsum("fki,fki->fk", pulled, means)
        by_feature = np.concatenate(
            [
                (np.log(weights) + 0.5 * (log_determinant - constant - d * np.log(2 * np.pi)))[
                    ..., None
                ],
                pulled,
                -0.5 * precision.reshape(*weights.shape, d * d),
            ],
            axis=2,
        )
        parts = by_feature @ self._features.T
        largest = parts.max(axis=1, keepdims=True)
        density = np.exp(parts - largest)
        total = density.sum(axis=1, keepdims=True)
        likelihood = (largest + np.log(total))[:, 0].mean(axis=1)
        return density / total, likelihood
