"""Every step of an experiment that counts, as arrays: what figures and statistics are made of."""

import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StepSeries:
    """The steps within cycles, while the robot was RUNNING, in their order. nan: not known."""

    t_s: Array
    """(n,) along the trajectory, which stands still while the robot does."""
    cycle: Array
    """(n,) whole numbers from 0."""
    reference_mm: Array
    """(n, 3)"""
    tip_mm: Array
    """(n, 3) filtered: what the controller saw."""
    reading_mm: Array
    """(n, 3) as the tracker gave it."""
    true_mm: Array
    """(n, 3) where it was."""
    u: Array
    """(n, m) where the axes were, in shares of their travel."""

    @property
    def error_mm(self) -> Array:
        """(n,) distance of the filtered tip from its reference."""
        return np.asarray(np.linalg.norm(self.tip_mm - self.reference_mm, axis=1))

    @property
    def cycles(self) -> list[int]:
        """The numbers of the cycles that were begun."""
        return [int(number) for number in np.unique(self.cycle)]

    def save(self, path: Path) -> None:
        """Write all, in single precision. A reader sees the whole file or none. Raises OSError."""
        partial = path.with_name(path.name + ".partial")
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        with partial.open("wb") as file:
            np.savez_compressed(
                file,
                allow_pickle=False,
                **{name: array.astype(np.float32) for name, array in arrays.items()},
            )
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)

    @classmethod
    def load(cls, path: Path) -> "StepSeries":
        """Raises OSError, ValueError, KeyError for what is no such file."""
        with np.load(path, allow_pickle=False) as stored:
            return cls(**{field.name: stored[field.name].astype(float) for field in fields(cls)})
