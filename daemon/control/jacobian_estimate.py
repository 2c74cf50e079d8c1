"""A Jacobian that is corrected by every motion: Broyden's rank-one rule, with a memory.

Broyden changes the Jacobian J as little as possible so that it explains the last motion x → d:
J + (d − J x) xᵀ / xᵀx. That believes noise in full, and forgets as much about directions that were
just measured as about others. Here the change goes along P x instead of x, where P is how uncertain
the rows of J are by direction: J + (d − J x) xᵀP / (xᵀP x + r). P shrinks along what was measured
and grows with the distance moved. Without noise r and with P = 1 this is Broyden's own rule.
"""

from daemon.control import jacobian_kernels as kernels
from daemon.control.jacobian_kernels import in_rows
from daemon.control.task import rank_of
from drivers.pose import Vector

_RELATIVE_NOISE = 0.1
"""Hysteresis and curvature: the part of a motion of the tip that no Jacobian explains."""
_WORST_CONDITION = 1e3
"""A change that would leave the tip so much harder to move one way than another is dropped."""
_LARGEST_STD_MM = 300.0
"""More uncertain than this is unknown anyway."""


class JacobianEstimate:
    """Axes count in shares of their range: elements of J are mm per whole range."""

    def __init__(
        self, jacobian: Vector, covariance: Vector, noise_mm: float, drift_mm: float
    ) -> None:
        """jacobian: (r, m) of a task of r coordinates. covariance: (m, m) mm², of each row.

        noise_mm: of one coordinate of a motion. drift_mm: how far an element may wander while the
        axes go through their whole range; standard deviations.
        """
        self.jacobian = in_rows(jacobian)
        self.covariance = in_rows(covariance)
        self._rank = min(rank_of(len(self.jacobian)), self.jacobian.shape[1])
        self._noise_variance = noise_mm**2
        self._drift_variance = drift_mm**2

    def correct(self, moved: Vector, tip_moved: Vector) -> None:
        """Take a motion: (m,) of the axes, (r,) of the tip."""
        jacobian, covariance = kernels.corrected(
            self.jacobian,
            self.covariance,
            moved,
            tip_moved,
            self._drift_variance,
            _LARGEST_STD_MM**2,
            self._noise_variance,
            _RELATIVE_NOISE**2,
        )
        if kernels.condition(jacobian, self._rank) < _WORST_CONDITION:
            self.jacobian, self.covariance = jacobian, covariance
