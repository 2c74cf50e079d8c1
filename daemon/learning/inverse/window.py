"""The samples that are learnt from now: a fixed number of them, the oldest leaves first."""

from collections.abc import Iterator

import numpy as np

from daemon.learning.samples.motion_sample import MotionSample
from drivers.pose import Vector


class Window:
    """FIFO of motion samples in ring buffers: nothing is allocated after the start.

    Slot k holds tip_mm[k] (3,), u[k] (m,), delta_u[k] (m,) and delta_tip_mm[k] (3,). Slots do not
    move while their sample is in the window, so that others may keep arrays beside them.
    """

    def __init__(self, capacity: int, axes: int) -> None:
        if capacity < 1 or axes < 1:
            raise ValueError(f"no window of {capacity} samples of {axes} axes")
        self.capacity = capacity
        self.axes = axes
        self._shapes = (3,), (axes,), (axes,), (3,)
        self.tip_mm = np.zeros((capacity, 3))
        self.u = np.zeros((capacity, axes))
        self.delta_u = np.zeros((capacity, axes))
        self.delta_tip_mm = np.zeros((capacity, 3))
        self.count = 0
        self.slot = 0
        """Where the next sample goes. When the window is full, the oldest is there."""

    @property
    def full(self) -> bool:
        """Whether the next sample pushes the oldest one out."""
        return self.count == self.capacity

    def check_shapes(self, sample: MotionSample) -> None:
        """Raise ValueError for a sample that is not of this robot."""
        for name, value, expected in zip(sample._fields, sample, self._shapes, strict=True):
            if value.shape != expected:
                raise ValueError(f"sample's {name}: shape {value.shape}, expected {expected}")

    def check(self, sample: MotionSample) -> None:
        """Raise ValueError for a sample that is not finite, or not of this robot."""
        self.check_shapes(sample)
        for name, value in zip(sample._fields, sample, strict=True):
            if not np.isfinite(value).all():
                raise ValueError(f"sample's {name} is not finite: {value}")

    def add(self, sample: MotionSample) -> MotionSample | None:
        """Take `sample` in; give what fell out. Raises ValueError, and nothing changes then."""
        self.check(sample)
        fallen = self._at(self.slot) if self.full else None
        self.store(sample)
        return fallen

    def store(self, sample: MotionSample) -> None:
        """Take in a sample that was checked."""
        slot = self.slot
        self.tip_mm[slot] = sample.tip_mm
        self.u[slot] = sample.u
        self.delta_u[slot] = sample.delta_u
        self.delta_tip_mm[slot] = sample.delta_tip_mm
        self.slot = (slot + 1) % self.capacity
        self.count = min(self.count + 1, self.capacity)

    def clear(self) -> None:
        """Forget all samples."""
        self.count = 0
        self.slot = 0

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[MotionSample]:
        """Copies of the samples, oldest first."""
        oldest = self.slot - self.count
        for index in range(self.count):
            yield self._at((oldest + index) % self.capacity)

    def _at(self, slot: int) -> MotionSample:
        rows: tuple[Vector, ...] = (self.tip_mm, self.u, self.delta_u, self.delta_tip_mm)
        return MotionSample(*(row[slot].copy() for row in rows))
