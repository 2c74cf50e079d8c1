"""What one browser is told, 30 times a second at most: the newest of everything, never a queue.

The buttons of the page are drawn as they are told: from what the daemon says of every command.
"""

import asyncio
from typing import Any, Final, NamedTuple

import msgspec
from aiohttp import web

from daemon.dashboard.http_rules import may
from daemon.dashboard.robot_link import RobotLink
from daemon.messages import Status

_EVERY_S: Final = 1.0 / 30.0
_MOST_WAITING_BYTES: Final = 65536
"""A browser that has not taken so much gets no more before it does."""
_EVENTS_AT_ONCE: Final = 100
_MESSAGES: Final = ("status", "tip", "axes", "risk", "loop", "body")


class PageSocket:
    """One WebSocket of one page."""

    def __init__(
        self, socket: web.WebSocketResponse, link: RobotLink, page: str, role: str
    ) -> None:
        self.dropped = 0
        """Frames that were not sent because the browser was too slow."""
        self._socket = socket
        self._link = link
        self._page = page
        self._role = role
        self._sent: dict[str, int] = {}
        self._events_sent = link.events_heard - len(link.events)

    async def feed(self, transport: asyncio.WriteTransport) -> None:
        """Until the socket closes."""
        while not self._socket.closed:
            if transport.get_write_buffer_size() > _MOST_WAITING_BYTES:
                self.dropped += 1
            else:
                await self._socket.send_bytes(msgspec.json.encode(self._frame()))
            await asyncio.sleep(_EVERY_S)

    def _frame(self) -> dict[str, Any]:
        link = self._link
        control = link.control.page
        frame: dict[str, Any] = {
            "age_s": asyncio.get_running_loop().time() - link.heard_s,
            "problem": link.problem,
            "in_control": bool(control) and control == self._page,
            "control_taken": bool(control),
            "role": self._role,
            "dropped": self.dropped,
        }
        for kind in _MESSAGES:
            count = link.counts.get(kind, 0)
            if count != self._sent.get(kind, 0):
                self._sent[kind] = count
                frame[kind] = link.newest[kind]
                if kind == "status":
                    frame["buttons"] = self._buttons(frame["in_control"])
        self._add_events(frame)
        return frame

    def _buttons(self, in_control: bool) -> list[dict[str, Any]]:
        status = self._link.status
        if status is None:
            return []
        holder = "another page" if self._link.control.page else status.lease.holder or ""
        return buttons(status, self._role, in_control, holder)

    def _add_events(self, frame: dict[str, Any]) -> None:
        link = self._link
        new = min(link.events_heard - self._events_sent, len(link.events))
        if new > 0:
            first = len(link.events) - new
            told = list(link.events)[first : first + _EVENTS_AT_ONCE]
            frame["events"] = told
            self._events_sent = link.events_heard - new + len(told)


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
