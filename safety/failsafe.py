"""What is wrong right now, and how bad it is: the mechanism behind the table of causes."""

from dataclasses import dataclass
from typing import Final

from safety.causes import CauseRow, ClearRule, Severity

_DRAINS_SLOWER: Final = 4
"""A condition that holds a fifth of the time still fires."""


@dataclass(frozen=True, slots=True)
class ActiveReason:
    """A cause that has fired, for one subject."""

    cause: CauseRow
    subject: str
    """What it is about: `tracker`, `can0/3`, `loop`."""
    detail: str
    since_ns: int
    """When its condition came for the first time; stays while the reason stays."""
    latched: bool
    """The condition is gone, and the reason waits for somebody to clear it or to resume."""
    follows_from: str = ""
    """The cause that this one follows from, where `safety.consequences` has found one."""
    over: bool = False
    """It does nothing any more, and is told because of what follows from it."""

    @property
    def severity(self) -> Severity:
        """As in the table; an external chain that is closed again leaves a fault behind."""
        if self.over:
            return Severity.NONE
        return min(self.cause.severity, Severity.FAULT) if self.latched else self.cause.severity


@dataclass(frozen=True, slots=True)
class Verdict:
    """All that is wrong, worst first, and among equals the oldest first."""

    severity: Severity
    reasons: tuple[ActiveReason, ...]

    def at_least(self, severity: Severity) -> tuple[ActiveReason, ...]:
        """Those that are as bad as that, or worse."""
        return tuple(reason for reason in self.reasons if reason.severity >= severity)


_ALL_WELL: Final = Verdict(Severity.NONE, ())


class _Watch:
    """One cause for one subject, from the first time its condition came until all is over."""

    __slots__ = (
        "cause",
        "detail",
        "fired",
        "kept",
        "level_ns",
        "present",
        "reason",
        "since_ns",
        "subject",
        "t_ns",
        "threshold_ns",
        "untold",
    )

    def __init__(self, cause: CauseRow, subject: str, t_ns: int) -> None:
        self.cause = cause
        self.subject = subject
        self.detail = ""
        self.threshold_ns = round(cause.debounce_s * 1e9)
        self.level_ns = 0
        """Fills while the condition is present, drains more slowly while it is absent."""
        self.t_ns = self.since_ns = t_ns
        self.present = self.fired = False
        self.untold = False
        """It has fired, and no verdict has had it yet."""
        self.kept = False
        """It stays when its condition goes."""
        self.reason: ActiveReason | None = None

    def set(self, present: bool, t_ns: int, detail: str) -> None:
        """The condition is present from now on, or absent."""
        self._advance(t_ns)
        if present and not self.present:
            self.untold = self.fired
            if not self.fired:
                self.since_ns = self.t_ns
        if present and detail:
            self.detail = detail
        self.present = present

    def weigh(self, t_ns: int, energised: bool) -> ActiveReason | None:
        """What it adds to the verdict of now; the same object while nothing about it changes."""
        self._advance(t_ns)
        if self.cause.clears is ClearRule.DELIBERATELY:
            self.kept = self.kept or (self.fired and energised)
        elif self.cause.clears is ClearRule.BY_RESUME:
            self.kept = self.fired and energised
        self.fired = self.fired and (self.present or self.kept or self.untold)
        self.untold = False
        if not self.fired:
            self.reason = None
            return None
        latched = self.kept and not self.present
        reason = ActiveReason(self.cause, self.subject, self.detail, self.since_ns, latched)
        if self.reason != reason:
            self.reason = reason
        return self.reason

    @property
    def over(self) -> bool:
        """Whether there is nothing left to remember, once it adds nothing to the verdict."""
        return not (self.present or self.level_ns)

    @property
    def waits(self) -> bool:
        """Whether only somebody's word keeps it from going."""
        return self.kept and not self.present and not self.untold

    def _advance(self, t_ns: int) -> None:
        passed_ns = max(0, t_ns - self.t_ns)
        self.t_ns += passed_ns
        if not self.present:
            self.level_ns = max(0, self.level_ns - passed_ns // _DRAINS_SLOWER)
            return
        self.level_ns = min(self.threshold_ns, self.level_ns + passed_ns)
        if not self.fired and self.level_ns == self.threshold_ns:
            self.fired = self.untold = True


class Failsafe:
    """Takes conditions from whoever sees them, and says what they amount to."""

    def __init__(self) -> None:
        self._watches: dict[tuple[CauseRow, str], _Watch] = {}
        self._verdict = _ALL_WELL

    def set(
        self, cause: CauseRow, present: bool, t_ns: int, subject: str = "", detail: str = ""
    ) -> None:
        """The condition of a cause is present from now on, or absent.

        What comes and goes between two verdicts is still in the next one. While it is present, a
        new detail replaces the old one: leave numbers that always change out of it.
        """
        if not (present or self._watches):
            return  # as nearly always
        watch = self._watches.get((cause, subject))
        if watch is None:
            if not present:
                return
            watch = self._watches[cause, subject] = _Watch(cause, subject, t_ns)
        watch.set(present, t_ns, detail)

    @property
    def watching(self) -> bool:
        """Whether any condition is present, or remembered. Until then, to `set` one that is absent
        changes nothing, and who has many of them need not."""
        return bool(self._watches)

    def evaluate(self, t_ns: int, energised: bool) -> Verdict:
        """What is wrong now; the same object for as long as nothing changes.

        energised: whether the drives are, or are about to be. Only then do faults latch.
        """
        if not self._watches:
            return _ALL_WELL
        reasons = []
        for key, watch in tuple(self._watches.items()):
            reason = watch.weigh(t_ns, energised)
            if reason is not None:
                reasons.append(reason)
            elif watch.over:
                del self._watches[key]
        if not reasons:
            return _ALL_WELL
        reasons.sort(key=_worst_first)
        if tuple(reasons) != self._verdict.reasons:
            self._verdict = Verdict(reasons[0].severity, tuple(reasons))
        return self._verdict

    def resume(self) -> None:
        """The operator wants to go on: what waited for that goes, if its condition is gone."""
        self._drop(ClearRule.BY_RESUME)

    def clear(self) -> tuple[ActiveReason, ...]:
        """Latched causes go if their conditions are gone. Answers with those that stay."""
        self._drop(ClearRule.DELIBERATELY)
        stay = [
            watch.reason
            for watch in self._watches.values()
            if watch.reason is not None and watch.cause.clears is ClearRule.DELIBERATELY
        ]
        return tuple(sorted(stay, key=_worst_first))

    def _drop(self, rule: ClearRule) -> None:
        for key, watch in tuple(self._watches.items()):
            if watch.waits and watch.cause.clears is rule:
                del self._watches[key]


def _worst_first(reason: ActiveReason) -> tuple[int, int, str, str]:
    return -reason.severity, reason.since_ns, reason.cause.value, reason.subject
