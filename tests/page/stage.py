"""A made-up robot behind the real wire, and the page's real server in a process of its own.

The robot follows whatever it is told and keeps count of it: for what a page does, and quickly. The
whole story with real loops and devices is in `test_story`.
"""

import asyncio
import math
import os
import threading
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

from daemon.messages import (
    COMMANDS,
    Answer,
    Axes,
    AxisStatus,
    Body,
    Command,
    Component,
    Event,
    Reason,
    ReferenceStatus,
    Refusal,
    Risk,
    Setpoint,
    SetpointRefused,
    Status,
    Tip,
    Verb,
    verb,
)
from daemon.remote.server.server import RemoteServer
from daemon.remote.surroundings import cut_surroundings
from daemon.service.lease import Lease
from tests.daemon.remote.rig import ROBOT, FakeRobot, serving
from tests.hil.daemon_rig import short_folder
from tests.hil.processes import PATIENCE_S, Process, command

T = TypeVar("T")
_STEP_S: Final = 0.025
_STATUS_EVERY: Final = 4
_LATE_S: Final = 0.25
_SPEED_MM_S: Final = 15.0
_AXES: Final = ("east", "north", "west")
_WORKSPACE: Final = [[-60.0, 60.0], [-60.0, 60.0], [60.0, 140.0]]


class StagedRobot(FakeRobot):
    """Follows set-points as the daemon does: at 15 mm/s, and holds where they grow old."""

    def __init__(self, lease_s: float = 60.0) -> None:
        super().__init__(lease_s)
        self._lease_s = lease_s
        self.state = "ready"
        self.tip = np.array([0.0, 0.0, 100.0])
        self.came_s: list[float] = []
        """When each set-point came, monotonic."""
        self.events: list[Event] = []
        self.reasons: list[Reason] = []
        self.settles = False
        """Whether what is held stands armed as soon as nothing is against it: so does a daemon."""
        self.steps = True
        """Whether it tells of steps: a robot that stands does not."""
        self.aside: dict[str, Any] = {}
        """What each step's risk says of what it was turned aside for."""
        self.room_sha256 = ""
        self.workspace_mm = _WORKSPACE
        self.moving_mm: list[list[float]] = []
        """Where obstacles that move may be."""
        self.remote: RemoteServer | None = None
        self._following = ""
        self._begun_s = 0.0

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        answer = await super().handle(user, command)
        if isinstance(answer, Refusal):
            return answer
        word = verb(command)
        into = {"arm": "armed", "start": "running", "teleoperate": "running", "hold": "hold"}
        into |= {"resume": "running", "stop": "ready", "disarm": "ready"}
        if word in into:
            self._go(into[word])
        if word in ("start", "teleoperate"):
            self._following, self._begun_s, self._sequence = word, time.monotonic(), -1
        if word != "acquire":
            self.tell("command", word, f"{user} asks for it")
        return msgspec.structs.replace(answer, state=self.state)

    def setpoint(self, user: str, setpoint: Setpoint) -> SetpointRefused | None:
        self.came_s.append(time.monotonic())
        return super().setpoint(user, setpoint)

    def begin_anew(self) -> None:
        """As it was at first, whatever the last test has left."""
        self.state, self.reasons, self._following = "ready", [], ""
        self.aside, self.settles, self.moving_mm = {}, False, []
        self.workspace_mm, self.steps = _WORKSPACE, True
        self.lease = Lease(self._lease_s)
        self.tip = np.array([0.0, 0.0, 100.0])
        for kept in (self.carried_out, self.setpoints, self.came_s, self.stopped_ns):
            kept.clear()

    def _go(self, state: str) -> None:
        if state != self.state:
            self.state = state
            self._begun_s = time.monotonic()
            self.tell("state", state, f"the robot is {state} now")

    def tell(self, kind: str, name: str, text: str) -> None:
        number, now_ns = len(self.events) + 1, self.clock.now_ns()
        self.events.append(
            Event(
                sequence=number,
                t_ns=now_ns,
                kind=kind,
                name=name,
                subject="robot",
                present=True,
                text=text,
            )
        )

    def step(self) -> None:
        """One control step."""
        now_s = time.monotonic()
        if (
            self.state in ("running", "armed", "hold")
            and self.lease.holder(self.clock.now_ns()) is None
        ):
            self._go("hold")
        elif self.settles and self.state == "hold":
            self._go("armed")
        if self.state != "running" or not self._following:
            return
        if self._following == "start":
            angle = 0.5 * (now_s - self._begun_s)
            self.tip = np.array([25 * math.sin(angle), 25 * math.cos(angle), 100.0])
            return
        newest_s = self.came_s[-1] if self.came_s else 0.0
        if now_s - max(newest_s, self._begun_s) > _LATE_S:
            self._go("hold")
        elif self.setpoints and newest_s > self._begun_s - _LATE_S:
            way = np.array(self.setpoints[-1][1].position_mm) - self.tip
            distance = float(np.linalg.norm(way))
            if distance > 0.0:
                self.tip = self.tip + way * min(1.0, _SPEED_MM_S * _STEP_S / distance)

    def status(self) -> Status:
        energised = self.state in ("armed", "running", "hold")
        followed = {"start": "circle", "teleoperate": "set-points"}.get(self._following)
        told = super().status()
        return msgspec.structs.replace(
            told,
            risk=msgspec.structs.replace(
                told.risk, surroundings_sha256=self.room_sha256, moving_mm=self.moving_mm
            ),
            state=self.state,
            tip_mm=self.tip.tolist(),
            reasons=self.reasons,
            axes=[_axis(name) for name in _AXES],
            verbs=[
                Verb(
                    name=verb(kind),
                    needs_lease=True,
                    possible=_possible(verb(kind), self.state),
                    why_not=f"the robot is {self.state}",
                )
                for kind in COMMANDS
            ],
            reference=ReferenceStatus(
                trajectory=followed, controller="none", elapsed_s=0.0, cycle=-1
            )
            if followed and energised
            else None,
        )

    def surrounded_by(self, *regions: dict[str, Any]) -> None:
        """Others, from this moment on. In the event loop."""
        assert self.remote is not None
        self.room_sha256 = f"{len(self.room_sha256)}{len(regions)}"
        room = cut_surroundings("", b"", self.workspace_mm, self.room_sha256, regions)
        self.remote.show(room)

    def told(self, number: int) -> Sequence[Any]:
        """What is published of one step."""
        now_ns, (x, y, _) = self.clock.now_ns(), self.tip.tolist()
        along = np.linspace(0.0, 1.0, 16)
        told: list[Any] = [
            Tip(
                sequence=number,
                t_ns=now_ns,
                state=self.state,
                tip_mm=self.tip.tolist(),
                reference_mm=(self.tip + 0.5).tolist() if self.state == "running" else None,
                error_mm=0.8 if self.state == "running" else None,
                cycle=0 if self.state == "running" else -1,
            ),
            Axes(
                sequence=number,
                t_ns=now_ns,
                actual=[0.0] * 3,
                target=[0.0] * 3,
                force=[8.0, 9.0, 10.0],
            ),
        ]
        if self.steps:
            told.append(
                Risk(
                    sequence=number,
                    t_ns=now_ns,
                    source="mixture",
                    contact_risk=0.02,
                    threshold=0.05,
                    scale=1.0,
                    reasons=[],
                    clearance_mm=9.0,
                    place_mm=[x, y, 90.0],
                    obstacle_mm=[x + 9.0, y, 90.0],
                    **self.aside,
                )
            )
        if number % _STATUS_EVERY == 0:
            line = [[x * s * s, y * s * s, float(self.tip[2]) * s] for s in along.tolist()]
            shape = Component(weight=1.0, mean_mm=line[8], covariance_mm2=[30, 0, 0, 30, 0, 200])
            told += [
                self.status(),
                Body(
                    t_ns=now_ns,
                    source="model",
                    centreline_mm=line,
                    radius_mm=[8.0] * 16,
                    components=[shape],
                ),
            ]
        return told


def _possible(word: str, state: str) -> bool:
    return {
        "arm": state in ("ready", "standby"),
        "start": state == "armed",
        "teleoperate": state in ("armed", "hold"),
        "hold": state == "running",
        "resume": state == "hold",
        "disarm": state in ("armed", "hold", "running"),
    }.get(word, True)


def _axis(name: str) -> AxisStatus:
    return AxisStatus(
        name=name,
        unit="mm",
        actual=1.0,
        target=1.0,
        drive_state="operation enabled",
        node_state="operational",
        force=9.0,
        force_unit="N",
        force_range=[2.0, 60.0],
    )


class Stage:
    """The robot on an event loop of its own, and the page's server as a process."""

    def __init__(self, folder: Path, *options: str, lease_s: float = 60.0) -> None:
        """options: of `tentacled dashboard`."""
        self.folder = folder
        self.robot = StagedRobot(lease_s)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._playing: asyncio.Task[None] | None = None
        self._others: list[asyncio.Task[None]] = []
        self.open_robot()
        where = ["--runtime-dir", str(folder), "--runs", str(folder / "runs")]
        others = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
        words = command("dashboard", *where, "--port", "0", *options)
        self.server = Process(words, env=others)
        try:
            self.address = self.server.next_line()[1].split()[1]
            self.viewer = self.server.next_line()[1].split()[1]
        except BaseException:
            self.leave()
            raise
        self.base = self.address.partition("?")[0]

    def open_robot(self) -> None:
        """Let it be there, or be there again."""
        opened = asyncio.Event()

        async def begin() -> None:
            self._playing = asyncio.create_task(_play(self.folder, self.robot, ROBOT, opened))
            await asyncio.wait_for(opened.wait(), PATIENCE_S)

        self.do(begin())

    def add_robot(self, name: str) -> StagedRobot:
        """Another one, where daemons of this machine are found by themselves."""
        robot, opened = StagedRobot(), asyncio.Event()
        folder = self.folder / "tentacled" / name
        folder.mkdir(parents=True)

        async def begin() -> None:
            self._others.append(asyncio.create_task(_play(folder, robot, name, opened)))
            await asyncio.wait_for(opened.wait(), PATIENCE_S)

        self.do(begin())
        return robot

    def close_robot(self) -> None:
        """Let it be gone, as a daemon that has died."""

        async def end() -> None:
            tasks = [task for task in (self._playing, *self._others) if task is not None]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

        self.do(end())

    def begin_anew(self) -> None:
        """There, and as it was at first: also where a test has failed while it was gone."""
        self.robot.begin_anew()
        if self._playing is None or self._playing.done():
            self.open_robot()

    def do(self, what: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(what, self._loop).result(PATIENCE_S)

    def call(self, what: Callable[[], None]) -> None:
        """In the robot's own event loop."""

        async def called() -> None:
            what()

        self.do(called())

    def leave(self) -> None:
        """Whatever has happened, nothing is left of it."""
        self.server.leave()
        self.close_robot()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _play(folder: Path, robot: StagedRobot, name: str, opened: asyncio.Event) -> None:
    """Behind the wire, until it is cancelled."""
    surroundings = cut_surroundings("", b"", robot.workspace_mm)
    async with serving(folder, robot, surroundings=surroundings, name=name) as (remote, _):
        robot.remote = remote
        opened.set()
        number, heard = 0, 0
        while True:
            number += 1
            robot.step()
            for message in robot.told(number):
                remote.publish(message)
            for event in robot.events[heard:]:
                remote.publish(event)
            heard = len(robot.events)
            await asyncio.sleep(_STEP_S)


@contextmanager
def stage(*options: str, lease_s: float = 60.0) -> Iterator[Stage]:
    """options: of `tentacled dashboard`."""
    with short_folder() as folder:
        one = Stage(folder, *options, lease_s=lease_s)
        try:
            yield one
        finally:
            one.leave()
