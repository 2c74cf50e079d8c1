"""Finds the few coefficients that say what shape a body has: principal modes of its centrelines."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.mixture import FloatArray
from safety.risk.shape_basis import ShapeBasis

SPREAD_MM: Final = 10.0
"""Standard deviation of every coefficient. Modes are as large as that makes them: then a network
over coefficients sees all of them as equally wide."""
_LEFT_OUT: Final = 0.999
"""Of the shapes that come to lie within the basis' radius."""


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """A basis, and the coefficients of what it was made of."""

    basis: ShapeBasis
    coefficients_mm: FloatArray
    """(N, d)."""
    left_out_mm: FloatArray
    """(nodes,) by how much the body's radius was enlarged."""


def fit_shapes(centrelines_mm: NDArray[Any], radius_mm: float, coefficients: int) -> ShapeFit:
    """Of (N, nodes, 3) centrelines from base to tip. Raises ValueError where they are too few.

    Each node's radius is larger than the body's by what the modes leave out of all but a thousandth
    of the shapes, and by what a curved body stands out from the straight line between two nodes.
    """
    lines = np.asarray(centrelines_mm, np.float64)
    count, nodes = lines.shape[:2]
    if not 1 <= coefficients <= min(count - 1, 3 * nodes):
        raise ValueError(f"{count} shapes of {nodes} nodes do not make {coefficients} coefficients")
    base = lines.mean(axis=0)
    away = (lines - base).reshape(count, -1)
    values, vectors = np.linalg.eigh(away.T @ away / count)
    modes = vectors[:, ::-1][:, :coefficients].T
    spread = np.sqrt(np.maximum(values[::-1][:coefficients], 0.0))
    if not spread[-1] > 0.0:
        raise ValueError(f"these shapes have less than {coefficients} coefficients")
    found = away @ modes.T * (SPREAD_MM / spread)
    modes = (modes * (spread / SPREAD_MM)[:, None]).reshape(coefficients, nodes, 3)
    again = base + np.tensordot(found, modes, axes=1)
    missed = np.quantile(np.linalg.norm(lines - again, axis=2), _LEFT_OUT, axis=0)
    left_out = missed + _standing_out(lines)
    arc = np.linalg.norm(np.diff(lines, axis=1), axis=2).mean(axis=0)
    basis = ShapeBasis.checked(
        base,
        modes,
        np.full(nodes, radius_mm),
        left_out,
        np.concatenate([[0.0], np.cumsum(arc)]),
    )
    return ShapeFit(basis, found, left_out)


def coefficients_of(basis: ShapeBasis, centrelines_mm: NDArray[Any]) -> FloatArray:
    """(N, d) that fit (N, nodes, 3) centrelines best."""
    away = np.asarray(centrelines_mm, np.float64) - basis.base_mm
    modes = basis.modes.reshape(basis.coefficients, -1).astype(np.float64)
    found, *_ = np.linalg.lstsq(modes.T, away.reshape(len(away), -1).T, rcond=None)
    return np.asarray(found.T, np.float64)


def _standing_out(lines: FloatArray) -> FloatArray:
    """(nodes,) mm, of an arc over its chord.

    Where two pieces of length a meet at an angle α, the arc over each has a height of aα/8.
    """
    pieces = np.diff(lines, axis=1)
    if pieces.shape[1] < 2:
        return np.zeros(lines.shape[1])
    lengths = np.linalg.norm(pieces, axis=2)
    cosines = np.einsum("npi,npi->np", pieces[:, 1:], pieces[:, :-1])
    angles = np.arccos(np.clip(cosines / (lengths[:, 1:] * lengths[:, :-1]), -1.0, 1.0))
    heights = np.quantile(lengths[:, 1:] * angles / 8.0, _LEFT_OUT, axis=0)
    return np.pad(heights, 1, mode="edge")
