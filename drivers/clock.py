"""Where 'now' comes from. Injected, so that the same driver runs in real and in virtual time."""

from typing import Protocol


class Clock(Protocol):
    """A clock that never jumps."""

    def now_ns(self) -> int:
        """Nanoseconds since a fixed but arbitrary moment."""
        ...


def is_virtual(clock: Clock) -> bool:
    """Whether its time is that of an event loop that jumps: its date, and how long something took
    by it, are nobody's."""
    return getattr(clock, "virtual", False) is True


class WallClock(Clock, Protocol):
    """A clock that also knows the date, for files that people read."""

    def wall_time_ns(self) -> int:
        """Nanoseconds since 1970-01-01 UTC; may jump."""
        ...
