"""A CAN bus as the master sees it, whatever is behind it."""

from collections.abc import Sequence
from typing import Protocol

from drivers.conditions import Condition

# Looking on at a bus' traffic without taking part in it.


class TrafficTap(Protocol):
    """Sees every data frame. Called in the bus cycle: must be quick."""

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        """A frame came."""
        ...

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        """The interface took these frames, in this order."""
        ...


class FrameReceiver(Protocol):
    """The master's side. Called from the event loop, never from another thread."""

    def frame_received(self, can_id: int, data: bytes, t_ns: int) -> None:
        """A data frame came; `t_ns` was taken when it was read."""
        ...

    def condition_seen(self, condition: Condition, present: bool, detail: str) -> None:
        """The interface says that something is wrong with the bus, or no longer."""
        ...

    def link_lost(self, error: OSError) -> None:
        """The link is gone and already closed. Called once, and not after `close`."""
        ...


class CanLink(Protocol):
    """An open CAN interface."""

    def send(self, can_id: int, data: bytes) -> bool:
        """Hand a data frame to the interface. False: it took none, and the frame is dropped.

        Never blocks and never queues here: a newer target must not wait behind an older one.
        """
        ...

    def send_all(self, frames: Sequence[tuple[int, bytes]]) -> int:
        """Hand over the frames of one cycle, in order. Returns how many were taken."""
        ...

    def read_in_cycle(self, on: bool) -> None:
        """On: frames are delivered by `drain` only, so that they do not wake the process one by
        one. Off, as at first: they are delivered when they come."""
        ...

    def drain(self) -> None:
        """Deliver what has come."""
        ...

    def close(self) -> None:
        """Let go of the interface. Safe to call twice."""
        ...


class LinkError(OSError):
    """The interface cannot be opened. Says why and what to do about it."""

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(f"{reason}: {remedy}")
        self.reason = reason
        self.remedy = remedy
