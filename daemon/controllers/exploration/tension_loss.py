"""Whether a tendon is about to lose most of its tension, while others pull against it.

Stiff tendons on opposite sides of an arm strain each other before they bend it. Who does not know
yet how much, moves until one of them has lost a good part of what it had, and turns back then.
"""

from typing import Final

import numpy as np

from drivers.pose import Vector

_KEPT: Final = 0.4
"""Share of the tension that it began with, that each tendon keeps ..."""
_AHEAD_S: Final = 0.1
"""... also so much later, if it goes on to lose it as now: nine newtons a second have been seen,
and an axis that is told to turn round goes on for so long."""


class TensionLoss:
    """Of all tendons, from the moment that motion begins."""

    def __init__(self) -> None:
        self._begun_n: Vector | None = None
        """(m,) then; None: nobody knows."""
        self._before_n: Vector | None = None

    def begin(self, tensions_n: Vector | None) -> None:
        """(m,) tensions, NaN where an axis is no tendon; None: nobody knows."""
        self._begun_n = self._before_n = tensions_n

    def grave(self, tensions_n: Vector | None, dt_s: float) -> bool:
        """Whether one has lost most of its tension, or will have in a moment. (m,) as they are now,
        so much after they were asked for last."""
        begun_n, before_n, self._before_n = self._begun_n, self._before_n, tensions_n
        if tensions_n is None or before_n is None or begun_n is None or not dt_s > 0.0:
            return False
        then_n = tensions_n + _AHEAD_S / dt_s * (tensions_n - before_n)
        return bool((np.minimum(tensions_n, then_n) < _KEPT * begun_n).any())
