"""The risk of all that is left of a planned path: one body per draw, from here to its end.

The path is looked at piece by piece, each in the time of one question of the gate: all of it before
it is gone, and again, piece after piece, while it is, with what the tip tells by then. Which draws
touch on each piece is kept; what is left of the path is touched by whoever touches on any of its
pieces. So the answer does not grow with the number of places in the path's file.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from safety.risk.body_risk import BodyRisk
from safety.risk.contact_figures import upper_limit
from safety.risk.model.mixture import FloatArray

_PIECE: Final = 0.1
"""Of the network's inputs: places of the file that are nearer to each other are one piece, ..."""
_STRAIGHT: Final = 0.002
"""... if those between them are so near to its line: of a body's whole spread, hundredths of mm."""


class PathAhead:
    """Of one path. Not for several threads."""

    def __init__(self, risk: BodyRisk, t_s: Sequence[float], u: Sequence[Sequence[float]]) -> None:
        """risk: for this path alone, since it remembers what it was asked. t_s (n,), u (n, m)."""
        self._risk = risk
        places = np.asarray(u, np.float64)
        kept = _kept(places * risk.model.scale)
        self._u, self._t_s = places[kept].tolist(), np.asarray(t_s, np.float64)[kept]
        self._touching = np.ones((risk.samples, len(self._u) - 1), np.bool_)
        """Which draws touch on each piece, the last one first: from there they are looked through.
        """
        self._next = 0
        self._latest = np.full(risk.samples, len(self._u) - 2)
        """Of each draw, the last piece on which it touches; -1: it does nowhere."""

    @property
    def pieces(self) -> int:
        """How many there are to look at."""
        return len(self._u) - 1

    def look(self, seeing: BodyRisk | None = None) -> None:
        """At the next piece, and after the last one at the first one again. seeing: who has seen
        the body's tip; None: the model alone is asked."""
        if seeing is not None:
            self._risk.see_as(seeing.sight)
        piece = self._next
        found = self._risk.of_way(self._u[piece], self._u[piece + 1])
        touching = self._touching[:, self.pieces - 1 - piece]
        touching[:] = True if isinstance(found, str) else found.touching
        self._next = (piece + 1) % self.pieces
        self._latest[touching & (self._latest < piece)] = piece
        # Of the others, only those are looked through that touched here last: of a long path, to
        # look through all takes longer than a control step may.
        free = np.flatnonzero(~touching & (self._latest == piece))
        self._latest[free] = -1
        if piece > 0:
            before = self._touching[free, self.pieces - piece :]
            last = np.where(before.any(axis=1), piece - 1 - before.argmax(axis=1), -1)
            self._latest[free] = last

    def left(self, elapsed_s: float) -> float:
        """Of what is left of it after so long, upper limit as that of a step. What was not looked
        at counts as touched."""
        here = int(np.searchsorted(self._t_s, elapsed_s, side="right")) - 1
        return upper_limit(int(np.count_nonzero(self._latest >= here)), self._risk.samples)

    def worst(self) -> str:
        """Where on it most bodies touch, in words."""
        piece = self.pieces - 1 - int(self._touching.sum(axis=0).argmax())
        found = self._risk.of_way(self._u[piece], self._u[piece + 1])
        at = f"at {float(self._t_s[piece]):.1f} s"
        if isinstance(found, str):
            return f"{at}, {found}"
        where = found.contact.worst
        x, y, z = where.nearest_mm.tolist()
        return (
            f"{at}, {where.arc_mm:.0f} mm along the body, nearest to ({x:.0f}, {y:.0f}, {z:.0f}) mm"
        )


def _kept(features: FloatArray) -> list[int]:
    """Which of (n, f) places are the ends of pieces, at least two: the others are as good as on a
    straight line between them."""
    kept = [0]
    for place in range(1, len(features) - 1):
        begin, end = features[kept[-1]], features[place + 1]
        way = end - begin
        length = float(np.linalg.norm(way))
        between = features[kept[-1] + 1 : place + 1] - begin
        along = np.clip(between @ way / max(length**2, _STRAIGHT**2), 0.0, 1.0)
        aside = float(np.linalg.norm(between - along[:, None] * way, axis=1).max())
        if length > _PIECE or aside > _STRAIGHT:
            kept.append(place)
    return [*kept, len(features) - 1]
