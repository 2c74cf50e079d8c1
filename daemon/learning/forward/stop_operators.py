"""What friction inside a body keeps back: the tip follows less at first where axes turn.

Silicone, fibres and tendons in their channels all drag. Whichever way a body has gone, a part of
the axes' force is held by what has not slipped yet, and is given back when the body turns. Stop
operators tell how much (Prandtl 1928; Visintin 1994, Differential Models of Hysteresis, III): one
of reach r follows a way and stays at ±r where that goes on. A body whose axes are at u, in shares
of their travel, is where one without friction would be with its axes at v, when

    v + h w(v) S = u

with S, for each axis, the mean of several stops. Three things make this a body's friction, and not
an axis':

- The stops follow v, where the body went, and not u, what its axes were told: of a motion that
  turns 1 / (1 + h w) shows.
- They follow (1 - e) v + e v̄ with v̄ the mean of all axes: chambers lie side by side in one body,
  and what stretches all of it drags more than what bends it.
- w(v) = exp(-β (v - ½)): gas that is pressed together is a stiffer spring, so the same friction
  holds back less of an axis' way.

So a body that goes on moves its tip as if there were no friction, and one that has just turned
by a third or half less. A model that knows nothing of this is too weak on a way without turns, by a
tenth to a third, and too strong where a path begins to turn.
"""

from typing import Final, NamedTuple

import numpy as np

from daemon.learning.forward import stop_operator_kernels as kernels
from drivers.pose import Vector

_REACHES: Final = 0.17 * np.array([0.25, 0.5, 0.75, 1.0])
"""(n,) of the stops, in shares of an axis' travel ..."""
_TOGETHER: Final = 0.45
"""... e, and ..."""
_STIFFENING: Final = 1.6
"""... β, as they explain an emulated soft arm's friction best. Along a slow one's rectangle, on
which friction takes 7.4 mm from or adds it to what the tip goes in a second, they leave 1.1 mm
unexplained in the first cycle and 0.6 in the next ones. Stops of each axis alone, which follow what
it is told, left 4.1 and 2.5. Explorations foretell as much with these as with those."""


class HeldBack(NamedTuple):
    """What a body holds back where its axes turn."""

    share: float | None
    """h; None: nobody knows."""
    lowest: Vector
    """(m,) mm or rad: where the axes' travel begins ..."""
    travel: Vector
    """(m,) ... and how long it is."""


class StopOperators:
    """Of m axes, in shares of their travel, for each of k shares h. They rest where they are seen
    first."""

    def __init__(self, shares: Vector) -> None:
        """shares: (k,)"""
        self._shares = shares
        self._free: Vector | None = None
        """(k, m)"""
        self._stops = np.zeros(0)
        """(k, n, m)"""

    def follow(self, u: Vector) -> Vector:
        """(k, m) v with axes at (m,)."""
        if self._free is None:
            self._free = np.tile(u, (len(self._shares), 1))
            self._stops = np.zeros((len(self._shares), len(_REACHES), len(u)))
        settings = self._shares, _REACHES, _TOGETHER, _STIFFENING
        kernels.follow_by_share(self._free, self._stops, u, *settings)
        return self._free.copy()

    def needed(self, forth: Vector, number: int) -> Vector:
        """(m, m) motion of the axes that each next one of v takes, by the share of that number.

        forth: (m,) how surely the stretches go up by it, 0 to 1.
        """
        if self._free is None:
            return np.eye(len(forth))
        free, stops, share = self._free[number], self._stops[number], self._shares[number]
        return kernels.needed(free, stops, forth, share, _REACHES, _TOGETHER, _STIFFENING)


def stretched(moved: Vector) -> Vector:
    """(m,) what the stops follow of a motion (m,)."""
    mean = np.add.reduce(moved) / len(moved)  # `mean` takes five times as long
    return np.asarray((1.0 - _TOGETHER) * moved + _TOGETHER * mean)


def free_places(u: Vector, share: float) -> Vector:
    """(n, m) v of axes that go from one of (n, m) places to the next, in shares of their travel."""
    return kernels.walk(u, share, _REACHES, _TOGETHER, _STIFFENING)


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: seconds once, then tenths of one."""
    stops, axes = StopOperators(np.array([0.0, 1.0])), np.full(3, 0.5)
    stops.follow(axes)
    stops.needed(axes, 1)
    free_places(np.array([axes, axes]), 0.5)
