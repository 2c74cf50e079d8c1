"""A mixture of normal distributions, as the network gives it and the risks use it.

A component is held by the upper triangular factor Ū of its precision, Σ⁻¹ = ŪᵀŪ: whitening needs
no inverse, and the density no determinant. Over three dimensions it says where a random point of
the body is; over more, which coefficients its shape has.
"""

from dataclasses import dataclass
from math import log, pi
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

MOST_COMPONENTS: Final = 16
_SUM_TOLERANCE: Final = 1e-6
"""By how much written weights may miss one."""


class MixtureError(ValueError):
    """Numbers that are no mixture. Says which of them, and what is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """K normal distributions over d coordinates in mm. Made by the network, or by `checked`."""

    weights: FloatArray
    """(K,) sum to one."""
    means_mm: FloatArray
    """(K, d)."""
    factors_per_mm: FloatArray
    """(K, d, d) Ū, upper triangular with a positive diagonal."""

    @classmethod
    def checked(
        cls, weights: ArrayLike, means_mm: ArrayLike, factors_per_mm: ArrayLike
    ) -> "Mixture":
        """A mixture of numbers from anywhere. Raises MixtureError."""
        try:
            parts = [np.array(part, np.float64) for part in (weights, means_mm, factors_per_mm)]
        except (TypeError, ValueError, OverflowError) as error:
            raise MixtureError(
                f"weights, means and factors are arrays of numbers: {error}"
            ) from None
        _check_shapes(*parts)
        _check_values(*parts)
        return cls(parts[0] / parts[0].sum(), parts[1], parts[2])

    @property
    def components(self) -> int:
        """K."""
        return len(self.weights)

    @property
    def dimensions(self) -> int:
        """d."""
        return int(self.means_mm.shape[1])

    def whitened(self, component: int, points_mm: FloatArray) -> FloatArray:
        """(n, d) points as the component sees them: it is standard normal about the origin."""
        result: FloatArray = (points_mm - self.means_mm[component]) @ self.factors_per_mm[
            component
        ].T
        return result

    def log_density(self, points_mm: FloatArray) -> FloatArray:
        """(n,) natural logarithm of the density at (n, d) points, per mm^d."""
        parts = np.empty((self.components, len(points_mm)))
        with np.errstate(divide="ignore"):  # a weight of zero is a mixture's right
            log_weights = np.log(self.weights)
        for k, factor in enumerate(self.factors_per_mm):
            square = np.square(self.whitened(k, points_mm)).sum(axis=1)
            parts[k] = log_weights[k] + np.log(np.diag(factor)).sum() - 0.5 * square
        largest = parts.max(axis=0)
        result: FloatArray = largest + np.log(np.exp(parts - largest).sum(axis=0))
        return result - 0.5 * self.dimensions * log(2.0 * pi)

    def placed(self, uniform: FloatArray, normal: FloatArray) -> FloatArray:
        """(n, d) samples made of given draws, so that several mixtures can share them.

        uniform: (n,) in [0, 1), chooses the component. normal: (n, d) standard normal.
        """
        which = self.chosen(uniform)
        samples = np.empty_like(normal)
        for k, factor in enumerate(self.factors_per_mm):
            mine = which == k
            samples[mine] = self.means_mm[k] + np.linalg.solve(factor, normal[mine].T).T
        return samples

    def chosen(self, uniform: FloatArray) -> IndexArray:
        """(n,) component that each of (n,) draws from [0, 1) falls to."""
        edges = np.cumsum(self.weights)[:-1]
        return np.searchsorted(edges, uniform, side="right").astype(np.int64)

    def sample(self, count: int, random: Generator) -> FloatArray:
        """(count, d) points."""
        uniform = random.random(count)
        return self.placed(uniform, random.standard_normal((count, self.dimensions)))


def _check_shapes(weights: FloatArray, means: FloatArray, factors: FloatArray) -> None:
    if weights.ndim != 1 or not 1 <= weights.size <= MOST_COMPONENTS:
        raise MixtureError(f"weights: a list of 1 to {MOST_COMPONENTS} numbers, one per component")
    if means.ndim != 2 or len(means) != weights.size:
        raise MixtureError(f"means: {weights.size} rows, one per weight; they are {means.shape}")
    wanted = (weights.size, means.shape[1], means.shape[1])
    if factors.shape != wanted:
        raise MixtureError(f"factors: must be {wanted}, as the means are; they are {factors.shape}")


def _check_values(weights: FloatArray, means: FloatArray, factors: FloatArray) -> None:
    for name, part in (("weights", weights), ("means", means), ("factors", factors)):
        if not np.isfinite(part).all():
            place = tuple(int(i) for i in np.argwhere(~np.isfinite(part))[0])
            raise MixtureError(f"{name}: the number at {place} is not finite")
    if not (weights >= 0.0).all() or not abs(weights.sum() - 1.0) <= _SUM_TOLERANCE:
        raise MixtureError(f"weights: none below zero, together one; the sum is {weights.sum()}")
    for k, factor in enumerate(factors):
        if np.tril(factor, -1).any():
            raise MixtureError(f"factors: component {k} is not zero below its diagonal")
        if not (np.diag(factor) > 0.0).all():
            raise MixtureError(f"factors: component {k} has a diagonal that is not positive")
