"""Whether the tip's errors persist or turn round: how much of the gain is of use.

A tracker's noise comes back as a motion of the tip, the more the higher the gain; and whatever
takes the tip off stays the longer, the lower it is. Where both are in balance, one error tells
nothing of the next that could be seen by the time the first is made up for: the innovations of an
optimal filter are white (Kailath 1968), and Mehra (1970) tunes a filter by that. So errors are held
against those some tenths of a second and a lag before,

    ρ = Σ e(t)·e(t − τ) / Σ |e|²

with old ones forgotten. Where they persist (ρ > 0) more of the gain is used, where they turn round
less. An error that is far above the usual ones is none of noise, and meets all of it at once.
"""

from collections import deque
from math import exp, sqrt
from typing import Final

from drivers.pose import Vector

_APART_S: Final = 0.25
"""And a lag, between errors that are compared: a tip's filter makes closer ones alike."""
_MEMORY_S: Final = 4.0
"""Then a third is left of what was seen."""
_PER_S: Final = 1.0
"""How fast the share of the gain goes after ρ: within a second where errors persist. Twice and half
as fast come to the same, on circles at 5 and 20 mm/s."""
_LEAST: Final = 0.4
"""Of the gain: a body that changes must still be seen to be off."""
_COUNTS: Final = 1.5
"""Times the usual error, at most: a corner's error is no noise, and shall not be most of what is
compared."""
_FAR_ABOVE: Final = 3.0
"""Times the usual error: what is larger meets all of the gain."""


class Persistence:
    """Takes errors, step by step; gives a share of the gain."""

    def __init__(self) -> None:
        self._lately: deque[tuple[float, Vector]] = deque()
        self.share = 1.0
        """Of the gain, for errors as they usually are."""
        self._together = self._squared = self._sizes = self._seen_s = 0.0

    def begin(self) -> None:
        """What comes next does not go on from here, and all of the gain may be needed."""
        self._lately.clear()
        self.share = 1.0

    def add(self, t_s: float, dt_s: float, error_mm: Vector, lag_s: float) -> float:
        """(3,) from the tip to its reference: the share of the gain to meet it with."""
        size_mm = sqrt(error_mm @ error_mm)
        kept = exp(-dt_s / _MEMORY_S)
        self._sizes = kept * self._sizes + dt_s * size_mm
        self._seen_s = kept * self._seen_s + dt_s
        usual_mm = max(self._sizes / max(self._seen_s, 1e-9), 1e-9)
        lately, apart_s = self._lately, _APART_S + lag_s
        error_mm = error_mm * min(1.0, _COUNTS * usual_mm / max(size_mm, 1e-9))
        lately.append((t_s, error_mm))
        while len(lately) > 1 and lately[1][0] <= t_s - apart_s:
            lately.popleft()
        then_s, then_mm = lately[0]
        if then_s <= t_s - apart_s:
            self._together = kept * self._together + dt_s * float(error_mm @ then_mm)
            self._squared = kept * self._squared + dt_s * float(error_mm @ error_mm)
            persists = self._together / max(self._squared, 1e-9)
            self.share = min(max(self.share * exp(_PER_S * persists * dt_s), _LEAST), 1.0)
        return max(self.share, min(size_mm / (_FAR_ABOVE * usual_mm), 1.0))
