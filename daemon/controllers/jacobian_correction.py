"""What a Jacobian lacks here and now, found by the motions of the last moment.

A learnt model knows how the Jacobian J changes from place to place; a load, creep or another body
change all of it a little. The difference E is corrected by every motion x → d: as little as
possible, and where it is uncertain rather than where it was just measured,
E + (d − (J + E) x) xᵀP / (xᵀP x + r). P, how uncertain the rows of E are by direction, shrinks
along what was measured and grows with the distance moved. While the axes go on, E fades where
nothing new is told about it: the model is then the better guess.
"""

import numpy as np

from drivers.pose import Vector

_RELATIVE_NOISE = 0.1
"""Hysteresis and curvature: the part of a motion of the tip that no Jacobian explains."""
FIRST_STD_MM = 20.0
"""Of a Jacobian's elements, mm per travel, before anything corrects them: hysteresis more than
noise."""
_LARGEST_STD_MM = 200.0
_SLOWEST, _FASTEST, _TURNED = -0.5, 2.0, 0.7
"""How much less, and how much more, than J has it a step may move the tip, and how far aside. There
are directions in which the tip hardly moves, and noise would soon turn them round; and who believes
that the axes do less than they do asks for too much."""


class JacobianCorrection:
    """Axes count in shares of their travel: elements are mm per whole travel."""

    def __init__(self, axes: int, noise_mm: float, drift_mm: float, reach: float) -> None:
        """noise_mm: of one coordinate of a motion. drift_mm: how far an element may wander while
        the axes go through their whole travel. reach: after so many travels a third is left."""
        self.difference = np.zeros((3, axes))
        """(3, m) E."""
        self.covariance = FIRST_STD_MM**2 * np.eye(axes)
        """(m, m) P, mm², of each row."""
        self._noise_variance = noise_mm**2
        self._drift_variance = drift_mm**2
        self._reach = reach

    def correct(self, jacobian: Vector, moved: Vector, tip_moved: Vector) -> None:
        """Take a motion: (m,) of the axes, (3,) of the tip. jacobian: (3, m) J there."""
        travelled = float(np.linalg.norm(moved))
        kept = float(np.exp(-travelled / self._reach))
        difference = kept * self.difference
        covariance = kept**2 * self.covariance
        covariance += self._drift_variance * travelled * np.eye(len(moved))
        covariance *= min(1.0, _LARGEST_STD_MM**2 / float(covariance.diagonal().max()))
        along = covariance @ moved
        noise = self._noise_variance + _RELATIVE_NOISE**2 * float(tip_moved @ tip_moved)
        gain = along / (float(moved @ along) + noise)
        difference += np.outer(tip_moved - (jacobian + difference) @ moved, gain)
        covariance -= np.outer(gain, along)
        self.difference = _limited(difference, jacobian)
        self.covariance = 0.5 * (covariance + covariance.T)


def _limited(difference: Vector, jacobian: Vector) -> Vector:
    """E = G J + rest, where J times the rest is zero, with G = S + A in its limits."""
    changed = difference @ np.linalg.pinv(jacobian)
    turned = 0.5 * (changed - changed.T)
    values, vectors = np.linalg.eigh(changed - turned)
    beyond = vectors * (values - np.clip(values, _SLOWEST, _FASTEST)) @ vectors.T
    angle = float(np.linalg.norm(turned)) / np.sqrt(2.0)
    if angle > _TURNED:
        beyond += (1.0 - _TURNED / angle) * turned
    return np.asarray(difference - beyond @ jacobian)
