"""The factors between a motor's turns and a drive's counts, where the drive has any, against what
the robot file says of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import isclose
from typing import Final

from config.axis import Drive

_ONE: Final = Fraction(1)


@dataclass(frozen=True)
class CountFactors:
    """What a drive says of its counts; None: it says nothing of it."""

    gear: Fraction | None = None
    """0x6091: turns of the motor per turn of the shaft."""
    feed: Fraction | None = None
    """0x6092: counts per turn of the shaft."""
    velocity: Fraction | None = None
    """0x6096: units of velocity per count per second."""


def count_differences(factors: CountFactors, drive: Drive) -> Iterator[str]:
    """Where a drive counts otherwise than `counts_per_turn` and `velocity_unit_counts_s` say.

    Factors of 1:1 are taken for none: drives are delivered so, whatever they count in.
    """
    gear, feed = factors.gear or _ONE, factors.feed or _ONE
    if feed != _ONE:
        counts = feed / gear
        if counts != drive.counts_per_turn:
            yield (
                f"0x6092 is {_ratio(feed)} and 0x6091 {_ratio(gear)}, which are "
                f"{float(counts):g} counts per turn of the motor, not {drive.counts_per_turn}"
            )
    elif gear != _ONE:
        yield f"0x6091 is {_ratio(gear)}, not 1:1"
    velocity, unit = factors.velocity or _ONE, drive.velocity_unit_counts_s
    if velocity != _ONE and not isclose(velocity * unit, 1.0):
        yield (
            f"0x6096 is {_ratio(velocity)}, which is a velocity unit of {float(1 / velocity):g} "
            f"counts/s, not {unit:g}"
        )


def _ratio(factor: Fraction) -> str:
    return f"{factor.numerator}:{factor.denominator}"
