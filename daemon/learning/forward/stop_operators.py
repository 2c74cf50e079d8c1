"""What axes that turn round keep back: friction inside a body lets the tip follow less at first.

Silicone, fibres and tendons in their channels all drag. Whichever way an axis has gone, a part of
it is held by what has not slipped yet, and is given back when the axis turns. Stop operators tell
how much (Prandtl 1928; Visintin 1994, Differential Models of Hysteresis, III): one of reach r
follows an axis and stays at ±r where that goes on. With S, the mean of several, a body is where one
without friction would be with its axes at

    v = u - h S(u)

So an axis that goes on moves the tip as if there were no friction, and one that has just turned
round by a share h less. A model that knows nothing of this is too weak on a way without turns, by a
tenth to a third, and too strong where a path begins to turn.
"""

from typing import Final, NamedTuple

import numpy as np

from drivers.pose import Vector

_REACHES: Final = np.array([0.05, 0.1, 0.2, 0.4])[:, None]
"""(s, 1) of the stops, in shares of an axis' travel: the first slips soon after a turn, the last
hardly on a path. Of a soft arm's motions that no cubic was learnt from, these four leave 27.65 %
unexplained, one of 0.05, 0.1 or 0.2 alone 28.2, 28.0 and 27.9, none 29.0."""
_SLIPS: Final = 1e-3
"""So near to its end a stop is there."""


class HeldBack(NamedTuple):
    """What a body holds back where its axes turn."""

    share: float | None
    """h; None: nobody knows."""
    travel: Vector
    """(m,) mm or rad, of which the reaches are shares."""


class StopOperators:
    """Of m axes, in shares of their travel. They rest where they are seen first."""

    def __init__(self) -> None:
        self._u: Vector | None = None
        self._stops = np.zeros(0)

    def follow(self, u: Vector) -> Vector:
        """(m,) S with axes at (m,)."""
        if self._u is None:
            self._u, self._stops = u, np.zeros((len(_REACHES), len(u)))
        _slip(self._stops, u - self._u, self._stops)
        self._u = u
        return np.asarray(self._stops.sum(axis=0) / len(_REACHES))

    def sticking(self, forth: Vector) -> Vector:
        """(m,) how much S will change with the next motion of each axis, as a share of that.

        forth: (m,) how surely it is one to higher places, 0 to 1.
        """
        up = (self._stops < _REACHES - _SLIPS).sum(axis=0) / len(_REACHES)
        down = (self._stops > _SLIPS - _REACHES).sum(axis=0) / len(_REACHES)
        return np.asarray(forth * up + (1.0 - forth) * down)


def sticking_of(u: Vector, delta_u: Vector) -> Vector:
    """(n, m) changes of S in n motions, one after the other. u, delta_u: (n, m) where each begins
    and how far it goes, in shares of the travel."""
    places = np.stack([u, u + delta_u], axis=1).reshape(-1, u.shape[1])
    ways = np.diff(places, axis=0, prepend=places[:1])
    stops = np.zeros((len(ways), len(_REACHES), u.shape[1]))
    for before, now, way in zip(stops[:-1], stops[1:], ways[1:], strict=True):
        _slip(before, way, now)
    held = stops.sum(axis=1) / len(_REACHES)
    return np.asarray(held[1::2] - held[::2])


def _slip(stops: Vector, way: Vector, after: Vector) -> None:
    """(s, m) stops `after` the axes' (m,) way."""
    np.add(stops, way, out=after)
    np.maximum(after, -_REACHES, out=after)
    np.minimum(after, _REACHES, out=after)
