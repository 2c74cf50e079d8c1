"""The whole daemon but for its clients' wire, with its lab, in virtual time."""

import asyncio
import tempfile
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from config.robot import Robot
from daemon.messages import (
    Acquire,
    Answer,
    Arm,
    Command,
    Event,
    Load,
    Message,
    Refusal,
    Start,
    Status,
    Tip,
)
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.flight_recorder import Recorder
from daemon.robot.checked_robot import check_robot
from daemon.robot.lab_connections import LabConnections
from daemon.service.dependencies import Dependencies
from daemon.service.operation.operator import Operator
from daemon.service.operation.planning import PlanPath
from daemon.service.operation.run_recording import RunRecording
from daemon.service.operation.session import Session
from daemon.service.robot_service import RobotService
from drivers.bounded import end_tasks
from drivers.cia402.power_state import PowerState
from safety.risk_source import NoModel, RiskSource
from safety.states import OperatingState
from sim_backends.lab.lab import Lab
from sim_backends.virtual_time import VirtualTimeLoop, run_in_virtual_time, virtual_clock
from tests import SOFT_ARM

T = TypeVar("T", bound=Command)

USER = "local"
SMALL_CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 10.0,
    "cycle_s": 20.0,
}
_LOOKS_EVERY_S = 0.005
"""Who waits: a fifth of a tracker's frame."""
MODEL = {"kind": "constant_curvature"}
"""A controller that needs no exploration: motion begins at once."""


@dataclass(repr=False)  # asyncio asks for it at the end of a run: of all that was ever told
class Rig:
    """A daemon in READY, and what it has told."""

    service: RobotService
    operator: Operator
    recording: RunRecording
    lab: Lab
    told: list[Message] = field(default_factory=list)
    told_events: list[Event] = field(default_factory=list)
    tips: list[Tip] = field(default_factory=list)
    """Those of what was told that are one: looked at again and again by who waits."""
    token: str = ""
    renewing: bool = True

    def hear(self, message: Message) -> None:
        self.told.append(message)
        if isinstance(message, Event):
            self.told_events.append(message)
        elif isinstance(message, Tip):
            self.tips.append(message)

    def forget(self) -> None:
        self.told.clear()
        self.told_events.clear()
        self.tips.clear()

    async def ask(self, command: Command) -> Answer | Refusal:
        """What the operator answers."""
        return await self.operator.handle(USER, command)

    async def do(self, kind: type[T], **fields: Any) -> Answer:
        """A command that must be carried out."""
        answer = await self.ask(kind(token=self.token, **fields))
        assert isinstance(answer, Answer), answer
        self.token = answer.token or self.token
        return answer

    async def refused(self, kind: type[T], **fields: Any) -> Refusal:
        """A command that must not be."""
        answer = await self.ask(kind(token=self.token, **fields))
        assert isinstance(answer, Refusal), answer
        return answer

    async def armed(self) -> None:
        await self.do(Acquire)
        await self.do(Arm)
        assert self.state is OperatingState.ARMED

    async def running(
        self,
        trajectory: dict[str, Any] = SMALL_CIRCLE,
        controller: dict[str, Any] = MODEL,
    ) -> None:
        await self.armed()
        await self.do(Load, trajectory=trajectory, controller=controller)
        await self.do(Start)
        await self.until(lambda: self.state is OperatingState.RUNNING)

    async def until(self, wanted: Callable[[], bool], within_s: float = 30.0) -> float:
        """How long it took."""
        began_ns = self.service.clock.now_ns()
        try:
            async with asyncio.timeout(within_s):
                while not wanted():
                    await asyncio.sleep(_LOOKS_EVERY_S)
        except TimeoutError:
            raise AssertionError(f"not within {within_s} s: {self.state}, {self.causes}") from None
        return (self.service.clock.now_ns() - began_ns) * 1e-9

    async def until_state(self, *states: OperatingState, within_s: float = 30.0) -> float:
        return await self.until(lambda: self.state in states, within_s)

    @property
    def state(self) -> OperatingState:
        return self.service.supervisor.state

    def in_state(self, *states: OperatingState) -> bool:
        return self.state in states

    @property
    def causes(self) -> set[str]:
        return {reason.cause.value for reason in self.service.supervisor.reasons}

    @property
    def status(self) -> Status:
        return self.service.status()

    def events(self, kind: str, name: str) -> list[Event]:
        """Everything of that name that came."""
        return [e for e in self.told_events if (e.kind, e.name) == (kind, name) and e.present]

    @property
    def power(self) -> set[PowerState]:
        """What the drives really are, as the master hears it."""
        return {channel.state for channel in self.service.loop.channels}

    def shafts(self) -> list[float]:
        """Where the shafts of the emulated drives really are, counts."""
        return [axis.position_counts for drive in self.lab.drives.values() for axis in drive.axes]


def stand_still(duration_s: float) -> None:
    """As where the process is stopped for a while: time goes on, and nothing runs meanwhile."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.jump(duration_s)


def on_a_rig(
    scene: Callable[[Rig], Coroutine[Any, Any, None]],
    *,
    path: Path = SOFT_ARM,
    change: Callable[[Robot], Robot] = lambda robot: robot,
    risk: RiskSource | None = None,
    folder: Path | None = None,
    seed: int = 1,
    begins_in: OperatingState = OperatingState.READY,
    recorder: Recorder | None = None,
    plan_path: PlanPath | None = None,
    files: Path | None = None,
) -> Rig:
    """Play `scene` with a daemon whose devices are set up. Everything is taken down afterwards."""
    with tempfile.TemporaryDirectory() as name:
        place = folder or Path(name)
        return run_in_virtual_time(
            _play(
                scene,
                path,
                change,
                risk or NoModel(),
                place,
                seed,
                begins_in,
                recorder or DirectRecorder(),
                plan_path,
                files,
            )
        )


async def _play(
    scene: Callable[[Rig], Coroutine[Any, Any, None]],
    path: Path,
    change: Callable[[Robot], Robot],
    risk: RiskSource,
    folder: Path,
    seed: int,
    begins_in: OperatingState,
    recorder: Recorder,
    plan_path: PlanPath | None,
    files: Path | None,
) -> Rig:
    file = check_robot(path).file
    robot = change(file.robot)
    clock = virtual_clock()
    lab = Lab(robot, path, clock, seed)
    lab.start()
    tokens = iter(range(1, 1_000_000))
    dependencies = Dependencies(
        LabConnections(lab, clock),
        clock,
        recorder,
        risk,
        simulated=True,
        new_token=lambda: f"token-{next(tokens)}",
    )

    async def make_folder() -> Path:
        return folder

    session = Session(
        file,
        robot,
        dependencies,
        make_folder,
        1,
        inject=_injector(lab),
        files=files,
        plan_path=plan_path,
    )
    rig = Rig(session.service, session.operator, session.recording, lab)
    dependencies.subscribers.add(rig.hear)
    renewing = asyncio.create_task(_renew(rig))
    try:
        async with session.running():
            at_first = {"not_referenced"}  # all else goes by itself as the devices come up
            await rig.until(
                lambda: rig.state is not OperatingState.STANDBY or rig.causes == at_first
            )
            await rig.until_state(begins_in)
            await scene(rig)
    finally:
        await end_tasks([renewing], 1.0)
        lab.stop()
    return rig


async def _renew(rig: Rig) -> None:
    while True:
        await asyncio.sleep(0.5)
        if rig.renewing and rig.token:
            answer = await rig.ask(Acquire(token=rig.token))
            if isinstance(answer, Answer) and answer.token:
                rig.token = answer.token  # another one, where the lease had run out meanwhile


def _injector(lab: Lab) -> Callable[[str], Coroutine[Any, Any, None]]:
    async def inject(fault: str) -> None:
        lab.inject(fault)

    return inject
