"""What lies between an axis and what it moves: play, and time that passes before anything arrives.

A shaft that turns back takes the play up first: what it drives stands still meanwhile (the play
operator of half-width b). A valve that opens late, or a line that is slow to answer, hands a motion
on unchanged, a dead time later. Both leave the shape of a motion between turning points as it is.
"""

from typing import NamedTuple, Self

import numpy as np

from sim_backends.plants.plant import FloatArray


class Transmission(NamedTuple):
    """What it remembers. Replaced as a whole; nothing in it changes.

    dead_time_s: 0 for none. backlash_mm: half of the play. driven: (m,) behind the play, as last
    handed in. ages_s: (k,) how long ago the places were handed in, the oldest first. places: (k, m)
    behind the play; between them the motion is even.
    """

    dead_time_s: float
    backlash_mm: float
    driven: FloatArray
    ages_s: tuple[float, ...]
    places: tuple[FloatArray, ...]

    @classmethod
    def rested(cls, dead_time_s: float, backlash_mm: float, at: FloatArray) -> Self:
        """It has stood at (m,) `at` for long, in the middle of its play."""
        place = np.array(at, dtype=np.float64)
        return cls(dead_time_s, backlash_mm, place, (0.0,), (place,))

    def after(self, shafts: FloatArray, dt_s: float) -> Self:
        """The shafts have gone evenly to (m,) `shafts` within `dt_s`."""
        play = self.backlash_mm
        driven = shafts
        if play > 0.0:
            driven = np.minimum(np.maximum(self.driven, shafts - play), shafts + play)
        if not self.dead_time_s > 0.0:
            return self._replace(driven=driven)
        ages = [*(age + dt_s for age in self.ages_s), 0.0]
        places = [*self.places, driven]
        while len(ages) > 1 and ages[1] >= self.dead_time_s:  # nobody asks for what is older
            del ages[0], places[0]
        return self._replace(driven=driven, ages_s=tuple(ages), places=tuple(places))

    @property
    def arrived(self) -> FloatArray:
        """(m,) what has come through by now."""
        if not self.dead_time_s > 0.0:
            return self.driven
        oldest_s = self.ages_s[0]
        if oldest_s <= self.dead_time_s or len(self.ages_s) == 1:
            return self.places[0]
        share = (oldest_s - self.dead_time_s) / (oldest_s - self.ages_s[1])
        return np.asarray(self.places[0] + share * (self.places[1] - self.places[0]))
