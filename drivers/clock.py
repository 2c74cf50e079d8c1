"""Where 'now' comes from. Injected, so that the same driver runs in real and in virtual time."""

from typing import Protocol


class Clock(Protocol):
    """A clock that never jumps."""

    def now_ns(self) -> int:
        """Nanoseconds since a fixed but arbitrary moment."""
        ...


class WallClock(Clock, Protocol):
    """A clock that also knows the date, for files that people read."""

    def wall_time_ns(self) -> int:
        """Nanoseconds since 1970-01-01 UTC; may jump."""
        ...
