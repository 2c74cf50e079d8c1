"""What is wrong with the tracker now, and how often what has happened."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from drivers.clock import Clock
from drivers.conditions import ActiveCondition, Condition, ConditionChange, Conditions

SUBJECT = "tracker"


@dataclass
class Counters:
    """How often what has happened since the start."""

    frames: int = 0
    duplicates: int = 0
    """Replies that repeated the last frame: the price of asking early."""
    missed: int = 0
    """Frames that the device measured and nobody fetched."""
    counter_jumps: int = 0
    crc_errors: int = 0
    noise_bytes: int = 0
    strays: int = 0
    """Sound replies that nobody had asked for, or came too late."""
    retries: int = 0
    timeouts: int = 0
    reconnects: int = 0
    resets: int = 0
    tool_setups: int = 0


class Health:
    """The tracker's conditions and counters. A subject is `tracker`, or `tracker/` and a part."""

    def __init__(
        self, clock: Clock, on_change: Callable[[ConditionChange], None] | None = None
    ) -> None:
        self.counters = Counters()
        self._clock = clock
        self._conditions = Conditions(on_change)

    def set(self, condition: Condition, part: str = "", detail: str = "") -> None:
        """The condition holds from now on."""
        self._conditions.set(condition, _subject(part), self._clock.now_ns(), detail)

    def clear(self, *conditions: Condition, part: str = "") -> None:
        """The conditions hold no longer."""
        for condition in conditions:
            self._conditions.clear(condition, _subject(part), self._clock.now_ns())

    def note(self, condition: Condition, part: str = "", detail: str = "") -> None:
        """Something happened that is over already."""
        self._conditions.note(condition, _subject(part), self._clock.now_ns(), detail)

    def keep_only(self, condition: Condition, details: Mapping[str, str]) -> None:
        """The condition holds for exactly these parts, with these details."""
        for active in self._conditions.active():
            part = active.subject.removeprefix(SUBJECT).removeprefix("/")
            if active.condition is condition and part not in details:
                self.clear(condition, part=part)
        for part, detail in details.items():
            self.set(condition, part, detail)

    def holds(self, condition: Condition, part: str = "") -> bool:
        """Whether the condition holds now."""
        return self._conditions.holds(condition, _subject(part))

    def active(self) -> tuple[ActiveCondition, ...]:
        """All that hold now, longest first."""
        return tuple(self._conditions.active())

    def counted(self) -> Counters:
        """A copy of the counters as they are now."""
        return replace(self.counters)


def _subject(part: str) -> str:
    return f"{SUBJECT}/{part}" if part else SUBJECT
