"""Rate-independent hysteresis by Prandtl and Ishlinskii: many small springs, each with a slider.

A stop operator of threshold r is a spring that slips once it is stretched by r; its play operator
is where the slider stands. Springs and sliders in parallel give a force that remembers turning
points, wipes out inner loops and never gives back more work than was put in. (The operator with
play operators is the inverse of this one: displacement from force instead of force from
displacement. Their weights relate alike: the body is stiffer by `Σ stiffness` after a reversal.)
"""

import numpy as np
from numba import njit

from sim_backends.plants.plant import FloatArray


class StopOperators:
    """Sliders of n thresholds on each of m displacements.

    stiffness: (m, n) N/mm. threshold_mm: (n,) positive. slider_mm: (m, n) where the sliders stand.
    """

    def __init__(
        self, stiffness: FloatArray, threshold_mm: FloatArray, slider_mm: FloatArray
    ) -> None:
        self.stiffness = stiffness
        self.threshold_mm = threshold_mm
        self.slider_mm = slider_mm

    def force(self, displacement_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(m,) force N against a monotone move to (m,) displacements, and its derivative."""
        stretch = displacement_mm[:, None] - self.slider_mm
        held = np.minimum(np.maximum(stretch, -self.threshold_mm), self.threshold_mm)
        sticks = stretch == held
        return (self.stiffness * held).sum(axis=1), (self.stiffness * sticks).sum(axis=1)

    def sticking(self) -> FloatArray:
        """(m,) N/mm against a move that turns all sliders back: none of them slips."""
        return np.asarray(self.stiffness.sum(axis=1))

    def after(self, displacement_mm: FloatArray) -> "StopOperators":
        """The sliders after a monotone move."""
        dragged = _dragged(self.slider_mm, self.threshold_mm, displacement_mm)
        return StopOperators(self.stiffness, self.threshold_mm, dragged)


@njit(cache=True)
def _dragged(
    slider_mm: FloatArray, threshold_mm: FloatArray, displacement_mm: FloatArray
) -> FloatArray:
    """(m, n) where sliders stand after a move."""
    out = np.empty_like(slider_mm)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            stretch, reach = displacement_mm[i] - slider_mm[i, j], threshold_mm[j]
            out[i, j] = displacement_mm[i] - min(max(stretch, -reach), reach)
    return out
