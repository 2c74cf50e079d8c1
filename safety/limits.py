"""What an axis may be asked to do, in the drive's own integer counts."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CountLimits:
    """Limits of one axis. Counts, counts/s, counts/s²; all but `lowest` and `highest` positive."""

    lowest: int
    highest: int
    max_velocity: int
    max_acceleration: int
    max_lag: int
    """How far a target may be from where the axis was measured to be."""


@dataclass(frozen=True)
class Violation:
    """One limit that a step would break."""

    axis: int
    limit: str
    asked: float
    allowed: float

    def __str__(self) -> str:
        return f"axis {self.axis}: {self.limit} {self.asked:g} is beyond {self.allowed:g}"
