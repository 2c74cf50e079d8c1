"""A rough idea of where the tip is for which axes, from what was seen: it keeps waypoints inside.

A quadratic in all axes, by least squares. It is no model to control with.
"""

import numpy as np

from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_RIDGE = 1e-3
"""Of the mean square of a feature that is 1."""


class TipGuess:
    """Takes frames; guesses once it has seen enough of them."""

    def __init__(self, axes: AxisRanges) -> None:
        self._middle = 0.5 * (axes.lowest + axes.highest)
        self._half = 0.5 * axes.travel
        self._upper = np.triu_indices(axes.count)
        features = 1 + axes.count + len(self._upper[0])
        self._squares = np.zeros((features, features))
        self._products = np.zeros((features, 3))
        self._seen = 0
        self._solution: Vector | None = None

    def add(self, u: Vector, tip_mm: Vector) -> None:
        """Take (m,) axes and (3,) mm that belong together."""
        features = self._features(u[None, :])[0]
        self._squares += np.outer(features, features)
        self._products += np.outer(features, tip_mm)
        self._seen += 1
        self._solution = None

    def at(self, u: Vector) -> Vector:
        """(n, 3) mm for (n, m) axes; NaN while nothing was seen."""
        if not self._seen:
            return np.full((len(u), 3), np.nan)
        if self._solution is None:
            ridge = _RIDGE * self._seen * np.eye(len(self._squares))
            ridge[0, 0] = 0.0
            self._solution = np.asarray(np.linalg.solve(self._squares + ridge, self._products))
        return np.asarray(self._features(u) @ self._solution)

    def _features(self, u: Vector) -> Vector:
        x = (u - self._middle) / self._half
        first, second = self._upper
        return np.hstack([np.ones((len(x), 1)), x, x[:, first] * x[:, second]])
