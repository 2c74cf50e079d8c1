"""Where the axes are told to be: whole counts for drives, lengths and angles for controllers.

A step is made of whole counts. What rounding leaves of one is asked for again with the next: else
an axis would not move at all that is asked for less than half a count in each frame. With a gain of
3 per s at 40 frames a second that is seven counts of error: a millimetre, where a count moves the
tip by 0.15 mm.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from drivers.cia402.axis_channel import AxisChannel
from drivers.pose import Vector
from safety.permit import PermittedStep

_ROUNDED: Final = 0.5
"""Counts: a step that is another by more was made another by the gate."""


class AxisTargets:
    """Of all axes, from the step that was sent last."""

    def __init__(self, channels: Sequence[AxisChannel]) -> None:
        self._channels = channels
        self._step: PermittedStep | None = None
        self._left = [0.0] * len(channels)
        """Counts that rounding has left of the last step, axis by axis."""
        ends = [
            sorted(end * channel.scale.counts_per_unit for end in channel.axis.travel)
            for channel in channels
        ]
        self._lowest, self._highest = ([pair[end] for pair in ends] for end in (0, 1))

    @property
    def measured(self) -> list[int]:
        """Counts, where the axes are."""
        return [channel.position_counts for channel in self._channels]

    def forget(self) -> None:
        """The axes stand where they are, and are told nothing."""
        self._step = None
        self.drop_rest()

    def drop_rest(self) -> None:
        """What rounding has left is no longer wanted."""
        self._left = [0.0] * len(self._left)

    def counts(self, t_ns: int) -> Sequence[int]:
        """Where each axis is told to be at that time; where it is, if it was told nothing."""
        return self.measured if self._step is None else self._step.targets(t_ns)

    def in_units(self, counts: Sequence[int]) -> Vector:
        """(m,) mm or rad of so many counts."""
        places = [
            channel.scale.position(count)
            for channel, count in zip(self._channels, counts, strict=True)
        ]
        return np.array(places)

    def asked(self, wanted: Vector) -> list[float]:
        """Counts to ask the gate for, so that the axes come to (m,) mm or rad: with what rounding
        has left of the step before, which asks for no more than an axis' travel."""
        counts = []
        for place, channel, left, lowest, highest in zip(
            *(wanted.tolist(), self._channels, self._left, self._lowest, self._highest), strict=True
        ):
            alone = place * channel.scale.counts_per_unit
            counts.append(min(max(alone + left, min(alone, lowest)), max(alone, highest)))
        return counts

    def keep_rest(self, asked: Sequence[float], step: PermittedStep | None) -> None:
        """Of what was asked for this was permitted, or nothing: keep what only rounding has taken
        away."""
        if step is None:
            self.drop_rest()
            return
        self._left = [
            left if abs(left := whole - count) <= _ROUNDED else 0.0
            for whole, count in zip(asked, step.to_counts, strict=True)
        ]

    def take(self, step: PermittedStep) -> None:
        """It was sent."""
        self._step = step
