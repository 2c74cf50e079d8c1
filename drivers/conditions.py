"""Named conditions: what is wrong with a device right now, in words, and what helps."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

NOTED_EVERY_NS: Final = 50_000_000


@dataclass(frozen=True)
class Condition:
    """One thing that can be wrong. Each driver has a table of its own."""

    name: str
    text: str
    remedy: str


@dataclass(frozen=True)
class ActiveCondition:
    """A condition that holds now."""

    condition: Condition
    subject: str
    """What it is about: `tracker`, `can0`, `can0/3`."""
    detail: str
    since_ns: int


@dataclass(frozen=True)
class ConditionChange:
    """A condition that came or went; one that holds for no time at all comes and goes at once."""

    active: ActiveCondition
    present: bool
    t_ns: int


class Conditions:
    """Which conditions hold. Raising one twice, or clearing one that is not there, does nothing."""

    def __init__(self, on_change: Callable[[ConditionChange], None] | None = None) -> None:
        self._active: dict[tuple[str, str], ActiveCondition] = {}
        self._noted_ns: dict[tuple[str, str], int] = {}
        self._on_change = on_change

    def set(self, condition: Condition, subject: str, t_ns: int, detail: str = "") -> None:
        """The condition holds from now on."""
        key = (condition.name, subject)
        if key in self._active:
            return
        active = ActiveCondition(condition, subject, detail, t_ns)
        self._active[key] = active
        self._tell(ConditionChange(active, True, t_ns))

    def clear(self, condition: Condition, subject: str, t_ns: int) -> None:
        """The condition holds no longer."""
        active = self._active.pop((condition.name, subject), None)
        if active is not None:
            self._tell(ConditionChange(active, False, t_ns))

    def note(self, condition: Condition, subject: str, t_ns: int, detail: str = "") -> None:
        """Something happened that is over already, like a reset. Once more at once is no news: a
        device may say it thousands of times a second, and to tell it is work."""
        key = (condition.name, subject)
        if t_ns - self._noted_ns.get(key, t_ns - NOTED_EVERY_NS) < NOTED_EVERY_NS:
            return
        self._noted_ns[key] = t_ns
        active = ActiveCondition(condition, subject, detail, t_ns)
        self._tell(ConditionChange(active, True, t_ns))
        self._tell(ConditionChange(active, False, t_ns))

    def clear_subject(self, subject: str, t_ns: int, keep: Iterable[Condition] = ()) -> None:
        """Everything about `subject` is over, but for `keep`."""
        kept = {condition.name for condition in keep}
        for name, about in list(self._active):
            if about == subject and name not in kept:
                self.clear(self._active[name, about].condition, subject, t_ns)

    def holds(self, condition: Condition, subject: str) -> bool:
        """Whether the condition holds now."""
        return (condition.name, subject) in self._active

    def active(self) -> list[ActiveCondition]:
        """All that hold now, longest first."""
        return sorted(self._active.values(), key=lambda active: active.since_ns)

    def _tell(self, change: ConditionChange) -> None:
        if self._on_change is not None:
            self._on_change(change)
