"""What happens, told to everybody: states, causes, conditions, commands."""

from collections.abc import Callable
from typing import Any

from daemon.messages import Event, Message
from daemon.service.telemetry.flapping import Changes, Key, Words
from drivers.clock import Clock
from drivers.conditions import ConditionChange
from safety.failsafe import ActiveReason
from safety.states import OperatingState


class EventHistory:
    """Numbers events, and publishes them."""

    def __init__(self, clock: Clock, publish: Callable[[Message], None]) -> None:
        self._clock = clock
        self._publish = publish
        self._count = 0
        self._reasons: tuple[ActiveReason, ...] = ()
        self._changes = Changes(clock, self._tell_change)

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
        self._changes.catch_up()
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

    def _change(self, key: Key, present: bool, **words: Any) -> None:
        self._changes.add(key, present, words)

    def _tell_change(self, key: Key, present: bool, words: Words) -> None:
        kind, name, subject = key
        self.tell(kind, name, subject=subject, present=present, **words)
