"""A lab and the daemon as processes of their own, and a client that remembers what it was told."""

import asyncio
import re
import subprocess
import threading
import time
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, TypeVar

from daemon.messages import Event, Message, Refusal, Status
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import (
    ClientError,
    DisconnectedError,
    RefusedError,
    TimedOutError,
)
from daemon.robot.lab_connections import ask
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.hil.processes import PATIENCE_S, Lab, Process, command

T = TypeVar("T")
S = OperatingState

CIRCLE: Final = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 25.0,
    "cycle_s": 20.0,
    "cycles": 30,
}
MODEL: Final = {"kind": "constant_curvature"}
"""A controller that needs no exploration: motion begins at once."""

NODES: Final = range(1, 7)

_SOON_S: Final = 20.0
"""For what follows from what has happened; a busy machine may need some seconds for it."""
_LOOK_EVERY_S: Final = 0.02
_ENABLED: Final = "operation enabled"
_WITHOUT_TORQUE: Final = {
    "switch on disabled",
    "not ready to switch on",
    "ready to switch on",
    "switched on",
    "fault",
    "unknown",
}
_DEPTH: Final = 10_000


@dataclass(frozen=True)
class BusTimes:
    """The rhythm of the bus, and what follows from it: how soon a silent drive is missed."""

    cycle_period_s: float
    heartbeat_timeout_s: float
    """Of the drives, for their master."""
    patience_s: float = 0.4
    """Of everybody in emulation; 0: the times of a rig."""


AS_SHIPPED: Final = BusTimes(0.01, 0.2)
AS_ON_A_RIG: Final = BusTimes(0.01, 0.2, patience_s=0.0)
"""With drives that stop at the tenth SYNC that does not come."""
BEFORE_THE_DRIVES: Final = {"loop_fault_after_s": 0.09}
PATIENT: Final = BusTimes(0.02, 2.0)
"""Emulated drives that get no turn for a moment on a busy machine are not missed at once."""


def robot_file(folder: Path, bus: BusTimes, **supervision: float) -> Path:
    """The shipped robot with other times, as a file of its own."""
    text = SOFT_ARM.read_text()
    text = _replaced(text, "cycle_period_s", bus.cycle_period_s)
    text = _replaced(text, "master_heartbeat_timeout_s", bus.heartbeat_timeout_s)
    text, count = re.subn(r"(?m)^(emulation:.*)$", rf"\1\n  patience_s: {bus.patience_s}", text)
    assert count == 1
    for name, value in supervision.items():
        if f"  {name}:" in text:
            text = _replaced(text, name, value)
        else:
            text, count = re.subn(r"(?m)^(supervision:.*)$", rf"\1\n  {name}: {value}", text)
            assert count == 1
    path = folder / "robot.yaml"
    path.write_text(text)
    return path


def _replaced(text: str, name: str, value: float) -> str:
    text, count = re.subn(rf"(?m)^( +{name}:) [0-9.]+", rf"\1 {value}", text)
    assert count == 1, name
    return text


@contextmanager
def short_folder() -> Iterator[Path]:
    """The path of a unix socket has 107 bytes at most."""
    with TemporaryDirectory(prefix="t-", ignore_cleanup_errors=True) as name:
        yield Path(name)


class Daemon(Process):
    """`tentacled run` in a process of its own."""

    def __init__(self, folder: Path, robot: Path, program: list[str] | None = None) -> None:
        """program: what to run instead of the command itself."""
        where = [str(robot), "--runtime-dir", str(folder), "--runs", str(folder / "runs")]
        arguments = ["run", *where, "--no-real-time"]
        whole = command(*arguments) if program is None else [*program, *arguments]
        super().__init__(whole, stderr=subprocess.STDOUT)
        self.said: list[str] = []

    @property
    def pid(self) -> int:
        return self.process.pid

    def wait_until_it_speaks(self) -> None:
        """When its remote interface is open."""
        while "Ctrl-C ends it" not in (line := self.next_line()[1]):
            self.said.append(line)

    def recorder_pid(self) -> int | None:
        """Of its recorder process."""
        for folder in Path("/proc").iterdir():
            with suppress(OSError, ValueError):
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                if parent == self.pid and b"recorder_process" in (folder / "cmdline").read_bytes():
                    return int(folder.name)
        return None


class User:
    """A client on an event loop of its own, and everything that the daemon has told it."""

    def __init__(self, folder: Path) -> None:
        self.told: list[Message] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        try:
            self.client = self.do(self._connected(folder))
        except BaseException:
            self._end()
            raise

    def do(self, what: Coroutine[Any, Any, T]) -> T:
        """Raises ClientError."""
        return asyncio.run_coroutine_threadsafe(what, self._loop).result(PATIENCE_S)

    def refused(self, what: Coroutine[Any, Any, object]) -> Refusal:
        """A command that must not be carried out."""
        try:
            answer = self.do(what)
        except RefusedError as error:
            return error.refusal
        raise AssertionError(f"it was not refused: {answer}")

    def stop_renewing(self) -> None:
        """As if this program hung: the lease is not renewed any more."""
        self.do(self.client._lease.stop())

    def close(self) -> None:
        """Hang up."""
        if not self._loop.is_closed():
            with suppress(ClientError):
                self.do(self._disconnected())
            self._end()

    async def _connected(self, folder: Path) -> RobotClient:
        client = await RobotClient.connect(LocalAddress.in_folder(folder), wait_s=PATIENCE_S)
        self._listening = asyncio.create_task(self._listen(client))
        return client

    async def _listen(self, client: RobotClient) -> None:
        subscription = client.subscribe(("event",), _DEPTH)
        while True:
            try:
                self.told.append(await anext(subscription))
            except DisconnectedError:  # it may come back
                await asyncio.sleep(_LOOK_EVERY_S)

    async def _disconnected(self) -> None:
        self._listening.cancel()
        await asyncio.gather(self._listening, return_exceptions=True)
        await self.client.close()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class Rig:
    """A robot in use: its lab, its daemon and who operates it."""

    def __init__(self, folder: Path, robot: Path, program: list[str] | None = None) -> None:
        """program: what to run instead of the daemon's own command."""
        self.folder = folder
        self.robot = robot
        self._program = program
        self._seen = 0
        self._faults_end_s = 0.0
        self.lab = Lab(folder, robot=robot)
        try:
            self.lab.next_line()
            self._start()
        except BaseException:
            self.lab.leave()
            raise

    def _start(self) -> None:
        self.daemon = Daemon(self.folder, self.robot, program=self._program)
        try:
            self.daemon.wait_until_it_speaks()
            self.user = User(self.folder)
        except BaseException:
            self.daemon.leave()
            raise
        self._seen = 0

    def start_daemon_again(self) -> None:
        """A new one, in the place of the old one."""
        self.user.close()
        self.daemon.leave()
        self._start()

    def start_lab_again(self) -> None:
        """A new one, in the place of the old one."""
        self.lab.leave()
        self.lab = Lab(self.folder, robot=self.robot)
        self.lab.next_line()

    def leave(self) -> None:
        """Whatever has happened, nothing is left of it."""
        try:
            self.user.close()
        finally:
            self.daemon.leave()
            self.lab.leave()

    @property
    def client(self) -> RobotClient:
        return self.user.client

    @property
    def works(self) -> bool:
        """Whether both processes are there."""
        return self.lab.process.poll() is None and self.daemon.process.poll() is None

    # What it says.

    def status(self) -> Status:
        """Asked for again where the connection is away for a moment."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self.user.do(self.client.status())
            except (DisconnectedError, TimedOutError):
                if time.monotonic() > deadline_s or not self.works:
                    raise
                time.sleep(_LOOK_EVERY_S)

    @property
    def state(self) -> S:
        return S(self.status().state)

    def causes(self) -> set[str]:
        """The names of what is wrong now."""
        return {reason.name for reason in self.status().reasons}

    def from_now_on(self) -> None:
        """Events before this moment do not count."""
        self._seen = len(self.user.told)

    def events(self, kind: str, name: str) -> list[Event]:
        """Those of that name that came."""
        told = self.user.told[self._seen :]
        events = [message for message in told if isinstance(message, Event)]
        return [e for e in events if (e.kind, e.name, e.present) == (kind, name, True)]

    def until(self, wanted: Callable[[], bool], within_s: float = _SOON_S) -> None:
        deadline_s = time.monotonic() + within_s
        while not wanted():
            if time.monotonic() > deadline_s:
                told = [f"{e.kind} {e.name}" for e in self.user.told[self._seen :][-20:]]  # type: ignore[attr-defined]
                raise AssertionError(f"not in time: {self.state}, {self.causes()}, {told}")
            time.sleep(_LOOK_EVERY_S)

    def until_told(self, name: str, within_s: float = _SOON_S) -> Event:
        """Of a cause."""
        self.until(lambda: bool(self.events("cause", name)), within_s)
        return self.events("cause", name)[0]

    def until_state(self, *states: S, within_s: float = _SOON_S) -> None:
        """Until it is in one of them. For one that may pass quickly, `until_it_was` is better."""
        self.until(lambda: self.state in states, within_s)

    def until_it_was(self, *states: S, within_s: float = _SOON_S) -> None:
        """Until it has told that it went into one of these states."""
        self.until(lambda: any(self.events("state", s.value) for s in states), within_s)

    def until_without_torque(self, within_s: float = _SOON_S) -> None:
        """Until no drive that is heard has torque."""
        self.until(lambda: self.drive_states() <= _WITHOUT_TORQUE, within_s)

    def drive_states(self) -> set[str]:
        return {axis.drive_state for axis in self.status().axes}

    @property
    def energised(self) -> bool:
        """Whether all drives follow."""
        return self.drive_states() == {_ENABLED}

    def actuators(self) -> list[float]:
        """Where the emulated shafts really are, in the axes' own units."""
        return list(ask(self.folder, {"do": "state"})["actuators"])

    # What it is told.

    def inject(self, fault: str) -> None:
        """At the lab itself, so that the daemon knows nothing of it."""
        ask(self.folder, {"do": "inject", "faults": [fault]})
        lasts = re.search(r"=([0-9.]+)s", fault)
        end_s = time.monotonic() + (float(lasts[1]) if lasts else 0.0)
        self._faults_end_s = max(self._faults_end_s, end_s)

    def without_faults(self) -> "Rig":
        """This one, once everything that was injected for a time is over."""
        time.sleep(max(0.0, self._faults_end_s - time.monotonic()))
        return self

    def ready(self) -> None:
        """Bring it to READY from whatever state, as an operator would."""
        deadline_s = time.monotonic() + PATIENCE_S
        while (state := self.state) is not S.READY:
            assert time.monotonic() < deadline_s, f"{state}, {self.status().reasons}"
            self._acquire()
            with suppress(RefusedError, TimedOutError):
                if state.energised:
                    self.user.do(self.client.stop())
                else:
                    self.user.do(self.client.clear())
            time.sleep(0.1)

    def armed(self, *, despite_contact: bool = False) -> None:
        """Bring it to ARMED, with nothing that stands in the way of moving."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            assert time.monotonic() < deadline_s, f"{self.state}, {self.status().reasons}"
            self.ready()
            self._acquire()
            with suppress(RefusedError):
                self.user.do(self.client.arm(despite_contact=despite_contact))
                return

    def running(self) -> None:
        """Bring it to RUNNING round the circle, with its shafts moving."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            assert time.monotonic() < deadline_s, f"{self.state}, {self.status().reasons}"
            if self.state is not S.RUNNING or self.causes():
                self.armed()
                with suppress(RefusedError):
                    self.user.do(self.client.load(CIRCLE, MODEL))
                    self.user.do(self.client.start())
            if self._moves():
                self.from_now_on()
                return

    def resumed(self) -> None:
        """Go on, as soon as what has stopped it is over."""
        deadline_s = time.monotonic() + PATIENCE_S
        while self.state is not S.RUNNING:
            assert time.monotonic() < deadline_s, f"{self.state}, {self.status().reasons}"
            self._acquire()
            with suppress(RefusedError):
                self.user.do(self.client.resume())
            time.sleep(0.1)

    def _acquire(self) -> None:
        """Take the lease, also while one that was lost runs out, and where the client has not heard
        yet that it has."""
        with suppress(RefusedError):
            lost = not self.client._lease.token or self.client.lease_lost is not None
            if lost or self.status().lease.holder is None:
                self.user.do(self.client.acquire())

    def _moves(self) -> bool:
        before = self.actuators()
        for _ in range(40):
            time.sleep(0.05)
            if self.state is not S.RUNNING:
                return False
            if farthest(before, self.actuators()) > 0.2:
                return True
        return False


def farthest(before: list[float], after: list[float]) -> float:
    """The longest way of all axes."""
    return max(abs(a - b) for a, b in zip(after, before, strict=True))


@contextmanager
def rig(
    bus: BusTimes,
    supervision: Mapping[str, float] | None = None,
    program: list[str] | None = None,
) -> Iterator[Rig]:
    """Everything, in a folder of its own."""
    with short_folder() as folder:
        robot = robot_file(folder, bus, **(supervision or {}))
        one = Rig(folder, robot, program)
        try:
            yield one
        finally:
            one.leave()
