"""The buttons of the page, from what the daemon says of every command: drawn as they are told."""

from typing import Any, Final, NamedTuple

from daemon.dashboard.http_rules import may
from daemon.messages import Status


class _Look(NamedTuple):
    verb: str
    label: str
    hold_s: float = 0.0
    """For how long it has to be pressed: what makes the robot strong or move."""


_BUTTONS: Final = (
    _Look("arm", "Arm", 0.8),
    _Look("start", "Start"),
    _Look("hold", "Hold"),
    _Look("resume", "Resume"),
    _Look("disarm", "Disarm"),
    _Look("clear", "Clear"),
    _Look("home", "Home", 0.8),
)


def buttons(
    status: Status, role: str | None, in_control: bool, holder: str = ""
) -> list[dict[str, Any]]:
    """What the page draws. in_control: whether this page is. holder: who is, for people."""
    by_name = {verb.name: verb for verb in status.verbs}
    drawn = []
    for look in _BUTTONS:
        told = by_name.get(look.verb)
        why, helps = "", ""
        if not may(role, look.verb):
            why, helps = "viewers only watch", "Ask for an operator's link"
        elif not in_control:
            whose = f"{holder} is in control" if holder else "nobody is in control"
            why, helps = whose, "Take control first"
        elif told is None:
            why, helps = "the daemon does not know this command", "Update the daemon"
        elif not told.possible:
            why, helps = told.why_not, told.helps
        drawn.append(
            {
                "verb": look.verb,
                "label": look.label,
                "enabled": not why,
                "why": why,
                "helps": helps,
                "hold_s": look.hold_s,
            }
        )
    return drawn
