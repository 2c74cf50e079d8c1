"""A sparse online Gaussian process of what motions of the axes do to the tip.

Where the tip is, f(u), is taken for a Gaussian process whose slope has a constant part and one that
changes over a length ℓ. A motion d at x is then seen as the derivative of f along d, and two
motions have the covariance

    k = c² d·d' + v² (d·d' − (d·r)(d'·r)) exp(−r·r / 2),    r = (x − x') / ℓ

(derivative observations; Solak et al., NIPS 15, 2003): a load that moves the tip without the axes
changes nothing that is learnt, and the Jacobian is the process itself, for motions along each axis.
It is kept to a budget of inducing motions, is corrected by one motion at a time, and forgets back
to what it began with: sparse online Gaussian processes (Csató and Opper, Neural Computation 14,
2002) in the form of the recursive least-squares tracker (Van Vaerenbergh, Lázaro-Gredilla and
Santamaría, IEEE Trans. Neural Networks and Learning Systems 23, 2012).
"""

from collections.abc import Mapping
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from drivers.pose import Vector

_NOTHING_NEW: Final = 1e-3
"""Of a motion's own variance, that the inducing ones leave: below, it is none of them."""
_JITTER: Final = 1e-6
"""Of its own variance, that each inducing motion has for itself."""
_RENEWED_AFTER: Final = 32
"""Changes of the inducing motions, after which rounding is taken out of their inverse, by a step of
Newton's."""
_TRIED_ON: Final = 240
"""Motions, evenly from all, by which settings are found."""
_LENGTHS: Final = (0.25, 0.5, 1.0, 2.0)
_CHANGES: Final = (0.1, 0.2, 0.4, 0.8)
"""v as shares of c."""
_NOISES: Final = (0.125, 0.25, 0.5, 1.0)
"""As shares of what a constant Jacobian leaves unexplained."""


class Covariance(NamedTuple):
    """Between motions of axes that count in shares of their range."""

    constant_mm: float
    """c: standard deviation of an element of the Jacobian, mm by range, that is the same all over.
    """
    changing_mm: float
    """v: of what changes from place to place ..."""
    length: float
    """ℓ: ... over so many ranges."""

    def of(self, x: Vector, d: Vector, places: Vector, moves: Vector) -> Vector:
        """(n,) with (n, m) others, of one motion (m,) at (m,)."""
        r = (places - x) / self.length
        near = self.changing_mm**2 * np.exp(-0.5 * np.einsum("nm,nm->n", r, r))
        along = moves @ d
        return np.asarray(self.constant_mm**2 * along + near * (along - (r @ d) * _rows(moves, r)))

    def by_axis(self, x: Vector, places: Vector, moves: Vector) -> Vector:
        """(n, m) as `of`, with a motion by one range of each axis."""
        r = (places - x) / self.length
        near = self.changing_mm**2 * np.exp(-0.5 * np.einsum("nm,nm->n", r, r))
        turned = moves - _rows(moves, r)[:, None] * r
        return np.asarray(self.constant_mm**2 * moves + near[:, None] * turned)

    def own(self, d: Vector) -> float:
        """Of a motion with itself."""
        return (self.constant_mm**2 + self.changing_mm**2) * float(d @ d)

    def among(self, places: Vector, moves: Vector) -> Vector:
        """(n, n) of all with all."""
        rows = [self.of(x, d, places, moves) for x, d in zip(places, moves, strict=True)]
        return np.array(rows).reshape(len(moves), len(moves))


def _rows(one: Vector, other: Vector) -> Vector:
    """(n,) products of the rows of two (n, m)."""
    return np.asarray(np.einsum("nm,nm->n", one, other))


class MotionProcess:
    """Takes motions one by one; tells the Jacobian at any place."""

    def __init__(self, covariance: Covariance, budget: int, memory: float, axes: int) -> None:
        """budget: of inducing motions. memory: in motions; infinite: nothing is forgotten."""
        self.covariance = covariance
        self._budget = budget
        self._kept = 1.0 - 1.0 / memory
        self._axes = axes
        self._places = self._moves = np.zeros((0, axes))
        self._prior = self._inverse = self._spread = np.zeros((0, 0))
        """K of the inducing motions, its inverse, and how uncertain what they do is by now."""
        self._mean = np.zeros((0, 3))
        """What they do, mm."""
        self._weights = np.zeros((0, 3))
        self._changes = 0

    @property
    def count(self) -> int:
        """Inducing motions."""
        return len(self._moves)

    def jacobian(self, x: Vector) -> Vector:
        """(3, m) mm by range at (m,)."""
        if not self.count:
            return np.zeros((3, self._axes))
        by_axis = self.covariance.by_axis(x, self._places, self._moves)
        return np.asarray((by_axis.T @ self._weights).T)

    def unknown(self, x: Vector) -> float:
        """How much of the Jacobian's variance is left at (m,), 1: all of it."""
        if not self.count:
            return 1.0
        by_axis = self.covariance.by_axis(x, self._places, self._moves)
        solved = self._inverse @ by_axis
        told = np.einsum("nm,nm->", by_axis, solved)
        left = np.einsum("nm,nm->", solved, self._spread @ solved)
        whole = self._axes * self.covariance.own(np.eye(self._axes)[0])
        return float(min(max(1.0 - (told - left) / whole, 0.0), 1.0))

    def add(self, x: Vector, d: Vector, tip_moved: Vector, noise_mm: float) -> None:
        """(m,) d at (m,) was seen to do (3,) mm, each with this noise. One that is nothing, or no
        number, is left out."""
        own = self.covariance.own(d)
        if not (own > 0.0 and np.isfinite(x).all() and np.isfinite(tip_moved).all()):
            return
        self._forget()
        with_others = self.covariance.of(x, d, self._places, self._moves)
        shares = self._inverse @ with_others
        left = max((1.0 + _JITTER) * own - float(with_others @ shares), _JITTER * own)
        spread = self._spread @ shares
        variance = left + float(shares @ spread)
        missing = tip_moved - shares @ self._mean
        if left > _NOTHING_NEW * own:
            self._grow(x, d, with_others, shares, left)
            self._spread = _bordered(self._spread, spread, variance)
            self._mean = np.concatenate([self._mean, (tip_moved - missing)[None]])
            spread = np.append(spread, variance)
        gain = spread / (variance + noise_mm**2)
        self._mean = self._mean + np.outer(gain, missing)
        self._spread = self._spread - np.outer(gain, spread)
        if self.count > self._budget:
            self._drop_one()
        if self._changes >= _RENEWED_AFTER:
            self._inverse = 2.0 * self._inverse - self._inverse @ self._prior @ self._inverse
            self._spread = 0.5 * (self._spread + self._spread.T)
            self._changes = 0
        self._weights = self._inverse @ self._mean

    def to_arrays(self) -> dict[str, Vector]:
        """For a file. From here on this goes on as what is made of them does."""
        self._renew()
        self._weights = self._inverse @ self._mean
        return {
            "places": self._places,
            "moves": self._moves,
            "mean": self._mean,
            "spread": self._spread,
        }

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, and ValueError for arrays that do not fit."""
        places, moves, mean, spread = (
            np.array(arrays[name]) for name in ("places", "moves", "mean", "spread")
        )
        n = len(moves)
        shapes = [one.shape for one in (places, moves, mean, spread)]
        if shapes != [(n, self._axes), (n, self._axes), (n, 3), (n, n)] or n > self._budget:
            raise ValueError(f"these are no {n} inducing motions of {self._axes} axes")
        self._places, self._moves, self._mean, self._spread = places, moves, mean, spread
        self._renew()
        self._weights = self._inverse @ self._mean

    def _forget(self) -> None:
        """Back to the prior, a little."""
        if self._kept < 1.0:
            self._spread = self._kept * self._spread + (1.0 - self._kept) * self._prior
            self._mean = np.sqrt(self._kept) * self._mean

    def _grow(self, x: Vector, d: Vector, others: Vector, shares: Vector, left: float) -> None:
        self._prior = _bordered(self._prior, others, (1.0 + _JITTER) * self.covariance.own(d))
        column = np.append(shares, -1.0)
        self._inverse = _bordered(self._inverse, np.zeros(len(shares)), 0.0)
        self._inverse = self._inverse + np.outer(column, column) / left
        self._places = np.concatenate([self._places, x[None]])
        self._moves = np.concatenate([self._moves, d[None]])
        self._changes += 1

    def _drop_one(self) -> None:
        """The one whose loss changes least of what is foretold."""
        errors = ((self._inverse @ self._mean) ** 2).sum(axis=1) / self._inverse.diagonal()
        lost = int(np.argmin(errors))
        kept = np.arange(self.count) != lost
        column = self._inverse[kept, lost]
        reduced = self._inverse[np.ix_(kept, kept)]
        self._inverse = reduced - np.outer(column, column) / self._inverse[lost, lost]
        self._places, self._moves, self._mean = (
            one[kept] for one in (self._places, self._moves, self._mean)
        )
        self._prior = self._prior[np.ix_(kept, kept)]
        self._spread = self._spread[np.ix_(kept, kept)]
        self._changes += 1

    def _renew(self) -> None:
        self._prior = self.covariance.among(self._places, self._moves)
        own = self._prior.diagonal() * (1.0 + _JITTER)
        np.fill_diagonal(self._prior, own)
        self._inverse = np.asarray(np.linalg.inv(self._prior), np.float64)
        self._changes = 0


def _bordered(matrix: Vector, column: Vector, corner: float) -> Vector:
    """(n + 1, n + 1) of a symmetric (n, n)."""
    n = len(column)
    grown = np.empty((n + 1, n + 1))
    grown[:n, :n] = matrix
    grown[:n, n] = grown[n, :n] = column
    grown[n, n] = corner
    return grown


def most_likely(places: Vector, moves: Vector, tip_moved: Vector) -> tuple[Covariance, float]:
    """What makes these motions, (n, m), (n, m) and (n, 3) mm, most likely, and the noise in mm."""
    kept = slice(None, None, 1 + (len(moves) - 1) // _TRIED_ON)
    places, moves, tip_moved = places[kept], moves[kept], tip_moved[kept]
    ridge = 1e-6 * float(_rows(moves, moves).mean()) * np.eye(moves.shape[1])
    constant = np.linalg.solve(moves.T @ moves + ridge, moves.T @ tip_moved)
    c = max(float(np.sqrt((constant**2).mean())), 1e-3)
    left_mm = max(float(np.sqrt(((tip_moved - moves @ constant) ** 2).mean())), 1e-3)
    best, found = -np.inf, (Covariance(c, _CHANGES[1] * c, _LENGTHS[2]), left_mm)
    for length, change in product(_LENGTHS, _CHANGES):
        covariance = Covariance(c, change * c, length)
        gram = covariance.among(places, moves)
        values, vectors = np.linalg.eigh(gram)
        along = (vectors.T @ tip_moved) ** 2
        for share in _NOISES:
            spread = np.maximum(values, 0.0) + (share * left_mm) ** 2
            likely = -1.5 * float(np.log(spread).sum()) - 0.5 * float(
                (along / spread[:, None]).sum()
            )
            if likely > best:
                best, found = likely, (covariance, share * left_mm)
    return found
