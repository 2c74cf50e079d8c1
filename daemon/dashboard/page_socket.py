"""What one browser is told, with every step of the robot's: the newest of everything, no queue.

The buttons of the page are drawn as they are told: from what the daemon says of every command.
"""

import asyncio
from collections import deque
from math import inf
from typing import Any, Final, NamedTuple

import msgspec
from aiohttp import web

from daemon.dashboard.http_rules import may
from daemon.dashboard.robot_link import RobotLink
from daemon.host.clock import MonotonicClock
from daemon.messages import Status, Tip
from daemon.remote.access import OPERATOR

_CLOCK: Final = MonotonicClock()
_EVERY_S: Final = 1.0 / 30.0
"""So often where no tip comes, ..."""
_AT_LEAST_S: Final = 0.02
"""... and with each tip, but never so soon after the last one."""
_MOST_WAITING_BYTES: Final = 65536
"""A browser that has not taken so much gets no more before it does, ..."""
_MOST_WAITING: Final = 4
"""... nor one that has so many frames still before it: what waits on the way to it, in buffers that
nobody sees, would be told to somebody late, and as if it were now."""
_EVENTS_AT_ONCE: Final = 100
_PICTURES_KNOWN: Final = 90
"""Three seconds of frames: of older ones only that they are old is of interest."""
_MESSAGES: Final = ("status", "tip", "axes", "risk", "loop", "body")


class _Said(msgspec.Struct):
    """What a page says beside its heartbeat."""

    set: tuple[float, float, float] | None = None
    """Where its hand leads the tip, mm."""
    seen: int = -1
    """Number of the frame that was in the picture when it was made."""
    grab: bool = False
    """Whether the hand has just taken hold."""
    let_go: bool = False
    got: int = -1
    """Number of the newest frame that it has shown."""


_SAID: Final = msgspec.json.Decoder(_Said)


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
        self._cycles_sent = -1
        self._surroundings_sent = 0
        self._number = 0
        self._pictures: deque[tuple[int, float]] = deque(maxlen=_PICTURES_KNOWN)
        """Numbers of the last frames, and when what they show was heard."""
        self._not_led = ""
        self._got = 0
        """The newest frame that the page has shown; 0: it does not say such things."""
        self._events_sent = link.events_heard - len(link.events)

    async def feed(self, transport: asyncio.WriteTransport) -> None:
        """Until the socket closes."""
        loop = asyncio.get_running_loop()
        while not self._socket.closed:
            due_s = loop.time() + _AT_LEAST_S
            behind = self._got > 0 and self._number - self._got >= _MOST_WAITING
            if behind or transport.get_write_buffer_size() > _MOST_WAITING_BYTES:
                self.dropped += 1
            else:
                await self._socket.send_bytes(msgspec.json.encode(self._frame()))
            await self._link.tip_comes(_EVERY_S)
            await asyncio.sleep(due_s - loop.time())

    def hear(self, text: str) -> None:
        """What the page says. Who only watches commands nothing."""
        operates = self._role == OPERATOR
        if text == "heart":
            if operates:
                self._link.heard(self._page)
            return
        try:
            said = _SAID.decode(text)
        except msgspec.DecodeError:
            return
        self._got = max(self._got, min(said.got, self._number))
        if not operates:
            return
        if said.let_go:
            self._link.let_go(self._page)
        elif said.set is not None:
            age_s = self._picture_s(said.seen)
            self._not_led = self._link.lead(self._page, said.set, age_s, said.grab)

    def _picture_s(self, number: int) -> float:
        """How long ago what the frame of that number shows was heard."""
        for known, heard_s in self._pictures:
            if known == number:
                return asyncio.get_running_loop().time() - heard_s
        return inf

    def _frame(self) -> dict[str, Any]:
        link = self._link
        self._number += 1
        self._pictures.append((self._number, link.heard_s))
        control = link.control.page
        frame: dict[str, Any] = {
            "n": self._number,
            "age_s": asyncio.get_running_loop().time() - link.heard_s,
            "problem": link.problem,
            "in_control": bool(control) and control == self._page,
            "control_taken": bool(control),
            "role": self._role,
            "hand": self._not_led or link.hand_refused,
            "dropped": self.dropped,
        }
        for kind in _MESSAGES:
            count = link.counts.get(kind, 0)
            if count != self._sent.get(kind, 0):
                self._sent[kind] = count
                frame[kind] = link.newest[kind]
                if kind == "status":
                    frame["buttons"] = self._buttons(frame["in_control"])
        self._add_age(frame)
        if link.cycles_counted != self._cycles_sent:
            self._cycles_sent = link.cycles_counted
            frame["cycles"] = link.cycles
        if link.surroundings_heard != self._surroundings_sent:
            self._surroundings_sent = link.surroundings_heard
            frame["surroundings"] = link.surroundings[0]
        self._add_events(frame)
        return frame

    @staticmethod
    def _add_age(frame: dict[str, Any]) -> None:
        """How old the tip is that is sent, on the clock that it shares with the daemon."""
        tip = frame.get("tip")
        if isinstance(tip, Tip):
            frame["tip_age_s"] = (_CLOCK.now_ns() - tip.t_ns) * 1e-9
            frame["sent_s"] = _CLOCK.wall_time_ns() * 1e-9

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
    _Look("teleoperate", "Begin"),
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
            why, helps = told.why_not or "not now", told.helps
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
