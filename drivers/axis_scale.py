"""Between a drive's integer counts and what the axis moves: mm, rad, mL, N; and whether a drive
that has factors of its own counts as the robot file says."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import isclose, pi
from typing import Final

from config.axis import Axis, Drive
from safety.limits import CountLimits

_MM3_PER_ML = 1000.0
_ONE: Final = Fraction(1)


@dataclass(frozen=True)
class AxisScale:
    """Conversions of one axis. `unit` is mm or rad."""

    unit: str
    counts_per_unit: float
    """Signed: negative where counting up moves the axis down."""
    ml_per_mm: float | None
    """Cylinder volume per mm, where the axis drives a cylinder."""
    force_per_permille: float
    """N (N·mm for a rotation) at the output per 1/1000 of rated torque, without losses. Signed."""

    def counts(self, position: float) -> int:
        """Nearest count to a position in mm or rad."""
        return round(position * self.counts_per_unit)

    def position(self, counts: float) -> float:
        """Position in mm or rad."""
        return counts / self.counts_per_unit

    def volume_ml(self, counts: float) -> float | None:
        """Volume pushed out of the cylinder since zero, mL; None where there is no cylinder."""
        return None if self.ml_per_mm is None else self.position(counts) * self.ml_per_mm

    def counts_of_volume(self, volume_ml: float) -> int:
        """Nearest count to a cylinder volume. Raises ValueError where there is no cylinder."""
        if self.ml_per_mm is None:
            raise ValueError("this axis drives no cylinder")
        return self.counts(volume_ml / self.ml_per_mm)

    def magnitude(self, length: float) -> int:
        """Counts of an unsigned length, velocity or acceleration, at least 1."""
        return max(1, round(length * abs(self.counts_per_unit)))

    def force(self, torque_permille: int) -> float:
        """Output force in N (torque in N·mm) at an actual torque (0x6077).

        For a tendon: its tension. Friction in screw and gear makes the true force smaller.
        """
        return torque_permille * self.force_per_permille


def axis_scale(axis: Axis) -> AxisScale:
    """The conversions that an axis' configuration implies."""
    sign = -1.0 if axis.drive.inverted else 1.0
    torque_nmm = sign * axis.drive.rated_torque_nmm * axis.gear_ratio / 1000.0
    area_mm2 = axis.piston_area_mm2
    return AxisScale(
        axis.unit,
        axis.counts_per_unit,
        None if area_mm2 is None else area_mm2 / _MM3_PER_ML,
        torque_nmm * 2 * pi / axis.units_per_turn,
    )


def count_limits(axis: Axis) -> CountLimits:
    """The limits of an axis in counts."""
    scale = axis_scale(axis)
    lowest, highest = sorted(map(scale.counts, axis.travel))
    return CountLimits(
        lowest,
        highest,
        scale.magnitude(axis.max_velocity),
        scale.magnitude(axis.max_acceleration),
        scale.magnitude(axis.following_error),
        axis.drive.goes_on_s,
    )


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
