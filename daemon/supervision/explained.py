"""Reasons in the words of the wire."""

from daemon.messages import Reason
from safety.failsafe import ActiveReason


def explained(reason: ActiveReason, t_ns: int) -> Reason:
    """One reason as operators and programs get it."""
    return Reason(
        name=reason.cause.value,
        severity=reason.cause.severity.name.lower(),
        subject=reason.subject,
        text=reason.cause.text,
        remedy=reason.cause.remedy,
        detail=reason.detail,
        since_s=round((t_ns - reason.since_ns) * 1e-9, 3),
        latched=reason.latched,
        follows_from=reason.follows_from,
        over=reason.over,
    )
