"""How far off the tip is expected to be, and how fast a path may be followed for it.

Errors come of what nobody has seen yet: of the way that the reference goes while what was told has
not arrived, and while an error is being made up for. What is wrong at any speed adds to that. So
those of the last seconds are held against the ways on which they were made,

    ρ² = Σ |e|² / Σ (s² + s₀²)        s = |v|·(lag + 1 / gain),

and ρ·√(s² + s₀²) is expected at another speed. Before anything was followed ρ is that of a body
which is known as well as usual. A path is followed at the speed at which no more is expected than
is tolerated, as far as going slower helps: which it hardly does once s is down to s₀.
"""

from math import exp, hypot, sqrt
from typing import Final

_USUAL: Final = 0.06
"""ρ before anything was seen: slow bodies begin with 0.03 to 0.1, prompt ones are at 0.05."""
_USUAL_S: Final = 3.0
"""... which counts as if it had been seen for so long, at the speed s₀."""
_MEMORY_S: Final = 6.0
"""Then a third is left of what was seen."""
_ANY_SPEED_MM: Final = 3.0
"""s₀: with the usual ρ it makes an error as small as a tracker's noise."""
_LEAST_PACE: Final = 0.25
"""Some errors do not become less, of a body that gives way: a path comes to its end all the
same."""
_SLOWER_PER_S, _FASTER_PER_S = 0.5, 0.2
"""How fast the pace changes: a path that becomes slower is led as one that turns."""


class ExpectedError:
    """Takes errors and speeds, step by step; gives what is expected, and the pace."""

    def __init__(self, gain_per_s: float, tolerated_mm: float | None) -> None:
        """tolerated_mm: root mean square. None: whatever is expected, a path keeps its time."""
        self.pace = 1.0
        """Share of a path's own speed to ask for."""
        self._made_up_for_s = 1.0 / gain_per_s
        self._tolerated_mm = tolerated_mm
        self._ways = _USUAL_S * _ANY_SPEED_MM**2
        self._squared = _USUAL**2 * self._ways
        self._beyond = 0.0
        """Mean square of what was out of reach."""

    def add(
        self, dt_s: float, error_mm: float, speed_mm_s: float, lag_s: float, beyond_mm: float = 0.0
    ) -> None:
        """The tip was measured so far from a reference of that speed, and so far across to that
        where the axes can do nothing about it."""
        kept = exp(-dt_s / _MEMORY_S)
        self._beyond = kept * self._beyond + (1.0 - kept) * beyond_mm**2
        self._squared = kept * self._squared + dt_s * error_mm**2
        way_mm = self._way_mm(speed_mm_s, lag_s)
        self._ways = kept * self._ways + dt_s * (way_mm**2 + _ANY_SPEED_MM**2)

    def at(self, speed_mm_s: float, lag_s: float) -> float:
        """mm, root mean square, with a reference of that speed."""
        within_mm = self._share * hypot(self._way_mm(speed_mm_s, lag_s), _ANY_SPEED_MM)
        return hypot(within_mm, sqrt(self._beyond))

    def look_ahead(self, dt_s: float, speed_mm_s: float, lag_s: float) -> None:
        """Where a pace that is asked for now will count, the path's own speed is that."""
        if self._tolerated_mm is None:
            return
        bearable_mm = self._tolerated_mm / max(self._share, 1e-9)
        slowed_mm = sqrt(max(bearable_mm**2 - _ANY_SPEED_MM**2, _ANY_SPEED_MM**2))
        wanted = slowed_mm / max(self._way_mm(speed_mm_s, lag_s), slowed_mm)
        wanted = min(max(wanted, _LEAST_PACE), 1.0)
        slower, faster = self.pace - _SLOWER_PER_S * dt_s, self.pace + _FASTER_PER_S * dt_s
        self.pace = min(max(wanted, slower), faster)

    @property
    def _share(self) -> float:
        """ρ."""
        return sqrt(self._squared / self._ways)

    def _way_mm(self, speed_mm_s: float, lag_s: float) -> float:
        return speed_mm_s * (lag_s + self._made_up_for_s)
