"""A mixture of shapes, given where the tip is measured: Gaussian conditioning of each component.

With prior c ~ N(μ, Σ) and measurement y = H c + e, e ~ N(0, R), each component becomes

    P = Σ⁻¹ + Hᵀ R⁻¹ H,   μ' = μ + P⁻¹ Hᵀ R⁻¹ (y − H μ),   Σ' = P⁻¹,

and its weight is multiplied by the density N(y; H μ, H Σ Hᵀ + R) that it gave to the measurement
(Bishop, Pattern Recognition and Machine Learning, section 2.3.3). The centreline is linear in the
coefficients, and so are the tip's place and, for a body that does not stretch, its direction.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple

import numpy as np

from safety.risk.model.conditioning_kernels import condition
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis

_PLACES_OF_BENDS: Final = 64
"""Along the body, where it may be bent a little: more do not change the covariance."""
_DIRECTION_NODES: Final = 3


class Conditioned(NamedTuple):
    """A mixture after a measurement."""

    mixture: Mixture
    log_density: float
    """Natural logarithm of the density that the mixture gave to the measurement."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearObservation:
    """value = matrix · coefficients + noise, whose entries know nothing of each other."""

    matrix: FloatArray
    """(q, d)."""
    value: FloatArray
    """(q,)."""
    variance: FloatArray
    """(q,) of the noise, above zero."""


def conditioned(
    mixture: Mixture, observation: LinearObservation, beside: FloatArray
) -> Conditioned | None:
    """The mixture given the observation; None where that comes out as no finite numbers.

    beside: (d, d) mm², covariance that is added to that of each component first: what bodies differ
    by that the mixture has not seen.
    """
    weights, means = np.empty_like(mixture.weights), np.empty_like(mixture.means_mm)
    factors = np.empty_like(mixture.factors_per_mm)
    before = mixture.weights, mixture.means_mm, mixture.factors_per_mm
    about = observation.matrix, observation.value, observation.variance
    log_density = float(condition(*before, beside, *about, weights, means, factors))
    if not isfinite(log_density):
        return None
    return Conditioned(Mixture(weights, means, factors), log_density)


def tip_place(basis: ShapeBasis) -> tuple[FloatArray, FloatArray]:
    """(3, d) and (3,): the tip is at matrix · coefficients + offset, mm."""
    modes = basis.modes[:, -1].astype(np.float64)
    return np.ascontiguousarray(modes.T), basis.base_mm[-1].astype(np.float64)


def tip_direction(basis: ShapeBasis) -> tuple[FloatArray, FloatArray]:
    """(3, d) and (3,): the tip points along matrix · coefficients + offset, of about unit length.

    The slope of the parabola through the last three nodes, or of the line through the last two.
    """
    nodes = min(_DIRECTION_NODES, basis.nodes)
    arc = basis.arc_mm[-nodes:] - basis.arc_mm[-1]
    by_node = np.linalg.solve(np.vander(arc, increasing=True).T, np.eye(nodes)[1])
    modes, base = basis.modes[:, -nodes:].astype(np.float64), basis.base_mm[-nodes:]
    matrix = np.ascontiguousarray(np.einsum("n,dnx->xd", by_node, modes))
    return matrix, np.asarray(by_node @ base.astype(np.float64))


def bending_covariance(basis: ShapeBasis) -> FloatArray:
    """(d, d) of a body that is bent a little more or less at every place along it, independently.

    Of a size with which the tip has a variance of 1 mm² in each coordinate, on average. Loads,
    contacts and other bodies of one design do that. The displacement at arc s of one bend at t is
    max(0, s − t); it is told in the coefficients that come nearest to it.
    """
    modes = basis.modes.reshape(basis.coefficients, -1).astype(np.float64)
    nearest = np.linalg.pinv(modes.T)
    begin, end = basis.arc_mm[0], basis.arc_mm[-1]
    covariance = np.zeros((basis.coefficients, basis.coefficients))
    pieces = (np.arange(_PLACES_OF_BENDS) + 0.5) / _PLACES_OF_BENDS
    for place in begin + pieces * (end - begin):
        lever = np.maximum(basis.arc_mm - place, 0.0)
        bends = np.stack([np.outer(lever, axis).ravel() for axis in np.eye(3)])
        moved = nearest @ bends.T
        covariance += moved @ moved.T
    matrix, _ = tip_place(basis)
    of_tip = float(np.trace(matrix @ covariance @ matrix.T)) / 3.0
    return covariance / of_tip
