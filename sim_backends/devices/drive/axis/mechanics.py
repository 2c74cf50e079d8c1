"""What an emulated axis is made of: motor, encoder, end stops and switches."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary


@dataclass(frozen=True)
class AxisMechanics:
    """One axis. Positions in encoder counts, from an origin that no drive knows."""

    counts_per_turn: int = 4000
    rated_torque_nmm: float = 400.0
    start_counts: float = 0.0
    low_stop_counts: float = -inf
    high_stop_counts: float = inf
    low_switch_counts: float | None = None
    """The negative limit switch is closed here and below; None: there is none."""
    high_switch_counts: float | None = None
    """The positive limit switch is closed here and above; None: there is none."""
    absolute_encoder: bool = False
    """Whether the encoder knows its place when it is switched on; else it begins with 0 there."""
    index_counts: float = 0.0
    """The encoder's index pulse is here, and every turn from here."""

    @property
    def low_switch(self) -> float:
        """Where the negative limit switch closes."""
        return -inf if self.low_switch_counts is None else self.low_switch_counts

    @property
    def high_switch(self) -> float:
        """Where the positive limit switch closes."""
        return inf if self.high_switch_counts is None else self.high_switch_counts


# The factor group (CiA 402-2, 8): from increments of the encoder to what the master reads.


_POSITION_REVERSED = 1 << 7
_VELOCITY_REVERSED = 1 << 6


def to_int32(value: float) -> int:
    """Rounded, and wrapped round as the drive's counters are."""
    return (round(value) + 0x80000000 & 0xFFFFFFFF) - 0x80000000


class Units:
    """Conversions of one axis; positions count from `zero`, in increments.

    As delivered, one user unit is one increment of this motor's encoder. on_change(t_ns): the
    factors have been written.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        base: int,
        counts_per_turn: int,
        on_change: Callable[[int], None],
    ) -> None:
        def own(index: int, subindex: int, default: int) -> Entry:
            return objects.own(base + index, subindex, DataType.UNSIGNED32, default)

        self._encoder = (own(0x608F, 1, counts_per_turn), own(0x608F, 2, 1))
        self._gear = (own(0x6091, 1, 1), own(0x6091, 2, 1))
        self._feed = (own(0x6092, 1, counts_per_turn), own(0x6092, 2, 1))
        self._velocity = (own(0x6096, 1, 1), own(0x6096, 2, 1))
        self._range = tuple(
            objects.own(base + 0x607B, 1 + end, DataType.INTEGER32, default)
            for end, default in enumerate((-0x80000000, 0x7FFFFFFF))
        )
        self._polarity = objects.own(base + 0x607E, 0, DataType.UNSIGNED8)
        self._encoder[0].deliver(counts_per_turn)
        self._feed[0].deliver(counts_per_turn)
        for entry in (*self._gear, *self._feed, *self._velocity, *self._range, self._polarity):
            entry.on_write = on_change
        self.zero = 0.0
        self.modulo: int | None = None
        """After so many units positions begin anew, at `_lowest`; None: they count on."""
        self._lowest = 0
        self.configure()

    def configure(self) -> None:
        """Take over the factors as they are now."""
        per_motor_turn = _ratio(self._feed) / _ratio(self._gear)
        self.per_increment = per_motor_turn / _ratio(self._encoder)
        if self._polarity.number & _POSITION_REVERSED:
            self.per_increment = -self.per_increment
        self._lowest, highest = (end.number for end in self._range)
        count = highest - self._lowest + 1
        self.modulo = count if 0 < count < 0x100000000 else None
        self._velocity_per_increment = abs(self.per_increment) * _ratio(self._velocity)
        if self._polarity.number & _VELOCITY_REVERSED:
            self._velocity_per_increment = -self._velocity_per_increment

    @property
    def reversed(self) -> bool:
        """Whether the master counts in the other direction than the encoder."""
        return self.per_increment < 0.0

    def position(self, increments: float) -> int:
        """A position as the master reads it."""
        units = round((increments - self.zero) * self.per_increment)
        if self.modulo is not None:
            return self._lowest + (units - self._lowest) % self.modulo
        return units if -0x80000000 <= units <= 0x7FFFFFFF else to_int32(units)

    def increments(self, position: float) -> float:
        """A position that the master gives."""
        return self.zero + position / self.per_increment

    def nearest(self, target: float, demand: float) -> float:
        """Of the places, in increments, that a target may mean, the one nearest to `demand`."""
        if self.modulo is None:
            return target
        turn = self.length(self.modulo)
        return target + turn * round((demand - target) / turn)

    def length(self, position: float) -> float:
        """A distance that the master gives, without its sign, in increments."""
        return abs(position / self.per_increment)

    def velocity(self, increments_s: float) -> int:
        """A velocity as the master reads it."""
        return to_int32(increments_s * self._velocity_per_increment)

    def increments_s(self, velocity: float) -> float:
        """A velocity that the master gives."""
        return velocity / self._velocity_per_increment


def _ratio(pair: tuple[Entry, Entry]) -> float:
    return max(1, pair[0].number) / max(1, pair[1].number)
