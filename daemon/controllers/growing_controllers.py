"""Local controllers for a robot that nothing was known of: fields come where the robot comes.

Where no field is active a new one is made, whose controller is at first the inverse of the Jacobian
as it is known then. Engines stand on fields that do not change. So a new field means a new engine;
it is filled from the window in idle time, and takes over when it knows as much as the old one.
"""

from collections import deque
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.local_law import LocalLaw, window_arrays, window_samples
from daemon.learning.inverse.local_controllers import Command, LocalControllers
from daemon.learning.inverse.window import Window
from daemon.learning.samples.motion_sample import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

_BORN_BELOW = 0.3
"""A sample that no field weighs more makes one."""
_MOST_FIELDS = 500
_METRIC = 16.0
"""Of every field: it reaches a quarter of the travel."""
_REFILLED_AT_ONCE = 2


class GrowingControllers:
    """The part of a `LocalControllers` that a controller needs."""

    def __init__(
        self,
        law: LocalLaw,
        scale: Vector,
        jacobian_at: Callable[[Vector, Vector], Vector],
        capacity: int,
        posture: Vector,
    ) -> None:
        """scale: (3 + m,) what p and u count in. jacobian_at: (3, m) at (3,) p and (m,) u."""
        self.window = Window(capacity, law.settings.axes)
        self._law = law
        self._scale = scale
        self._jacobian_at = jacobian_at
        self._posture = posture
        self._centres = np.zeros((0, len(scale)))
        self._jacobians = np.zeros((0, 3, law.settings.axes))
        self._engine: LocalControllers | None = None
        self._next: LocalControllers | None = None
        self._missing: deque[MotionSample] = deque()
        """What the next engine has not seen yet, oldest first."""

    @property
    def count(self) -> int:
        """Fields, with the one that is being made."""
        return len(self._centres)

    def add(self, sample: MotionSample) -> None:
        """Take a sample in. Raises ValueError, and nothing changes then."""
        self.window.add(sample)
        if self._engine is not None:
            self._engine.add(sample)
        if self._next is not None:
            self._missing.append(sample)
        elif self._alone(sample):
            self._bear(sample)

    def solve(self, budget: int | None = None) -> None:
        """Work that can wait: bring the next engine up to date, or solve fields."""
        if self._next is None:
            if self._engine is not None:
                self._engine.solve(budget)
            return
        for _ in range(len(self._missing) if budget is None else _REFILLED_AT_ONCE):
            if self._missing:
                self._next.add(self._missing.popleft())
        if not self._missing:
            self._engine, self._next = self._next, None

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> Command:
        """See `LocalControllers`."""
        if self._engine is None:
            return Command(np.zeros(len(u)), 0.0, 0.0)
        return self._engine.command(delta_tip_mm, tip_mm, u)

    def set_posture(self, posture: Vector) -> None:
        """See `LocalControllers`."""
        self._posture = posture
        if self._engine is not None:
            self._engine.set_posture(posture)
        if self._next is not None:
            self._next.set_posture(posture)

    def to_arrays(self) -> dict[str, NDArray[np.float64]]:
        """For a file. From here on this goes on as what is made of them does."""
        self.solve()
        arrays = {
            "field_centres": self._centres,
            "field_jacobians": self._jacobians,
            "field_scale": self._scale,
            **window_arrays(self.window),
        }
        self.restore(arrays)
        return arrays

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, ValueError."""
        self._scale = arrays["field_scale"]
        self._centres, self._jacobians = arrays["field_centres"], arrays["field_jacobians"]
        samples = window_samples(arrays)
        self.window.clear()
        for sample in samples[-self.window.capacity :]:
            self.window.add(sample)
        self._next = None
        self._missing.clear()
        self._engine = self._made() if self.count else None
        if self._engine is not None:
            self._engine.refill(self.window)

    def _alone(self, sample: MotionSample) -> bool:
        away = np.concatenate([sample.tip_mm, sample.u]) / self._scale - self._centres
        squared = np.einsum("fd,fd->f", away, away).min(initial=np.inf)
        return self.count < _MOST_FIELDS and bool(np.exp(-0.5 * _METRIC * squared) < _BORN_BELOW)

    def _bear(self, sample: MotionSample) -> None:
        place = np.concatenate([sample.tip_mm, sample.u]) / self._scale
        jacobian = self._jacobian_at(sample.tip_mm, sample.u)
        self._centres = np.concatenate([self._centres, place[None]])
        self._jacobians = np.concatenate([self._jacobians, jacobian[None]])
        self._next = self._made()
        self._missing.extend(self.window)

    def _made(self) -> LocalControllers:
        metrics = np.tile(_METRIC * np.eye(len(self._scale)), (self.count, 1, 1))
        fields = ReceptiveFields(self._centres, metrics, self._scale)
        return self._law.on_fields(fields, self._jacobians, self._posture)
