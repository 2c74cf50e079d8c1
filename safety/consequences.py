"""Which causes follow from others: where one thing makes twenty go wrong, that one is told first.

This is telling only: what a cause does to the robot is in the table of causes, whatever it follows
from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from safety.causes import Cause, CauseRow, Severity
from safety.failsafe import ActiveReason

_BEFORE_NS: Final = 1_000_000_000
"""A consequence may be seen before what it follows from: the drives' silence is missed after 0.1 s,
their heartbeats after 0.25 s, and what drives say during a stall is read at its end."""
_AFTER_NS: Final = 2_000_000_000
"""... and so long after it is over: a drive that lost its master takes a second to be set up."""
_TOGETHER_NS: Final = 500_000_000
"""The same cause of several subjects, within this: they have one origin."""

_OF_A_DRIVE_THAT_IS_AWAY: Final = (
    Cause.NODE_NOT_READY,
    Cause.DRIVE_FAULT,
    Cause.DRIVE_FOLLOWING_ERROR,
    Cause.DRIVE_NOT_ENABLED,
    Cause.DRIVE_EMERGENCY,
    Cause.DRIVE_WARNING,
    Cause.DRIVE_LIMIT,
    Cause.TENDON_SLACK,
    Cause.ARMING_FAILED,
)
_OF_A_DRIVE: Final = (
    Cause.DRIVE_NO_VOLTAGE,
    Cause.NODE_RESET,
    Cause.NODE_LOST,
    *_OF_A_DRIVE_THAT_IS_AWAY,
)
_OF_LATE_CYCLES: Final = (
    *_OF_A_DRIVE,
    Cause.BUS_QUEUE_FULL,
    Cause.BUS_DEGRADED,
    Cause.TRACKER_NOT_READY,
    Cause.TRACKER_WARNING,
    Cause.TRACKER_LATE,
    Cause.TRACKER_QUALITY,
    Cause.TRACKER_GONE,
    Cause.SETPOINT_LATE,
    Cause.LEASE_LOST,
    Cause.LEASE_ABANDONED,
    Cause.RISK_UNAVAILABLE,
    Cause.RECORDING_DROPPED,
    Cause.LOOP_SLOW,
)
_OF_A_BUS: Final = (Cause.BUS_NOT_OPEN, Cause.BUS_QUEUE_FULL, Cause.BUS_DEGRADED, *_OF_A_DRIVE)

LEADS_TO: Final[Mapping[CauseRow, tuple[Cause, ...]]] = {
    Cause.INTERNAL_ERROR: (Cause.LOOP_STALLED, Cause.LOOP_LATE, *_OF_LATE_CYCLES),
    Cause.LOOP_STALLED: (Cause.LOOP_LATE, *_OF_LATE_CYCLES),
    Cause.LOOP_LATE: _OF_LATE_CYCLES,
    Cause.FOREIGN_MASTER: (Cause.BUS_OFF, Cause.DRIVE_SETTINGS_CHANGED, *_OF_A_BUS),
    Cause.BUS_GONE: (Cause.BUS_OFF, *_OF_A_BUS),
    Cause.BUS_OFF: _OF_A_BUS,
    Cause.BUS_NOT_OPEN: (Cause.BUS_QUEUE_FULL, Cause.BUS_DEGRADED, *_OF_A_DRIVE),
    Cause.BUS_QUEUE_FULL: (Cause.BUS_DEGRADED, *_OF_A_DRIVE),
    Cause.DRIVE_NO_VOLTAGE: _OF_A_DRIVE[1:],
    Cause.NODE_RESET: (Cause.NODE_LOST, Cause.DRIVE_SETTINGS_CHANGED, *_OF_A_DRIVE_THAT_IS_AWAY),
    Cause.NODE_LOST: _OF_A_DRIVE_THAT_IS_AWAY,
    Cause.DRIVE_SETTINGS_CHANGED: (Cause.NODE_NOT_READY, Cause.ARMING_FAILED),
    Cause.NODE_NOT_READY: (Cause.DRIVE_NOT_ENABLED, Cause.ARMING_FAILED),
    Cause.DRIVE_FOLLOWING_ERROR: (
        Cause.DRIVE_FAULT,
        Cause.DRIVE_NOT_ENABLED,
        Cause.DRIVE_EMERGENCY,
    ),
    Cause.DRIVE_FAULT: (
        Cause.DRIVE_NOT_ENABLED,
        Cause.DRIVE_EMERGENCY,
        Cause.DRIVE_WARNING,
        Cause.DRIVE_LIMIT,
        Cause.TENDON_SLACK,
        Cause.ARMING_FAILED,
    ),
    Cause.DRIVE_NOT_ENABLED: (Cause.ARMING_FAILED, Cause.TENDON_SLACK),
    Cause.TRACKER_NOT_READY: (
        Cause.TRACKER_WARNING,
        Cause.TRACKER_LATE,
        Cause.TRACKER_QUALITY,
        Cause.TRACKER_GONE,
    ),
    Cause.TRACKER_WARNING: (Cause.TRACKER_LATE, Cause.TRACKER_QUALITY, Cause.TRACKER_GONE),
    Cause.TRACKER_LATE: (Cause.TRACKER_QUALITY, Cause.TRACKER_GONE),
    Cause.LEASE_LOST: (Cause.LEASE_ABANDONED, Cause.SETPOINT_LATE),
    Cause.DISK_FULL: (Cause.DISK_LOW, Cause.RECORDER_FAILED, Cause.RECORDING_DROPPED),
    Cause.DISK_LOW: (Cause.RECORDER_FAILED, Cause.RECORDING_DROPPED),
    Cause.RECORDER_FAILED: (Cause.RECORDING_DROPPED,),
    Cause.RISK_UNAVAILABLE: (Cause.GATE_REFUSED,),
    Cause.RISK_TOO_HIGH: (Cause.GATE_REFUSED,),
    Cause.GIVING_WAY: (Cause.GATE_REFUSED, Cause.CONTROLLER_FAILED),
}
"""From what is nearest to the origin to what is farthest: of several leads the first one counts."""

LEADS_LATER_TO: Final[Mapping[CauseRow, tuple[Cause, ...]]] = {
    Cause.NODE_LOST: (Cause.BUS_QUEUE_FULL, Cause.BUS_DEGRADED),
}
"""What may be the origin of a cause also comes of it, if it comes much later: where no drive is
left to acknowledge them, frames stay in the queue, and it fills as slowly as they are sent."""

_RANK: Final = {lead: rank for rank, lead in enumerate(LEADS_TO)}

_Key = tuple[CauseRow, str]


@dataclass(slots=True)
class _Known:
    """A reason that there is, or was a moment ago."""

    reason: ActiveReason
    over_ns: int | None = None
    """When its condition was gone; None while it is there."""
    lead: _Key | None = None


class Consequences:
    """Remembers what followed from what, for as long as it is told."""

    def __init__(self) -> None:
        self._known: dict[_Key, _Known] = {}

    def ordered(self, reasons: Sequence[ActiveReason], t_ns: int) -> tuple[ActiveReason, ...]:
        """`reasons`, worst first, with what follows from another behind it.

        A lead that is over stays, marked as that, while anything that follows from it does.
        """
        present = {_key(reason) for reason in reasons}
        self._remember(reasons, present, t_ns)
        for reason in reasons:
            self._look_for_lead(self._known[_key(reason)], present)
        groups: dict[_Key, list[ActiveReason]] = {}
        for reason in reasons:
            key = _key(reason)
            origin = self._origin(key)
            self._known[key].lead = origin  # what stands between them may be forgotten
            groups.setdefault(origin, []).append(reason)
        ordered: list[ActiveReason] = []
        for origin, members in groups.items():
            lead = self._known[origin].reason
            ordered.append(lead if origin in present else replace(lead, over=True, latched=False))
            ordered += [
                replace(reason, follows_from=lead.cause.value)
                for reason in members
                if _key(reason) != origin
            ]
        self._forget(present, set(groups), t_ns)
        return tuple(ordered)

    def _remember(self, reasons: Sequence[ActiveReason], present: set[_Key], t_ns: int) -> None:
        for reason in reasons:
            known = self._known.setdefault(_key(reason), _Known(reason))
            if reason.since_ns != known.reason.since_ns:  # it has come anew
                known = self._known[_key(reason)] = _Known(reason)
            known.reason = reason
            if not reason.latched:
                known.over_ns = None
            elif known.over_ns is None:
                known.over_ns = t_ns
        for key in self._known.keys() - present:
            known = self._known[key]
            if known.over_ns is None:
                known.over_ns = t_ns

    def _look_for_lead(self, known: _Known, present: set[_Key]) -> None:
        """The one nearest to the origin; of equals the oldest. What was found before may change:
        the same cause of another subject leads no longer than it is there."""
        since_ns, cause = known.reason.since_ns, known.reason.cause
        if known.lead is not None and known.lead[0] is cause and known.lead not in present:
            known.lead = None
        found = [
            (_RANK.get(lead.reason.cause, len(_RANK)), lead.reason.since_ns, key)
            for key, lead in self._known.items()
            if (lead.reason.cause is not cause or key in present)
            and _may_lead(lead, cause, since_ns, known.reason.subject)
        ]
        if found:
            known.lead = min(found)[2]

    def _origin(self, key: _Key) -> _Key:
        """Of those that follow from each other in a circle, because one of them has come anew or by
        way of what leads later, the oldest: it is one for all of them."""
        way = [key]
        while (lead := self._known[way[-1]].lead) is not None and lead in self._known:
            if lead in way:
                circle = way[way.index(lead) :]
                return min(circle, key=lambda one: (self._known[one].reason.since_ns, one))
            way.append(lead)
        return way[-1]

    def _forget(self, present: set[_Key], leads: set[_Key], t_ns: int) -> None:
        for key, known in tuple(self._known.items()):
            old = known.over_ns is not None and t_ns - known.over_ns > _AFTER_NS
            if old and key not in present and key not in leads:
                del self._known[key]


def _may_lead(lead: _Known, cause: CauseRow, since_ns: int, subject: str) -> bool:
    """Whether that cause of that subject, which came then, can follow from `lead`."""
    began_ns, leads = lead.reason.since_ns, lead.reason.cause
    if leads is cause:
        earlier = (began_ns, lead.reason.subject) < (since_ns, subject)
        return earlier and since_ns - began_ns <= _TOGETHER_NS
    if cause in LEADS_LATER_TO.get(leads, ()):
        if since_ns <= began_ns + _BEFORE_NS:
            return False
    elif cause not in LEADS_TO.get(leads, ()) or since_ns < began_ns - _BEFORE_NS:
        return False
    return lead.over_ns is None or since_ns <= lead.over_ns + _AFTER_NS


def with_leads(reasons: Sequence[ActiveReason], severity: Severity) -> tuple[ActiveReason, ...]:
    """Those of `reasons`, as told, that are as bad as that, each group with its lead."""
    kept: list[ActiveReason] = []
    group: list[ActiveReason] = []
    for reason in (*reasons, None):
        if reason is not None and reason.follows_from:
            group.append(reason)
            continue
        bad = [one for one in group if one.severity >= severity]
        kept += [group[0], *(one for one in bad if one is not group[0])] if bad else []
        group = [] if reason is None else [reason]
    return tuple(kept)


def _key(reason: ActiveReason) -> _Key:
    return reason.cause, reason.subject
