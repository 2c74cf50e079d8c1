"""Finds the few coefficients that say what shape a body has: principal modes of its centrelines."""

from dataclasses import dataclass
from math import log, sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray
from safety.risk.model.shape_basis import ShapeBasis

_LEAST_APART: Final = 0.01
"""Of a coefficient's whole spread. What spreads less in a group is taken to spread so much."""
_LEFT_OUT: Final = 0.999
"""Of the shapes that come to lie within the basis' radius."""

_MOST_OFF: Final = sqrt(log(20.0))
"""Times the root mean square: of what is off both ways alike (Rayleigh's distribution), one in
twenty is off by more."""


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """A basis, and the coefficients of what it was made of."""

    basis: ShapeBasis
    coefficients_mm: FloatArray
    """(n, s, d)."""
    left_out_mm: FloatArray
    """(nodes,) by how much the body's radius was enlarged."""


def fit_shapes(
    centrelines_mm: NDArray[Any],
    radius_mm: float,
    coefficients: int,
    fit_error_mm: FloatArray | None = None,
) -> ShapeFit:
    """Of (n, s, nodes, 3) centrelines from base to tip. Raises ValueError where they are too few.

    The s of a group are what comes of one actuation vector. Coefficients are such that within the
    groups each spreads by 1 mm, and none with another; over all groups they are principal ones, the
    widest first. A network that learns them has misses of equal size in all of them.
    Each node's radius is larger than the body's by what the modes leave out of all but a thousandth
    of the shapes, by what a curved body stands out from the straight line between two nodes, and by
    what the centrelines themselves are off by, nineteen times of twenty.

    fit_error_mm: (nodes,) root mean squares of that; None: they are exact.
    """
    lines = np.asarray(centrelines_mm, np.float64)
    groups, of_each, nodes = lines.shape[:3]
    lines = lines.reshape(-1, nodes, 3)
    count = len(lines)
    if not 1 <= coefficients <= min(count - 1, 3 * nodes):
        raise ValueError(f"{count} shapes of {nodes} nodes do not make {coefficients} coefficients")
    base = lines.mean(axis=0)
    away = (lines - base).reshape(count, -1)
    values, vectors = np.linalg.eigh(away.T @ away / count)
    principal = vectors[:, ::-1][:, :coefficients]
    spread = np.sqrt(np.maximum(values[::-1][:coefficients], 0.0))
    if not spread[-1] > 0.0:
        raise ValueError(f"these shapes have less than {coefficients} coefficients")
    even = away @ principal / spread
    turned = _evenly_spread(even.reshape(groups, of_each, coefficients))
    found = even @ turned
    modes = (np.linalg.inv(turned) @ (principal * spread).T).reshape(coefficients, nodes, 3)
    again = base + np.tensordot(found, modes, axes=1)
    missed = np.quantile(np.linalg.norm(lines - again, axis=2), _LEFT_OUT, axis=0)
    left_out = missed + _standing_out(lines)
    if fit_error_mm is not None:
        left_out = left_out + _MOST_OFF * fit_error_mm
    arc = np.linalg.norm(np.diff(lines, axis=1), axis=2).mean(axis=0)
    basis = ShapeBasis.checked(
        base,
        modes,
        np.full(nodes, radius_mm),
        left_out,
        np.concatenate([[0.0], np.cumsum(arc)]),
    )
    return ShapeFit(basis, found.reshape(groups, of_each, coefficients), left_out)


def _evenly_spread(even: FloatArray) -> FloatArray:
    """(d, d) of (n, s, d) coefficients that spread by 1 over all: what makes the others of them."""
    n, s, d = even.shape
    apart = (even - even.mean(axis=1, keepdims=True)).reshape(-1, d)
    within = apart.T @ apart / max(1, n * (s - 1)) + _LEAST_APART**2 * np.eye(d)
    values, vectors = np.linalg.eigh(within)
    turned: FloatArray = vectors / np.sqrt(values)
    return turned


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
