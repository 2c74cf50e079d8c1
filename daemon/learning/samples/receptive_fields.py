"""Where local models are valid: Gaussian kernels over tip position and actuation.

Geometry only. Fields are made and shaped by the forward model's learning and stand still while the
robot is controlled: a changed metric would change the weight of every sample in the window.
"""

import numpy as np

from drivers.pose import Vector


class ReceptiveFields:
    """f fields over z = [p, u] / scale, d = 3 + m numbers (Ho 2018, equation 6, exponent −½).

    w = exp(−½ (z − c)ᵀ D (z − c)).
    """

    def __init__(self, centres: Vector, metrics: Vector, scale: Vector) -> None:
        """centres c: (f, d), and metrics D: (f, d, d), of z; scale: (d,), mm and axes' units.

        Raises ValueError for shapes that do not belong together, numbers that are not finite, and
        metrics that are not symmetric and positive definite.
        """
        self.centres = np.array(centres, dtype=np.float64)
        self.metrics = np.array(metrics, dtype=np.float64)
        self.scale = np.array(scale, dtype=np.float64)
        d = len(self.scale)
        if self.scale.shape != (d,) or d < 4:
            raise ValueError(f"scale must be (3 + axes,), not {self.scale.shape}")
        if self.centres.ndim != 2 or self.centres.shape[1] != d:
            raise ValueError(f"centres must be (fields, {d}), not {self.centres.shape}")
        if self.metrics.shape != (self.count, d, d):
            raise ValueError(f"metrics must be {(self.count, d, d)}, not {self.metrics.shape}")
        if not (np.isfinite(self.scale).all() and (self.scale > 0.0).all()):
            raise ValueError(f"scale must be positive and finite, not {self.scale}")
        if not (np.isfinite(self.centres).all() and np.isfinite(self.metrics).all()):
            raise ValueError("a receptive field is not finite")
        if not np.allclose(self.metrics, self.metrics.transpose(0, 2, 1), rtol=1e-9, atol=1e-9):
            raise ValueError("a receptive field's metric is not symmetric")
        try:
            lower = np.linalg.cholesky(self.metrics)
        except np.linalg.LinAlgError:
            raise ValueError("a receptive field's metric is not positive definite") from None
        self.roots = np.ascontiguousarray(lower.transpose(0, 2, 1))
        """(f, d, d) upper triangular M, D = MᵀM: the exponent is −½ |M (z − c)|²."""

    @property
    def count(self) -> int:
        return len(self.centres)

    @property
    def axes(self) -> int:
        """m."""
        return len(self.scale) - 3

    def place(self, tip_mm: Vector, u: Vector) -> Vector:
        """z: (d,), or (n, d) for n rows of both."""
        return np.concatenate([tip_mm, u], axis=-1) / self.scale

    def log_weights(self, tip_mm: Vector, u: Vector) -> Vector:
        """(f,) ln w: still a number where w itself is too small for one."""
        away = self.place(tip_mm, u) - self.centres
        result: Vector = -0.5 * np.einsum("fa,fab,fb->f", away, self.metrics, away)
        return result

    def weights(self, tip_mm: Vector, u: Vector) -> Vector:
        """(f,) w: 1 at a field's centre."""
        return np.exp(self.log_weights(tip_mm, u))
