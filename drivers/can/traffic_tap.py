"""Looking on at a bus' traffic without taking part in it."""

from collections.abc import Sequence
from typing import Protocol


class TrafficTap(Protocol):
    """Sees every data frame. Called in the bus cycle: must be quick."""

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        """A frame came."""
        ...

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        """The interface took these frames, in this order."""
        ...
