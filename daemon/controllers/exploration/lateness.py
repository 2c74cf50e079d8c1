"""How late the tip comes after the axes, as the first motions of an unknown body show it.

An exploration has no model. But over a short span the tip's motion is a linear function of the
axes' motion some time before, whatever the function is: for several delays at once it is fitted by
least squares, old spans being forgotten as the body bends on. The delay that explains most is about
the sum of the body's dead time and lag.
"""

from collections import deque
from math import exp
from typing import Final

import numpy as np

from drivers.pose import Vector

_DELAYS_S: Final = np.arange(0.0, 1.6, 0.15)
_SPAN_S: Final = 0.3
_KEPT_S: Final = float(_DELAYS_S[-1]) + 2.0 * _SPAN_S
_MEMORY_S: Final = 10.0
"""Some two lines between places: one alone is explained by any delay, as a way that bends."""
_SEEN_AT_LEAST_S: Final = 2.0
_RIDGE: Final = 1e-4
"""Of the travel, squared: what axes have to move for anything to be told by it."""
_CLEARLY: Final = 0.7
"""Share of what a shorter delay leaves unexplained that a longer one may leave, to be believed. A
slow arm, 0.75 s late, is then told to be 0.45 to 0.9 s late from its second line on, and a prompt
one not more than 0.15 s, but for a second or two of its first lines."""
_HELD_S: Final = 5.0
"""Time constant of forgetting a longer delay, where a bend of the way hides it for a while."""


class Lateness:
    """Takes axes and tip that belong together, step by step. Before the first all stood still."""

    def __init__(self, travel: Vector) -> None:
        """travel: (m,) of the axes."""
        self._travel = travel
        self._kept: deque[tuple[float, Vector, Vector]] = deque()
        axes = len(travel)
        self._squares = np.zeros((len(_DELAYS_S), axes, axes))
        self._products = np.zeros((len(_DELAYS_S), axes, 3))
        self._whole_mm2 = 0.0
        self._seen_s = 0.0
        self.seconds = 0.0
        """The shortest delay that no longer one is clearly better than; 0 until it is known."""

    def add(self, t_s: float, u: Vector, tip_mm: Vector) -> None:
        """At `t_s` the axes are at (m,) and the tip is at (3,)."""
        kept = self._kept
        dt_s = t_s - kept[-1][0] if kept else 0.0
        kept.append((t_s, u / self._travel, tip_mm))
        while kept[0][0] < t_s - _KEPT_S:
            kept.popleft()
        times = np.array([one[0] for one in kept])
        ends, begins = (
            np.searchsorted(times, t_s - _DELAYS_S - back).tolist() for back in (0.0, _SPAN_S)
        )
        told = np.array(
            [kept[end][1] - kept[begin][1] for end, begin in zip(ends, begins, strict=True)]
        )
        came = tip_mm - kept[begins[0]][2]
        forget = exp(-dt_s / _MEMORY_S)
        self._squares = forget * self._squares + told[:, :, None] * told[:, None, :]
        self._products = forget * self._products + told[:, :, None] * came
        self._whole_mm2 = forget * self._whole_mm2 + float(came @ came)
        self._seen_s += dt_s
        if self._seen_s >= _SEEN_AT_LEAST_S:
            self.seconds = max(self._found_s(), exp(-dt_s / _HELD_S) * self.seconds)

    def _found_s(self) -> float:
        ridge = _RIDGE * np.eye(len(self._travel))
        slopes = np.linalg.solve(self._squares + ridge, self._products)
        left = self._whole_mm2 - (slopes * self._products).sum(axis=(1, 2))
        return float(_DELAYS_S[np.argmax(_CLEARLY * left <= left.min())])
