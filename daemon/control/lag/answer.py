"""How the tip answers here and now: what it goes for what it is told, along and aside.

A Jacobian that is a little wrong, a hysteresis that turns and a load that makes the body softer let
the tip go further than told, or aside. A body that answers late shows it only when it is too late;
so what is under way counts with what it will come to, by what the last tenths of a second showed.
Motions s of the tip over a short span are held against those x of the told motion that arrived in
it: the matrix that explains them best, close to the identity where they tell nothing,

    M = (Σ s xᵀ + λ I) (Σ x xᵀ + λ I)⁻¹

with old ones forgotten: least squares with a prior. A prediction of some tenths of a second by a
line through what the tip was off lately would know less: the path turns meanwhile, and what it is
off by turns with it.
"""

from bisect import bisect_left
from collections import deque
from math import exp
from operator import itemgetter
from typing import Final

import numpy as np

from drivers.pose import Vector

_SPAN_S: Final = 0.2
"""Of the motions that are compared: longer than the tracker's noise, shorter than a turn."""
ON_A_PATH_S: Final = 0.4
"""To remember: a hysteresis turns, and the path. Half or twice as much foretells no better."""
ON_THE_WAY_BACK_S: Final = 2.0
"""... of a tip that was pushed or loaded: it is one way, and all of it tells."""
_ONE_MM2: Final = 20.0
"""As much motion as told as is taken for seen: 0.3 mm of noise in spans of 4 mm, eight of which
overlap."""
_ANSWERS: Final = 0.6, 1.8
"""Singular values beyond these tell of a push, and of no body."""
_SURELY_WITHIN: Final = min(1.0 - _ANSWERS[0], _ANSWERS[1] - 1.0)
"""No singular value is further from one than the matrix is from the identity (Weyl)."""
_ONE: Final = np.eye(3)


class Answer:
    """Takes where the tip is and what of the told motion has arrived, step by step."""

    def __init__(self) -> None:
        self._lately: deque[tuple[float, Vector, Vector]] = deque()
        self._told = np.zeros((3, 3))
        """Σ x xᵀ, mm²."""
        self._made = np.zeros((3, 3))
        """Σ s xᵀ, mm²."""
        self.matrix = np.eye(3)
        """(3, 3) M."""

    def begin(self) -> None:
        """What comes next does not go on from here, and is another body's."""
        self._lately.clear()
        self._told, self._made, self.matrix = np.zeros((3, 3)), np.zeros((3, 3)), np.eye(3)

    def add(
        self, t_s: float, dt_s: float, tip_mm: Vector, arrived_mm: Vector, memory_s: float
    ) -> None:
        """At `t_s` the tip is at (3,), and (3,) of what was told has arrived. memory_s: after which
        a third of what was seen is left."""
        lately = self._lately
        lately.append((t_s, tip_mm, arrived_mm))
        begin = bisect_left(lately, t_s - _SPAN_S, key=itemgetter(0))
        _, then_mm, arrived_then_mm = lately[begin]
        while len(lately) > 1 and lately[1][0] <= t_s - _SPAN_S:
            lately.popleft()
        came, due = tip_mm - then_mm, arrived_mm - arrived_then_mm
        kept = exp(-dt_s / memory_s)
        self._told = kept * self._told + np.outer(due, due)
        self._made = kept * self._made + np.outer(came, due)
        one = _ONE_MM2 * _ONE
        self.matrix = _limited((self._made + one) @ np.linalg.inv(self._told + one))


def _limited(matrix: Vector) -> Vector:
    """(3, 3) with its singular values in their limits, which most have that are near to one."""
    away = (matrix - _ONE).ravel()
    if away @ away <= _SURELY_WITHIN**2:
        return matrix
    left, values, right = np.linalg.svd(matrix)
    return np.asarray((left * np.clip(values, *_ANSWERS)) @ right)
