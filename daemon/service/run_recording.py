"""One recording for each time that the drives are energised, with its result beside it."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final

from daemon.recording.error_table import ErrorTable
from daemon.recording.flight_recorder import RecordingError
from daemon.recording.result import Result, write_result
from daemon.remote.messages import Event, Message, Tip
from daemon.service.robot_service import RobotService
from safety.causes import Severity, cause
from safety.states import OperatingState

_RUNNING: Final = OperatingState.RUNNING.value
_STOPS_THE_MOTION: Final = Severity.HOLD
_MOST_FAULTS: Final = 1000

MakeFolder = Callable[[], Awaitable[Path]]
"""Makes the folder of the next run, with all that explains the run in it. Raises OSError."""


class RunRecording:
    """Records from `begin` to `end`. Listens to everything that is published meanwhile."""

    def __init__(self, service: RobotService, make_folder: MakeFolder, seed: int) -> None:
        self.table = ErrorTable()
        self.folder: Path | None = None
        """Of the present run, or of the last one."""
        self._service = service
        self._recorder = service.surroundings.recorder
        self._make_folder = make_folder
        self._seed = seed
        self._recording = False
        self._faults: list[str] = []
        self._steps = self._refused_before = self._held_before = 0
        self._times_ns: tuple[int, int] | None = None
        """Of the first and the last step within a cycle."""
        self._followed = ("", "")
        self._ending: asyncio.Task[None] | None = None
        listeners = service.surroundings.listeners
        listeners.add(self._hear)
        listeners.add_for(Tip, self._hear_step)
        listeners.add_for(Event, self._hear_event)
        service.at_rest.append(self._end_soon)

    async def begin(self) -> None:
        """Start recording. Raises RecordingError."""
        await self.end()
        self.table = ErrorTable()
        self._faults, self._steps, self._times_ns = [], 0, None
        self._refused_before, self._held_before = self._service.loop.refusals, self._service.holds
        self._followed = ("", "")
        clock, robot = self._service.clock, self._service.robot
        try:
            self.folder = await self._make_folder()
        except OSError as error:
            raise RecordingError(f"no folder for the run: {error}") from None
        header = {"robot": robot.robot, "version": self._service.version, "seed": str(self._seed)}
        await self._recorder.start(self.folder, header, clock.now_ns(), clock.wall_time_ns())
        self._recording = True
        self._service.publish(self._service.status())

    async def end(self) -> None:
        """Finish the recording, and write its result. Does nothing when there is none."""
        if self._recording:
            self._end_soon()
        if self._ending is not None:
            await self._ending

    def result(self) -> Result:
        """The figures of the run so far."""
        service = self._service
        trajectory, controller = self._followed
        first_ns, last_ns = self._times_ns or (0, 0)
        return Result(
            robot=service.robot.robot,
            simulated=service.surroundings.simulated,
            trajectory=trajectory,
            controller=controller,
            seed=self._seed,
            duration_s=(last_ns - first_ns) * 1e-9,
            cycles=self.table.rows(),
            steps=self._steps,
            holds=service.holds - self._held_before,
            refusals=service.loop.refusals - self._refused_before,
            recordings_dropped=self._recorder.status.dropped,
            final_state=service.supervisor.state.value,
            faults=self._faults,
            timing=service.report.loop_status(service.clock.now_ns()),
        )

    def _end_soon(self) -> None:
        if self._recording:
            self._recording = False
            self._ending = asyncio.get_running_loop().create_task(self._end())

    async def _end(self) -> None:
        result = self.result()
        await self._recorder.stop()
        assert self.folder is not None
        write_result(self.folder, result)

    def _hear(self, message: Message) -> None:
        if self._recording:
            self._recorder.message(message)

    def _hear_event(self, event: Event) -> None:
        if self._recording and event.kind == "cause" and event.present:
            stops = cause(event.name).severity >= _STOPS_THE_MOTION
            if stops and len(self._faults) < _MOST_FAULTS:
                self._faults.append(event.name)

    def _hear_step(self, tip: Tip) -> None:
        if not self._recording or tip.state != _RUNNING:
            return
        self._steps += 1
        self.table.add(tip)
        if tip.cycle >= 0:
            first_ns, _ = self._times_ns or (tip.t_ns, 0)
            self._times_ns = first_ns, tip.t_ns
        if not self._followed[0]:
            reference = self._service.reference_status()
            if reference is not None:
                self._followed = reference.trajectory, reference.controller
