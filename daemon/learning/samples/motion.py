"""What one motion did: the thing that all learnt models of the robot are made from."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from drivers.pose import Vector

DEAD_SHARE = 0.35
"""Dead time in a body's lag, where nothing tells: of its sum with a first-order lag, which is what
motions along a path tell well. What looks like lag is partly hysteresis and creep, and no dead
time."""


class MotionSample(NamedTuple):
    """From (p, u) the axes moved by Δu, and the tip by Δp (Ho 2018, §2.2). All observed."""

    tip_mm: Vector
    """(3,) p: where the tip was when the motion began."""
    u: Vector
    """(m,) u: where the axes were, mm or rad."""
    delta_u: Vector
    """(m,) Δu."""
    delta_tip_mm: Vector
    """(3,) Δp."""


# Many motion samples as arrays, each with the stretch of the exploration that it is from.


Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class MotionTable:
    """n samples for m axes."""

    tip_mm: Vector
    """(n, 3) p."""
    u: Vector
    """(n, m)"""
    delta_u: Vector
    """(n, m)"""
    delta_tip_mm: Vector
    """(n, 3) Δp."""
    line: NDArray[np.int64]
    """(n,) number of the straight line that it is from: samples of one line are much alike."""

    def __post_init__(self) -> None:
        count, axes = self.u.shape
        shapes = [array.shape for array in (self.tip_mm, self.delta_u, self.delta_tip_mm)]
        if shapes != [(count, 3), (count, axes), (count, 3)] or self.line.shape != (count,):
            raise ValueError("these arrays are not one table of motions")
        if not all(np.isfinite(array).all() for array in (self.u, self.inputs, self.delta_tip_mm)):
            raise ValueError("a motion is not finite")

    @classmethod
    def of(cls, samples: Iterable[MotionSample], lines: Iterable[int], axes: int) -> Self:
        """A row for every sample."""
        rows = [np.concatenate(sample) for sample in samples]
        table = np.array(rows).reshape(len(rows), 6 + 2 * axes)
        tip, u, delta_u, delta_tip = np.split(table, [3, 3 + axes, 3 + 2 * axes], axis=1)
        return cls(tip, u, delta_u, delta_tip, np.fromiter(lines, np.int64, len(rows)))

    def __len__(self) -> int:
        return len(self.u)

    @property
    def axes(self) -> int:
        """m."""
        return int(self.u.shape[1])

    @property
    def inputs(self) -> Vector:
        """(n, 3 + 2 m) [p, u, Δu], the forward model's."""
        return np.hstack([self.tip_mm, self.u, self.delta_u])

    def samples(self) -> list[MotionSample]:
        """Row by row."""
        columns = (self.tip_mm, self.u, self.delta_u, self.delta_tip_mm)
        return [MotionSample(*row) for row in zip(*columns, strict=True)]

    def of_rows(self, chosen: Mask) -> "MotionTable":
        """Those where (n,) `chosen` is true."""
        return MotionTable(
            self.tip_mm[chosen],
            self.u[chosen],
            self.delta_u[chosen],
            self.delta_tip_mm[chosen],
            self.line[chosen],
        )

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """For a file."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]]) -> Self:
        """What `to_arrays` gave. Raises ValueError, KeyError."""
        tip, u, delta_u, delta_tip = (
            np.asarray(arrays[name], dtype=np.float64)
            for name in ("tip_mm", "u", "delta_u", "delta_tip_mm")
        )
        return cls(tip, u, delta_u, delta_tip, np.asarray(arrays["line"], dtype=np.int64))
