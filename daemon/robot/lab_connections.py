"""Devices in the same process, for virtual time: the same bytes, passed as calls."""

import asyncio
import json
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final

from config.robot import Robot
from config.tracker import Tracker
from daemon.host.periodic_timer import LoopTimer, PeriodicTimer, Tick
from daemon.robot.runtime_directory import CONTROL_SOCKET, lab_directories
from drivers.byte_stream import StreamOpener
from drivers.can.link import CanLink, FrameReceiver
from drivers.cia402.drive_bus import LinkOpener
from drivers.clock import Clock
from sim_backends.devices.aurora.wires import aurora_stream_opener
from sim_backends.devices.can.in_process import InProcessLink
from sim_backends.lab.lab import Lab

# Talks to a running lab over its control socket.


_ANSWERS_WITHIN_S: Final = 10.0
_LISTENS_EACH_S: Final = 0.25
_LONGEST_ANSWER_BYTES: Final = 1 << 20


class LabUnreachableError(RuntimeError):
    """There is no lab to talk to; the text says what to do."""


class LabRefusedError(RuntimeError):
    """The lab does not do what it was asked; the text is its reason."""


def ask(directory: Path, request: Mapping[str, Any]) -> Mapping[str, Any]:
    """Ask the lab in `directory`. Raises LabUnreachableError, LabRefusedError."""
    path = directory / CONTROL_SOCKET
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(_ANSWERS_WITHIN_S)
        try:
            connection.connect(str(path))
            connection.sendall(json.dumps(request).encode() + b"\n")
            line = _read_line(connection)
        except TimeoutError:
            raise LabUnreachableError(f"the lab at {directory} does not answer") from None
        except OSError as error:
            raise LabUnreachableError(
                f"no lab is running in {directory} ({error.strerror}): "
                "start one with `tentacled emulate`, or name its folder with --runtime-dir"
            ) from None
    answer: Mapping[str, Any] = json.loads(line)
    if not answer.get("ok"):
        raise LabRefusedError(str(answer.get("error")))
    return answer


def the_running_lab() -> Path:
    """The folder of the one lab that runs where labs run by default.

    Raises LabUnreachableError where there is none, or more than one.
    """
    running = [directory for directory in lab_directories() if _runs(directory)]
    if len(running) == 1:
        return running[0]
    if not running:
        raise LabUnreachableError("no lab is running: start one with `tentacled emulate`")
    names = ", ".join(str(directory) for directory in running)
    raise LabUnreachableError(f"several labs are running: name one with --runtime-dir: {names}")


def no_lab(directory: Path, robot_path: Path) -> str:
    """What to do where no lab runs in `directory`; empty: one does."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.setblocking(False)
        try:
            connection.connect(str(directory / CONTROL_SOCKET))
        except BlockingIOError:  # it has not come to answer yet
            return ""
        except OSError:
            return f"no lab is running in {directory}: `tentacled emulate {robot_path}` starts it"
    return ""


def _runs(directory: Path) -> bool:
    try:
        ask(directory, {"do": "state"})
    except (LabUnreachableError, LabRefusedError):
        return False
    return True


def _read_line(connection: socket.socket) -> bytes:
    line = b""
    while not line.endswith(b"\n"):
        piece = connection.recv(65536)
        if not piece or len(line) > _LONGEST_ANSWER_BYTES:
            raise ConnectionResetError(0, "it hung up")
        line += piece
    return line


class LabListener:
    """Hears what is done to a running lab: by a scenario, a tour, another program.

    In a thread of its own, which nobody waits for: a lab may stand still.
    """

    def __init__(self, directory: Path, heard: Callable[[str], None]) -> None:
        """heard: is called in the event loop that `start` is called in."""
        self._directory = directory
        self._heard = heard
        self._ended = Event()

    def start(self) -> None:
        """What was done before is not told."""
        loop = asyncio.get_running_loop()
        Thread(target=self._listen, args=(loop,), name="lab", daemon=True).start()

    def end(self) -> None:
        """From now on nothing is told."""
        self._ended.set()

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None:
        known: int | None = None
        while not self._ended.is_set():
            try:
                told = ask(self._directory, {"do": "diary", "after": known or 0})
            except (LabUnreachableError, LabRefusedError, ValueError):
                known = 0 if known is not None else None  # another lab may come: all of its own
            else:
                if known is not None and told["count"] >= known:
                    for _, text in told["entries"]:
                        self._tell(loop, text)
                known = told["count"]
            self._ended.wait(_LISTENS_EACH_S)

    def _tell(self, loop: asyncio.AbstractEventLoop, text: str) -> None:
        def tell() -> None:
            if not self._ended.is_set():
                self._heard(text)

        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(tell)


class LabConnections:
    """Connections to the devices of a `Lab` that was started in this process."""

    listens_first_s = 0.0
    """Nobody else can be there."""

    def __init__(self, lab: Lab, clock: Clock) -> None:
        self._lab = lab
        self._clock = clock

    def tracker(self, config: Tracker) -> StreamOpener:
        del config
        return aurora_stream_opener(self._lab.tracker, self._clock)

    def bus(self, name: str, robot: Robot) -> LinkOpener:
        queue_frames = robot.buses[name].tx_queue_frames

        async def open_bus(receiver: FrameReceiver) -> CanLink:
            bus, pump = self._lab.buses[name], self._lab.pumps[name]
            return InProcessLink(bus, pump, self._clock, receiver, queue_frames=queue_frames)

        return open_bus

    def timer(
        self, first_ns: int, period_ns: int, on_tick: Callable[[Tick], None]
    ) -> PeriodicTimer:
        return LoopTimer(first_ns, period_ns, on_tick)
