"""Slow creep of the body's material: a standard linear solid, at every place of the body.

A spring in series with a dashpot stands parallel to the body's long-term stiffness K∞. At once the
body takes (1 − c) of the strain that it takes for good; the rest c comes with the creep time.
"""

from math import exp
from typing import NamedTuple

import numpy as np
from numba import njit

from sim_backends.plants.plant import FloatArray


class Creep(NamedTuple):
    """What has crept so far.

    stiffness: (N, 6) for good. unloaded and crept: (N, 3, 6), the strain without load, and what
    time has added to it. share: c. time_s: of the approach under a constant load.
    """

    stiffness: FloatArray
    unloaded: FloatArray
    crept: FloatArray
    share: float
    time_s: float

    @classmethod
    def rested(
        cls,
        stiffness: FloatArray,
        unloaded: FloatArray,
        strain: FloatArray,
        share: float,
        time_s: float,
    ) -> "Creep":
        """A body that has been at `strain` for long."""
        return cls(stiffness, unloaded, share * (strain - unloaded), share, time_s)

    def over(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Stiffness (N, 6) and rest (N, 3, 6) of the rod that creeps for `dt_s` while it settles.

        crept' = (c (strain − unloaded) − crept) / t, stepped implicitly, so any dt_s is right in
        the end: with a = exp(−dt/t) the new strain itself weighs (1 − a) c.
        """
        kept, yielding = self._kept(dt_s)
        stiffness = self.stiffness * (yielding / (1.0 - self.share))
        return stiffness, self.unloaded + self.crept * (kept / yielding)

    def after(self, dt_s: float, strain: FloatArray) -> "Creep":
        """What has crept when the rod has settled at `strain` (N, 3, 6) after `dt_s`."""
        kept, _ = self._kept(dt_s)
        towards = (1.0 - kept) * self.share
        crept = _crept(self.crept, kept, strain, self.unloaded, towards)
        return Creep(self.stiffness, self.unloaded, crept, self.share, self.time_s)

    def _kept(self, dt_s: float) -> tuple[float, float]:
        kept = exp(-dt_s / (self.time_s * (1.0 - self.share)))
        return kept, 1.0 - (1.0 - kept) * self.share


@njit(cache=True)
def _crept(
    before: FloatArray, kept: float, strain: FloatArray, unloaded: FloatArray, towards: float
) -> FloatArray:
    """(N, 3, 6) what has crept: a share of what had, and a share of the strain."""
    out = np.empty_like(before)
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            for a in range(out.shape[2]):
                new = towards * (strain[k, j, a] - unloaded[k, j, a])
                out[k, j, a] = kept * before[k, j, a] + new
    return out
