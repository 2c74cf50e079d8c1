"""A scripted hand: what a device would send, in the kernel's bytes."""

import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from daemon.steering.devices import PROFILES
from daemon.steering.hand import HandSettings, Target, Triple
from daemon.steering.input_events import EV_KEY, EV_REL, InputEvent, packed
from daemon.steering.station import Station

DEAD_MAN: Final = InputEvent(EV_KEY, 0x100, 1)
LET_GO: Final = InputEvent(EV_KEY, 0x100, 0)
CLUTCH: Final = InputEvent(EV_KEY, 0x101, 1)
CLUTCH_OUT: Final = InputEvent(EV_KEY, 0x101, 0)
PERIOD_NS: Final = 25_000_000
TIP: Final = (10.0, 20.0, 150.0)
UP: Final = (0.0, 0.0, 1.0)


def push(code: int, counts: int) -> InputEvent:
    """A 3D mouse is pushed along one of its axes: 0 to 5."""
    return InputEvent(EV_REL, code, counts)


class Bench:
    """A station with time of its own; the tip stands wherever it is put."""

    def __init__(
        self,
        settings: HandSettings | None = None,
        profile: str = "3d_mouse",
        station: Station | None = None,
    ) -> None:
        self.station = station or Station(PROFILES[profile], settings or HandSettings())
        self.t_ns = 1_000_000_000
        self.tip: Triple = TIP
        self.direction: Triple | None = UP

    def say(self, *events: InputEvent) -> None:
        self.station.read(self.t_ns, packed(self.t_ns, *events))

    def step(self, *events: InputEvent) -> Target | None:
        """One period later, with what the device says then and where the tip is."""
        self.t_ns += PERIOD_NS
        if events:
            self.say(*events)
        self.station.tip(self.t_ns, self.tip, self.direction)
        return self.station.advance(self.t_ns)

    def steps(self, count: int, *events: InputEvent) -> Target | None:
        """So many, the device saying the same in each."""
        found = None
        for _ in range(count):
            found = self.step(*events)
        return found


class Puck:
    """A scripted 3D mouse at a pipe: it tells what it is pushed by every 20 ms, as a real one."""

    def __init__(self, path: Path) -> None:
        """Waits until somebody reads the pipe."""
        self._fd = os.open(path, os.O_WRONLY)
        self._keys: list[InputEvent] = []
        self._pushed = [0] * 6
        self._pulled = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)
        self._thread.start()

    def push(self, *counts: int) -> None:
        """Along x, y, z and about them from now on; none: not at all."""
        self._pushed = [*counts, *[0] * (6 - len(counts))]

    def key(self, event: InputEvent) -> None:
        """A key goes down or up."""
        self._keys.append(event)

    def pull_out(self) -> None:
        """It is unplugged."""
        self._pulled.set()
        self._thread.join()

    def _tell(self) -> None:
        with suppress(BrokenPipeError):
            while not self._pulled.wait(0.02):
                keys, self._keys = self._keys, []
                moved = [push(code, counts) for code, counts in enumerate(self._pushed) if counts]
                if keys or moved:
                    os.write(self._fd, packed(time.monotonic_ns(), *keys, *moved))
        os.close(self._fd)
