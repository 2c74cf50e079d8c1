"""What the local controllers are told: scales, reward, and how far they trust few data."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector

ScaleRule = Literal["inverse_mean", "ess", "printed"]

_PAPER_RIDGE = 1e-9
_SMALLEST_STEP = 1e-9


@dataclass(frozen=True, eq=False)
class LocalControllerSettings:
    """Lengths of steps are typical ones; everything else counts in them and has no unit."""

    tip_step_mm: float
    """Typical |Δp| of a sample."""
    axis_steps: Vector
    """(m,) typical |Δu| of a sample by axis, mm or rad."""
    weighting: Vector | None = None
    """N of the cost, (m,) diagonal or (m, m), for Δu counted in axis_steps. None: 1/m for every
    axis, so that a typical step from an attractor that is at rest costs 1."""
    attractor_gain: float = 0.1
    """K_a: the part of the way to the posture that the cheapest step goes."""
    attractor_steps: float | None = 1.0
    """The cheapest step Δu₀ is no longer than so many typical steps; None: as long as it is.
    Exploration only holds steps of its own length, and rewards only choose among them: an
    attractor beyond their reach makes all of them equally bad, and so pulls less, not more."""
    sigma_rule: ScaleRule = "inverse_mean"
    """How σ², the sharpness of the reward exp(−½ σ² C), follows from a field's costs.

    inverse_mean: κ / mean cost, so that the unit of the cost does not matter. ess: the same, but
    never so sharp that less than `effective_samples` remain, and 0 where there are no more.
    printed: the mean cost itself, as equation 11 has it: only works where N makes costs about 1.
    """
    kappa: float | None = None
    """κ. None: m, since a cost is a sum over m axes."""
    effective_samples: float | None = None
    """Of the rule `ess`. None: twice as many as a controller has parameters per axis."""
    ridge: float = 1e-4
    """Added to the mean Gram's diagonal, except for the bias; regressors count in their scales."""
    prior_mass: float = 10.0
    """Pre-training counts in each field as so many samples at its centre; never as more than there
    were."""
    minimum_mass: float = 1e-3
    """A field whose samples' weights sum to less, with no prior, knows nothing and is left out."""

    def __post_init__(self) -> None:
        steps = np.array(self.axis_steps, dtype=np.float64)
        object.__setattr__(self, "axis_steps", steps)
        if steps.ndim != 1 or not (np.isfinite(steps).all() and (steps > 0.0).all()):
            raise ValueError(f"axis_steps must be positive, one per axis, not {steps}")
        for name in ("tip_step_mm", "ridge", "minimum_mass"):
            _require(name, getattr(self, name), above=0.0)
        for name in ("kappa", "effective_samples", "attractor_steps"):
            if getattr(self, name) is not None:
                _require(name, getattr(self, name), above=0.0)
        if not (np.isfinite(self.prior_mass) and self.prior_mass >= 0.0):
            raise ValueError(f"prior_mass must not be negative, not {self.prior_mass}")
        if not 0.0 <= self.attractor_gain < 1.0:
            raise ValueError(f"attractor_gain must be in [0, 1), not {self.attractor_gain}")
        if self.sigma_rule not in ("inverse_mean", "ess", "printed"):
            raise ValueError(f"sigma_rule: there is no {self.sigma_rule!r}")
        object.__setattr__(self, "weighting", self._weighting_matrix())

    @classmethod
    def paper(cls, tip_step_mm: float, axis_steps: Vector, weighting: Vector | None = None) -> Self:
        """Equations 5–13 with nothing added but what keeps them from being singular.

        What is misprinted stays corrected: the field's exponent, the attractor's sign, the squared
        residual, and observed Δp in the regression.
        """
        return cls(
            tip_step_mm,
            axis_steps,
            weighting,
            attractor_steps=None,
            sigma_rule="printed",
            ridge=_PAPER_RIDGE,
            prior_mass=0.0,
            minimum_mass=1e-300,
        )

    @property
    def axes(self) -> int:
        """m."""
        return len(self.axis_steps)

    @property
    def parameters(self) -> int:
        """Of one controller per axis: [Δp, p, u, 1]."""
        return 7 + self.axes

    @property
    def sharpness(self) -> float:
        """κ."""
        return float(self.axes) if self.kappa is None else self.kappa

    @property
    def least_effective_samples(self) -> float:
        """What the rule `ess` leaves."""
        given = self.effective_samples
        return 2.0 * self.parameters if given is None else given

    @property
    def weighting_matrix(self) -> Vector:
        """(m, m) N."""
        assert self.weighting is not None
        return self.weighting

    def _weighting_matrix(self) -> Vector:
        m = self.axes
        given = np.full(m, 1.0 / m) if self.weighting is None else np.array(self.weighting, float)
        matrix = np.diag(given) if given.ndim == 1 else given
        if matrix.shape != (m, m):
            raise ValueError(f"weighting must be {(m,)} or {(m, m)}, not {given.shape}")
        if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T):
            raise ValueError("weighting must be finite and symmetric")
        if not np.linalg.eigvalsh(matrix)[0] > 0.0:
            raise ValueError("weighting must be positive definite")
        return matrix


def typical_steps(samples: Sequence[MotionSample]) -> tuple[float, Vector]:
    """Root mean square |Δp| in mm, and (m,) Δu by axis: tip_step_mm and axis_steps."""
    if not samples:
        raise ValueError("no samples: typical steps are unknown")
    tip = np.array([sample.delta_tip_mm for sample in samples])
    axes = np.array([sample.delta_u for sample in samples])
    tip_step_mm = float(np.sqrt(np.mean(np.sum(tip**2, axis=1))))
    axis_steps = np.sqrt(np.mean(axes**2, axis=0))
    return max(tip_step_mm, _SMALLEST_STEP), np.maximum(axis_steps, _SMALLEST_STEP)


def _require(name: str, value: float, above: float) -> None:
    if not (np.isfinite(value) and value > above):
        raise ValueError(f"{name} must be above {above:g}, not {value}")
