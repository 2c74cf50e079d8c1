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

Not every body answers alike for as long as it is late. Where axes turn back and their play keeps
the tip, what the last moment showed is over before the next motion arrives: who goes by it asks for
too much and too little in turn, and the tip chatters. So M counts as far as it was right: what it
said of what would come in a lag is held against what came.
"""

from bisect import bisect_left
from collections import deque
from math import exp, sqrt
from operator import itemgetter
from typing import Final

import numpy as np

from daemon.control.lag import lag_kernels as kernels
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
_PRIOR: Final = _ONE_MM2 * _ONE
_JUDGED_S: Final = 6.0
"""Then a third is left of what M was right and wrong about. Half as long is as good."""
_DOUBT: Final = 0.5
"""Standard errors of the share of M - I that would have been right."""
_RIGHT_ENOUGH: Final = 1.0 / 3.0
"""Of such a share: all of M counts from there on. Who goes by M takes out most of what it says is
lacking, so a good one is seen to be right in no more. Between a third and a half as good.
"""


class Answer:
    """Takes where the tip is and what of the told motion has arrived, step by step."""

    def __init__(self) -> None:
        self._lately: deque[tuple[float, Vector, Vector, Vector]] = deque()
        """Times, (3,) mm where the tip was, (3,) mm that had arrived, and (3, 3) M."""
        self._told = np.zeros((3, 3))
        """Σ x xᵀ, mm²."""
        self._made = np.zeros((3, 3))
        """Σ s xᵀ, mm²."""
        self.matrix = np.eye(3)
        """(3, 3) M."""
        self._foretold = np.zeros(4)
        """As `surely_right` has them, of motions that took a lag."""

    @property
    def worth(self) -> float:
        """How far M is to be gone by for what is under way, 0 to 1."""
        return min(max(surely_right(self._foretold, _DOUBT) / _RIGHT_ENOUGH, 0.0), 1.0)

    def begin(self) -> None:
        """What comes next does not go on from here, and is another body's. How far it is to be
        foretold at all is not forgotten."""
        self._lately.clear()
        self._told, self._made, self.matrix = np.zeros((3, 3)), np.zeros((3, 3)), np.eye(3)

    def add(
        self,
        t_s: float,
        dt_s: float,
        tip_mm: Vector,
        arrived_mm: Vector,
        lag_s: float,
        memory_s: float,
    ) -> None:
        """At `t_s` the tip is at (3,), and (3,) of what was told has arrived. lag_s: of the body.
        memory_s: after which a third of what was seen is left."""
        lately = self._lately
        self._judge(t_s, dt_s, tip_mm, arrived_mm, max(lag_s, _SPAN_S))
        lately.append((t_s, tip_mm, arrived_mm, self.matrix))
        begin = bisect_left(lately, t_s - _SPAN_S, key=itemgetter(0))
        _, then_mm, arrived_then_mm, _ = lately[begin]
        came, due = tip_mm - then_mm, arrived_mm - arrived_then_mm
        kept = exp(-dt_s / memory_s)
        self.matrix = _limited(kernels.add_answer(self._told, self._made, kept, due, came, _PRIOR))

    def _judge(
        self, t_s: float, dt_s: float, tip_mm: Vector, arrived_mm: Vector, within_s: float
    ) -> None:
        """By what it was one lag ago: what has come since was under way then."""
        lately = self._lately
        while len(lately) > 1 and lately[1][0] <= t_s - within_s:
            lately.popleft()
        if not lately or lately[0][0] > t_s - within_s:
            return
        _, then_mm, arrived_then_mm, matrix = lately[0]
        due, came = arrived_mm - arrived_then_mm, tip_mm - then_mm
        # Motions overlap: only one in each lag tells something of its own.
        kept, weight = exp(-dt_s / _JUDGED_S), dt_s / within_s
        kernels.add_foretold(self._foretold, kept, weight, matrix, due, came)


def _limited(matrix: Vector) -> Vector:
    """(3, 3) with its singular values in their limits, which most have that are near to one."""
    away = (matrix - _ONE).ravel()
    if away @ away <= _SURELY_WITHIN**2:
        return matrix
    left, values, right = np.linalg.svd(matrix)
    return np.asarray((left * np.clip(values, *_ANSWERS)) @ right)


# How far a correction that motions told is to be believed: as far as it foretold the next ones.


def surely_right(foretold: Vector, doubt: float) -> float:
    """The share s of a correction that would have explained motions best, less `doubt` standard
    errors.

    foretold: (4,) sums over coordinates, of what the correction said times what was lacking without
    it, what it said squared, what was lacking squared; and how many coordinates that were. Nothing
    seen: 0.
    """
    agreed, said, lacked, count = foretold.tolist()
    if not said > 0.0 or not count > 1.0:
        return 0.0
    left = max(lacked - agreed * agreed / said, 0.0) / (count - 1.0)
    return float((agreed - doubt * sqrt(left * said)) / said)


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: a second once, then hundredths."""
    answer = Answer()
    for k in range(3):
        answer.add(_SPAN_S * k, _SPAN_S, float(k) * np.ones(3), np.zeros(3), 0.0, ON_A_PATH_S)
