"""What an axis may be asked to do, in the drive's own integer counts."""

from dataclasses import dataclass
from math import inf
from typing import Final

LOWEST_COUNT: Final = -(1 << 31)
HIGHEST_COUNT: Final = (1 << 31) - 1
"""Drives take and tell positions as 32 bits with a sign (0x607A, 0x6064)."""


@dataclass(frozen=True)
class CountLimits:
    """Limits of one axis. Counts, counts/s, counts/s²; all but `lowest` and `highest` positive."""

    lowest: int
    highest: int
    max_velocity: int
    max_acceleration: int
    max_lag: int
    """How far a target may be from where the axis was measured to be."""
    goes_on_s: float = 0.0
    """How long the axis goes on with its last velocity, before it brakes, when nobody tells it
    anything any more: of its travel so much is kept free."""

    def __post_init__(self) -> None:
        """Raises ValueError where these are no limits."""
        if not LOWEST_COUNT <= self.lowest <= self.highest <= HIGHEST_COUNT:
            raise ValueError(f"a travel from {self.lowest} to {self.highest} is not one of 32 bits")
        for name in ("max_velocity", "max_acceleration", "max_lag"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")
        if not 0.0 <= self.goes_on_s < inf:
            raise ValueError(f"an axis does not go on for {self.goes_on_s} s")


@dataclass(frozen=True)
class Violation:
    """One limit that a step would break."""

    axis: int
    limit: str
    requested: float
    allowed: float

    def __str__(self) -> str:
        return f"axis {self.axis}: {self.limit} {self.requested:g} is beyond {self.allowed:g}"
