"""A Jacobian identified from an exploration by least squares, local or global, and then fixed.

Round any place of the axes, J is what explains the exploration's motions best, Δp ≈ J Δu, the
nearer ones weighing more (locally weighted regression; Atkeson, Moore and Schaal, Artificial
Intelligence Review 11, 1997), and where few are near, that of all motions. How near is near is
found by leaving motions out. Wide enough, it is the same everywhere: a linear model.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector

_MOST_MOTIONS: Final = 800
"""Evenly from all of them: a step has no time for more."""
_ASKED_ABOUT: Final = 150
"""Motions that are left out and foretold."""
_PARTS: Final = 5
"""Of the exploration's lines, of which all but one foretell those of the one."""
_REACHES: Final = (0.15, 0.25, 0.4, 0.7, 1.2, 1e3)
"""Of the weights, in ranges of the axes; the last one weighs all alike."""
_GLOBAL_COUNTS: Final = 3.0
"""As so many motions near by, per axis, counts what all of them say."""
_COVERED: Final = 3.0
"""Motions per axis from which on a place is known."""


class _Motions(NamedTuple):
    """What was seen of n motions of m axes, in shares of their ranges."""

    places: Vector
    """(n, m) their middles."""
    moved: Vector
    """(n, m)"""
    tip_moved: Vector
    """(n, 3) mm"""

    def of(self, kept: NDArray[np.bool_]) -> "_Motions":
        """Those of them."""
        return _Motions(*(one[kept] for one in self))

    def weights(self, place: Vector, reach: float) -> Vector:
        """(n,) that they have at (m,)."""
        away = self.places - place
        return np.asarray(np.exp(np.einsum("nm,nm->n", away, away) / (-2.0 * reach**2)))

    def fit(self, weights: Vector, otherwise: Vector | None) -> Vector:
        """(3, m) drawn to `otherwise`; None: to nothing."""
        axes = self.moved.shape[1]
        weighted = self.moved * weights[:, None]
        gram = weighted.T @ self.moved
        step = float(np.einsum("nm,nm->", self.moved, self.moved)) / max(self.moved.size, 1)
        drawn = _GLOBAL_COUNTS * axes * step
        if otherwise is None:
            drawn, otherwise = 1e-6 * drawn + 1e-12, np.zeros((3, axes))
        products = weighted.T @ self.tip_moved + drawn * otherwise.T
        return np.asarray(np.linalg.solve(gram + drawn * np.eye(axes), products).T)

    def fit_of_all(self) -> Vector:
        """(3, m) the same everywhere."""
        return self.fit(np.ones(len(self.moved)), None)


def _best_reach(motions: _Motions, parts: NDArray[np.int64]) -> float:
    """Of the weights, by what is foretold of motions of lines that were left out."""
    asked = np.arange(0, len(parts), 1 + (len(parts) - 1) // _ASKED_ABOUT)
    missed = np.zeros(len(_REACHES))
    for part in np.unique(parts):
        others = motions.of(parts != part)
        if not len(others.moved):
            return _REACHES[-1]
        everywhere = others.fit_of_all()
        for row in asked[parts[asked] == part]:
            place, moved, tip_moved = (one[row] for one in motions)
            for k, reach in enumerate(_REACHES):
                jacobian = others.fit(others.weights(place, reach), everywhere)
                missed[k] += float(((tip_moved - jacobian @ moved) ** 2).sum())
    return _REACHES[int(np.argmin(missed))]


class IdentifiedJacobian:
    """A `TipJacobian`. Axes count in shares of their range within."""

    def __init__(self, scale: Vector) -> None:
        """scale: (m,) the axes' ranges."""
        self.forward: Lwpr | None = None
        self.believed = 1.0
        self._scale = scale
        self._everywhere: Vector | None = None
        self._motions: _Motions | None = None
        self._reach = _REACHES[-1]

    @property
    def known(self) -> bool:
        """Whether there is a Jacobian at all."""
        return self._everywhere is not None

    @property
    def modelled(self) -> bool:
        """Whether an exploration tells what a motion should do."""
        return self._motions is not None

    @property
    def contradicted(self) -> bool:
        """Never: it goes on with what it has, as it was published."""
        return False

    @property
    def held_back(self) -> None:
        """It is not known."""

    def begin(self, model: PretrainedModel) -> None:
        """Go by what this exploration says from now on."""
        table = model.motions
        kept = slice(None, None, 1 + (len(table) - 1) // _MOST_MOTIONS)
        moved = table.delta_u[kept] / self._scale
        places = table.u[kept] / self._scale + 0.5 * moved
        motions = _Motions(places, moved, table.delta_tip_mm[kept])
        self._everywhere = motions.fit_of_all()
        self._reach = _best_reach(motions, table.line[kept] % _PARTS)
        self._motions = motions

    def measured(self, jacobian: Vector) -> None:
        """There is no exploration, but this is how the tip answers here: (3, m) per mm or rad."""
        self._everywhere = jacobian * self._scale

    def covered(self, tip_mm: Vector, u: Vector) -> float:
        """How far motions of the exploration tell what the tip does here, 0 to 1."""
        del tip_mm
        if self._motions is None:
            return 0.0
        near = float(self._motions.weights(u / self._scale, self._reach).sum())
        return min(near / (_COVERED * len(self._scale)), 1.0)

    def at(self, tip_mm: Vector, u: Vector) -> Vector:
        """(3, m) mm per mm or rad."""
        del tip_mm
        assert self._everywhere is not None
        if self._motions is None:
            return self._everywhere / self._scale
        weights = self._motions.weights(u / self._scale, self._reach)
        return self._motions.fit(weights, self._everywhere) / self._scale

    def learn(self, sample: MotionSample, gains: Vector) -> None:
        """It is fixed."""

    def body_changed(self) -> None:
        """It is fixed."""

    def to_arrays(self) -> dict[str, Vector]:
        """What the exploration itself does not say."""
        assert self._everywhere is not None
        return {"everywhere": self._everywhere}

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, and ValueError for other axes."""
        everywhere = np.array(arrays["everywhere"])
        if everywhere.shape != (3, len(self._scale)):
            raise ValueError(f"its Jacobian is not for {len(self._scale)} axes")
        self._everywhere = everywhere
