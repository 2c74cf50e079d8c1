"""Events of input devices as the Linux kernel gives them: `struct input_event`, <linux/input.h>.

Bytes go in as they are read, in pieces of any length; out come reports: what a device says at one
moment, up to its SYN_REPORT.
"""

import struct
from typing import Final, NamedTuple

EV_SYN, EV_KEY, EV_REL, EV_ABS = range(4)
SYN_REPORT, SYN_DROPPED = 0, 3

EVENT: Final = struct.Struct("@llHHi")
"""Seconds, microseconds, type, code, value, in the machine's own layout."""
_MOST_IN_A_REPORT: Final = 256
"""No device says more at once: the rest is noise."""


class InputEvent(NamedTuple):
    """type: EV_KEY, EV_REL or EV_ABS. code: which key or axis. value: of a key 1 down, 0 up, 2 held
    for long."""

    type: int
    code: int
    value: int


class Report(NamedTuple):
    """What a device says at one moment.

    lost: events were lost before it, so what was known of keys and axes may be out of date.
    """

    events: tuple[InputEvent, ...]
    lost: bool = False


class EventStream:
    """Bytes of one device."""

    def __init__(self) -> None:
        self._rest = b""
        self._events: list[InputEvent] = []
        self._lost = False

    def feed(self, data: bytes) -> list[Report]:
        """The reports that are complete with these bytes."""
        data = self._rest + data
        whole = len(data) - len(data) % EVENT.size
        self._rest = data[whole:]
        found = []
        for _, _, kind, code, value in EVENT.iter_unpack(data[:whole]):
            if kind != EV_SYN:
                self._take(InputEvent(kind, code, value))
            elif code == SYN_DROPPED:
                self._lost = True
            elif code == SYN_REPORT:
                found.append(Report(tuple(self._events), self._lost))
                self._events, self._lost = [], False
        return found

    def _take(self, event: InputEvent) -> None:
        if len(self._events) < _MOST_IN_A_REPORT:
            self._events.append(event)
        else:
            self._lost = True


def packed(t_ns: int, *events: InputEvent) -> bytes:
    """The bytes of one report, as a device sends it at `t_ns`."""
    seconds, micros = divmod(t_ns // 1000, 1_000_000)
    rows = [*events, InputEvent(EV_SYN, SYN_REPORT, 0)]
    return b"".join(EVENT.pack(seconds, micros, *row) for row in rows)
