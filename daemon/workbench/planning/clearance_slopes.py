"""How much clearance a body lacks, smoothly, and how that changes with the axes: for optimisers.

Each component of the mixture has the same draws, weighed by the component's weight. So nothing
jumps when the axes move, neither by other draws (common random numbers) nor by a draw that changes
its component. The slope is exact but for the kinks of the distance grid, and where a body is
nearest between two of its nodes: from the nearest node of each drawn body through its coefficients
and the mixture's factors back through the network.
"""

from typing import Final, NamedTuple

import numpy as np

from safety.risk.contact import ContactModel
from safety.risk.contact_kernels import clearances
from safety.risk.model.mixture import FloatArray, IndexArray, Mixture
from safety.risk.model.risk_model import RiskModel
from safety.risk.shape_kernels import Shapes, in_lanes, place_shapes
from safety.risk.surroundings.distance_grid import DistanceGrid

_MARGIN_MM: Final = 12.0
"""More than other bodies of a design stand away from the one that the model was made of: up to 7 mm
of the soft arm's. With 5 mm its paths were a fifth shorter, and by equation 10 half as likely again
to touch."""
_SOFTNESS_MM: Final = 4.0
_LIGHTEST: Final = 2e-3
"""Components that weigh less are left out."""


class Lack(NamedTuple):
    """Mean over the draws of softplus(margin − clearance), mm, and its slope."""

    mm: float
    by_u: FloatArray
    """(m,) mm per mm or rad."""


class ClearanceLack:
    """Of one body in one environment. Not for several threads."""

    def __init__(
        self,
        model: RiskModel,
        contact: ContactModel,
        grid: DistanceGrid,
        margin_mm: float = _MARGIN_MM,
        softness_mm: float = _SOFTNESS_MM,
        draws: int = 16,
        seed: int = 0,
    ) -> None:
        """contact: whose body and surroundings these are. draws: of each component, even."""
        self._model, self._grid = model, grid
        self._surroundings, self._skin = contact.surroundings, contact.skin
        self._margin_mm, self._softness_mm = margin_mm, softness_mm
        basis = contact.basis
        half = np.random.default_rng(seed).standard_normal((draws // 2, basis.coefficients))
        self._draws = np.concatenate([half, -half])
        self._base = in_lanes(basis.base_mm.ravel())
        self._flat_modes = in_lanes(basis.modes.reshape(basis.coefficients, -1))
        self._modes = basis.modes.astype(np.float64)

    def at(self, u: FloatArray) -> Lack:
        """At (m,) u. Raises ValueError where the model has no number."""
        mixture = self._model.shapes.mixture(u)
        if mixture is None:
            raise ValueError(f"the model gives no finite answer at {u.tolist()}")
        active = np.flatnonzero(mixture.weights > _LIGHTEST)
        shapes = self._shapes(mixture, active)
        off = (self._margin_mm - shapes.clearance.astype(np.float64)) / self._softness_mm
        lacks = self._softness_mm * np.logaddexp(0.0, off)
        by_clearance = -0.5 * (1.0 + np.tanh(0.5 * off))  # −logistic(off), without overflow
        lacks, by_clearance = (part.reshape(active.size, -1) for part in (lacks, by_clearance))
        share = mixture.weights[active] / len(self._draws)
        by_weights = np.zeros_like(mixture.weights)
        by_weights[active] = lacks.mean(axis=1)
        by_means, by_factors = (
            np.zeros_like(mixture.means_mm),
            np.zeros_like(mixture.factors_per_mm),
        )
        slopes = self._by_coefficients(shapes).reshape(active.size, len(self._draws), -1)
        pulled = (share[:, None] * by_clearance)[:, :, None] * slopes
        factors = mixture.factors_per_mm[active]
        offsets = np.linalg.solve(factors, self._draws.T)
        turned = np.linalg.solve(factors.transpose(0, 2, 1), pulled.transpose(0, 2, 1))
        by_means[active] = pulled.sum(axis=1)
        by_factors[active] = -np.triu(turned @ offsets.transpose(0, 2, 1))
        by_u = self._model.shapes.gradient(u, by_weights, by_means, by_factors)
        return Lack(float(share @ lacks.sum(axis=1)), by_u)

    def _shapes(self, mixture: Mixture, active: IndexArray) -> Shapes:
        count = active.size * len(self._draws)
        shapes = Shapes(
            np.empty((count, 3 * len(self._modes[0])), np.float32),
            np.empty(count, np.float32),
            np.empty(count, np.int64),
            np.empty(count, np.float32),
            np.empty(count, np.float32),
        )
        component = np.repeat(np.arange(active.size), len(self._draws))
        means, factors = mixture.means_mm[active], mixture.factors_per_mm[active]
        normal = np.tile(self._draws, (active.size, 1))
        place_shapes(
            means, factors, component, normal, self._base, self._flat_modes, shapes.positions
        )
        clearances(self._surroundings, self._skin, shapes, count)
        return shapes

    def _by_coefficients(self, shapes: Shapes) -> FloatArray:
        """(S, d) of each shape's clearance: that of the place where it is nearest."""
        rows = np.arange(shapes.node.size)
        places = shapes.positions.reshape(shapes.node.size, -1, 3)[rows, shapes.node]
        slopes = distance_at(self._grid, places.astype(np.float64))[1]
        return np.asarray(np.einsum("sc,dsc->sd", slopes, self._modes[:, shapes.node]))


def distance_at(grid: DistanceGrid, places_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) interpolated distances at (n, 3) places, mm, and (n, 3) their slopes.

    Outside the grid, those of its nearest cube.
    """
    values = grid.values_mm
    at = (places_mm - grid.origin_mm) / grid.spacing_mm
    at = np.clip(at, 0.0, np.array(values.shape) - 1.000001)
    low = at.astype(np.int64)
    share = at - low
    i, j, k = low.T
    # (2, 2, 2, n) the corners of each cube, folded along one axis after the other.
    cube = np.array(
        [[[values[i + a, j + b, k + c] for c in (0, 1)] for b in (0, 1)] for a in (0, 1)],
        np.float64,
    )
    u, v, w = share.T
    flat = cube[:, :, 0] + w * (cube[:, :, 1] - cube[:, :, 0])
    rise = cube[:, :, 1] - cube[:, :, 0]
    line = flat[:, 0] + v * (flat[:, 1] - flat[:, 0])
    slopes = [
        line[1] - line[0],
        _folded(flat[:, 1] - flat[:, 0], u),
        _folded(rise[:, 0] + v * (rise[:, 1] - rise[:, 0]), u),
    ]
    return _folded(line, u), np.stack(slopes, axis=1) / grid.spacing_mm


def _folded(ends: FloatArray, share: FloatArray) -> FloatArray:
    return np.asarray(ends[0] + share * (ends[1] - ends[0]))
