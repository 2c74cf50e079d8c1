"""What the body shall stay between, and a rough idea of which axes lead outside of it.

What the walls of the workspace are to the tip, the tensions at which it goes slack or tears are to
a tendon.
"""

import numpy as np

from config.control import Workspace
from config.robot import Robot
from daemon.control.controller import Observation
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector, length

# A rough idea of what the body does for which axes, from what was seen: it keeps waypoints inside.
#
# A quadratic in all axes, by least squares. It is no model to control with.


_RIDGE = 1e-3
"""Of the mean square of a feature that is 1."""


class QuadraticGuess:
    """Takes axes and k values that belong together; guesses once it has seen some of them."""

    def __init__(self, axes: AxisRanges, values: int) -> None:
        self._middle = 0.5 * (axes.lowest + axes.highest)
        self._half = 0.5 * axes.travel
        self._upper = np.triu_indices(axes.count)
        features = 1 + axes.count + len(self._upper[0])
        self._squares = np.zeros((features, features))
        self._products = np.zeros((features, values))
        self._seen = 0
        self._solution: Vector | None = None

    def add(self, u: Vector, values: Vector) -> None:
        """Take (m,) axes and (k,) values that belong together."""
        features = self._features(u[None, :])[0]
        self._squares += np.outer(features, features)
        self._products += np.outer(features, values)
        self._seen += 1
        self._solution = None

    def at(self, u: Vector) -> Vector:
        """(n, k) values for (n, m) axes; NaN while nothing was seen."""
        if not self._seen:
            return np.full((len(u), self._products.shape[1]), np.nan)
        if self._solution is None:
            ridge = _RIDGE * self._seen * np.eye(len(self._squares))
            ridge[0, 0] = 0.0
            self._solution = np.asarray(np.linalg.solve(self._squares + ridge, self._products))
        return np.asarray(self._features(u) @ self._solution)

    def _features(self, u: Vector) -> Vector:
        x = (u - self._middle) / self._half
        first, second = self._upper
        return np.hstack([np.ones((len(x), 1)), x, x[:, first] * x[:, second]])


# What the body shall stay between: the tip in its workspace, each tendon neither slack nor torn.


_INSIDE_AT_LEAST = 0.5
"""Of the workspace that is left between its walls, however thick they are said to be."""
_TENSION_SPARED = 0.05
"""Of each tendon's range of tensions, at either end. It has to do for friction, which lets one
rise or fall at once where its tendon turns round."""
_BEHIND_THE_FIRST = 0.8
"""Of what the walls are thick, that is left before one from where the tip was first, as far as the
workspace goes: an arm that rests near its end would turn back from every line across its middle."""


_NEAR = 0.55
"""Of how far the tip is from its base where it is first, along each coordinate. A soft arm that
bends farther in seconds of motion shows more of a shape that no quadratic has than of how it rises
and sinks, and a path near the axis of one is then followed 60 mm off."""


class Walls:
    """The tip's place, and then the tensions of what tendons there are."""

    def __init__(self, robot: Robot, wall_mm: float) -> None:
        tensions_n = [axis.tension_range_n for axis in robot.axes]
        self._tendons = [i for i, one in enumerate(tensions_n) if one is not None]
        self._box, self._wall_mm = robot.workspace, wall_mm
        pairs = 3 * [(-np.inf, np.inf)]
        if robot.workspace is not None:
            pairs = _box(robot.workspace, wall_mm)
        for low, high in filter(None, tensions_n):
            spared = _TENSION_SPARED * (high - low)
            pairs.append((low + spared, high - spared))
        self._lowest, self._highest = np.array(pairs).reshape(-1, 2).T
        self.count = len(pairs)

    def come_near(self, tip_mm: Vector) -> None:
        """The tip is at (3,) first, and shall not go so far that no quadratic tells where it is."""
        if np.isfinite(tip_mm).all():
            reach_mm, tip = _NEAR * length(tip_mm), slice(0, 3)
            self._lowest[tip] = np.maximum(self._lowest[tip], tip_mm - reach_mm)
            self._highest[tip] = np.minimum(self._highest[tip], tip_mm + reach_mm)

    def stand_back(self, tip_mm: Vector) -> None:
        """The tip is at (3,) first, before anything moves."""
        if self._box is None or not np.isfinite(tip_mm).all():
            return
        low, high = np.array([self._box.x_mm, self._box.y_mm, self._box.z_mm]).T
        tip, left_mm = slice(0, 3), _BEHIND_THE_FIRST * self._wall_mm
        behind = np.maximum(low, tip_mm - left_mm), np.minimum(high, tip_mm + left_mm)
        self._lowest[tip] = np.minimum(self._lowest[tip], behind[0])
        self._highest[tip] = np.maximum(self._highest[tip], behind[1])

    def values(self, observation: Observation) -> Vector:
        """(k,) mm and N: what stands between the walls at this step."""
        tip, pulls = observation.tip_mm, observation.tensions_n
        if pulls is None:
            return np.concatenate([tip, np.full(len(self._tendons), np.nan)])
        return np.concatenate([tip, pulls[self._tendons]])

    def beyond(self, values: Vector) -> Vector:
        """(n,) how far the worst of each of (n, k) values is outside, as a share of what is between
        its walls; 0 inside, and where it is not known."""
        outside = np.maximum(self._lowest - values, values - self._highest)
        shares = outside / self._between
        return np.asarray(np.nan_to_num(shares, nan=0.0).max(axis=1, initial=0.0))

    def well_inside(self, values: Vector, share: float) -> bool:
        """Whether the tip is by so much of the workspace's width away from its walls, and no
        tendon beyond its own."""
        if self.beyond(values[None, :])[0] > 0.0:
            return False
        tip = slice(0, 3)
        low, high, at = self._lowest[tip], self._highest[tip], values[tip]
        return bool((np.minimum(at - low, high - at) > share * self._between[tip]).all())

    @property
    def _between(self) -> Vector:
        """(k,) what is between the walls; 1 where there are none."""
        between = self._highest - self._lowest
        return np.where(np.isfinite(between), between, 1.0)


def _box(workspace: Workspace, wall_mm: float) -> list[tuple[float, float]]:
    """Lowest and highest x, y and z where the tip may be."""
    pairs = []
    for low, high in (workspace.x_mm, workspace.y_mm, workspace.z_mm):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        inside = max(half - wall_mm, _INSIDE_AT_LEAST * half)
        pairs.append((middle - inside, middle + inside))
    return pairs
