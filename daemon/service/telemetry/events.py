"""What happens, told to everybody: states, causes, conditions, commands."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from daemon.messages import Event, Message
from drivers.clock import Clock
from drivers.conditions import ConditionChange
from safety.failsafe import ActiveReason
from safety.states import OperatingState

_AT_ONCE: Final = 16
"""So many changes of one condition or cause are told as they come, ..."""
_EVERY_NS: Final = 1_000_000_000
"""... and where it flaps, one in that time: a tracker that sees a sensor in every other frame would
fill log and recording. Chosen."""


@dataclass(slots=True)
class _Flapping:
    """How often a condition or cause has changed lately, and what is not told of it yet."""

    present: bool = False
    """As told last."""
    told: int = 0
    """Changes, less one for each `_EVERY_NS` since."""
    since_ns: int = 0
    untold: int = 0

    def may_be_told(self, t_ns: int) -> bool:
        """Whether one more change may be told now, which is counted then."""
        gone = (t_ns - self.since_ns) // _EVERY_NS
        self.told, self.since_ns = max(0, self.told - gone), self.since_ns + gone * _EVERY_NS
        if self.told >= _AT_ONCE:
            return False
        self.told += 1
        return True


class EventHistory:
    """Numbers events, and publishes them."""

    def __init__(self, clock: Clock, publish: Callable[[Message], None]) -> None:
        self._clock = clock
        self._publish = publish
        self._count = 0
        self._reasons: tuple[ActiveReason, ...] = ()
        self._flapping: dict[tuple[str, ...], _Flapping] = {}
        self._untold: dict[tuple[str, ...], dict[str, Any]] = {}
        """The newest change of each, where it is another than was told last."""

    def tell(
        self,
        kind: str,
        name: str,
        text: str,
        *,
        subject: str = "",
        present: bool = True,
        severity: str = "",
        detail: str = "",
        follows_from: str = "",
    ) -> None:
        """Publish an event."""
        self._count += 1
        self._publish(
            Event(
                sequence=self._count,
                t_ns=self._clock.now_ns(),
                kind=kind,
                name=name,
                subject=subject,
                present=present,
                text=text,
                severity=severity,
                detail=detail,
                follows_from=follows_from,
            )
        )

    def condition(self, change: ConditionChange) -> None:
        """A driver's condition came or went."""
        active = change.active
        self._change(
            ("condition", active.condition.name, active.subject),
            change.present,
            text=active.condition.text,
            detail=active.detail,
        )

    def state(
        self, before: OperatingState, after: OperatingState, worst: ActiveReason | None
    ) -> None:
        """The robot is in another state, for the worst reason that there is."""
        self.tell(
            "state",
            after.value,
            f"{before.value} → {after.value}",
            subject="robot",
            detail="" if worst is None else f"{worst.cause.value}: {worst.cause.text}",
        )

    def reasons(self, reasons: tuple[ActiveReason, ...]) -> None:
        """These hold now: tell what has gone and what has come. Called every cycle."""
        if self._untold:
            self._catch_up()
        if reasons is self._reasons:
            return
        before = {(reason.cause.value, reason.subject): reason for reason in self._reasons}
        after = {(reason.cause.value, reason.subject): reason for reason in reasons}
        self._reasons = reasons
        gone = [key for key in before if key not in after]
        come = [key for key in after if key not in before]
        for key in gone + come:
            reason = after.get(key) or before[key]
            self._change(
                ("cause", *key),
                key in after,
                text=reason.cause.text,
                severity=reason.cause.severity.name.lower(),
                detail=reason.detail,
                follows_from=reason.follows_from,
            )

    def _change(self, key: tuple[str, ...], present: bool, **more: Any) -> None:
        flapping = self._flapping.setdefault(key, _Flapping())
        if not flapping.untold and flapping.may_be_told(self._clock.now_ns()):
            self._tell_change(key, present, more)
            return
        flapping.untold += 1
        if present == flapping.present:
            self._untold.pop(key, None)
        else:
            self._untold[key] = more

    def _catch_up(self) -> None:
        now_ns = self._clock.now_ns()
        for key, more in tuple(self._untold.items()):
            flapping = self._flapping[key]
            if flapping.may_be_told(now_ns):
                del self._untold[key]
                lost = flapping.untold - 1
                words = f"it comes and goes: {lost} changes were not told" if lost else ""
                detail = "; ".join(filter(None, (more.get("detail"), words)))
                flapping.untold = 0
                self._tell_change(key, not flapping.present, more | {"detail": detail})

    def _tell_change(self, key: tuple[str, ...], present: bool, more: dict[str, Any]) -> None:
        self._flapping[key].present = present
        kind, name, subject = key
        self.tell(kind, name, subject=subject, present=present, **more)
