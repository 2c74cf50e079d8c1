"""What an axis may be asked to do, in the drive's own integer counts."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
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


def braking_together_s(velocities: Sequence[float], limits: Sequence[CountLimits]) -> float:
    """How long axes take to come to rest together, on the straight line that they move on.

    velocities: counts/s, one per axis, as limits. The slowest to brake does so as hard as it may.
    """
    return max(
        [
            abs(velocity) / one.max_acceleration
            for velocity, one in zip(velocities, limits, strict=True)
        ]
    )


def at_rest(end: int, velocity: float, lasts_s: float, goes_on_s: float = 0.0) -> int:
    """Where an axis comes to rest that goes on from `end` for `goes_on_s`, where nobody tells it
    anything any more, and then brakes evenly, within `lasts_s`."""
    return end + int(velocity * (goes_on_s + lasts_s / 2))


@dataclass(frozen=True)
class CoupledViolation:
    """One coupled limit that a step would break."""

    limit: str

    def __str__(self) -> str:
        return f"coupled limit {self.limit}: the way does not keep to it"


@dataclass(frozen=True)
class Violation:
    """One limit that a step would break."""

    axis: int
    limit: str
    requested: float
    allowed: float

    def __str__(self) -> str:
        return f"axis {self.axis}: {self.limit} {self.requested:g} is beyond {self.allowed:g}"


def velocity_within(
    wanted: float, before: float, position: int, limits: CountLimits, cycle_s: float
) -> float:
    """The velocity nearest to `wanted`, counts/s, for an axis that is told velocities.

    before: what it was told a cycle of `cycle_s` ago. Neither faster than the axis may be, nor
    another by more than it may accelerate; and slow enough to stop inside its travel even where
    this is the last that it hears. An axis outside its travel may only come back.
    """
    most = limits.max_acceleration * cycle_s
    velocity = max(before - most, min(before + most, wanted))
    velocity = max(-limits.max_velocity, min(limits.max_velocity, velocity))
    upwards = _stopping_velocity(max(0, limits.highest - position), limits, cycle_s)
    downwards = _stopping_velocity(max(0, position - limits.lowest), limits, cycle_s)
    return max(-downwards, min(upwards, velocity))


def _stopping_velocity(distance: int, limits: CountLimits, cycle_s: float) -> float:
    """The v with v·(2T + g) + v²/2a = distance: what was measured is a cycle T old when this counts
    for another one, and then the axis may go on for g."""
    gained = limits.max_acceleration * (2 * cycle_s + limits.goes_on_s)
    return sqrt(gained * gained + 2 * limits.max_acceleration * distance) - gained
