"""One recording for each time that the drives are energised, with its result beside it."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Final

from daemon.files import write_whole
from daemon.messages import Event, Message, Tip
from daemon.recording.flight_recorder import RecordingError
from daemon.recording.result import ErrorTable, Result, write_result
from daemon.recording.run_folder import VIRTUAL_TIME, segment_file
from daemon.service.monitors import NO_TROUBLE, RecordingTrouble
from daemon.service.motion_loader import OffTheLoop, at_once
from daemon.service.robot_service import RobotService
from drivers.clock import is_virtual
from safety.causes import Severity, cause
from safety.states import OperatingState

_RUNNING: Final = OperatingState.RUNNING.value
_STOPS_THE_MOTION: Final = Severity.HOLD
_MOST_FAULTS: Final = 1000
_RESTART_AFTER_S: Final = (0.0, 0.5, 2.0)
"""Waiting before each attempt to begin a lost recording again, all through a run. A process starts
in a second; what has killed three of them kills the fourth."""

MakeFolder = Callable[[], Awaitable[Path]]
"""Makes the folder of the next run, with all that explains the run in it. Raises OSError."""


class RunRecording:
    """Records from `begin` to `end`. Listens to everything that is published meanwhile."""

    def __init__(
        self,
        service: RobotService,
        make_folder: MakeFolder,
        seed: int,
        off_the_loop: OffTheLoop = at_once,
    ) -> None:
        """off_the_loop: how the result is written, for which a disk may take its time."""
        self.table = ErrorTable()
        self.folder: Path | None = None
        """Of the present run, or of the last one."""
        self.begun: list[Callable[[], None]] = []
        """Called whenever a recording has begun."""
        self._service = service
        self._recorder = service.dependencies.recorder
        self._make_folder = make_folder
        self._seed = seed
        self._off_the_loop = off_the_loop
        self._recording = False
        self._faults: list[str] = []
        self._steps = self._refused_before = self._held_before = 0
        self._times_ns: tuple[int, int] | None = None
        """Of the first and the last step within a cycle."""
        self._followed = ("", "")
        self._ending: asyncio.Task[None] | None = None
        self._restarting: asyncio.Task[None] | None = None
        self._restarts = self._segment = 0
        self._lost = ""
        """Why the recording was given up; empty: it was not."""
        self._dropped_when_well = 0
        subscribers = service.dependencies.subscribers
        subscribers.add(self._hear)
        subscribers.add_for(Tip, self._hear_step)
        subscribers.add_for(Event, self._hear_event)
        service.at_rest.append(self._end_soon)
        service.monitors.watch(self)

    async def begin(self) -> None:
        """Start recording. Raises RecordingError."""
        await self.end()
        self.table = ErrorTable()
        self._faults, self._steps, self._times_ns = [], 0, None
        self._refused_before = self._service.loop.reasons.refusals
        self._held_before = self._service.holds
        self._followed = ("", "")
        self._restarts, self._segment, self._lost = 0, 1, ""
        self._dropped_when_well = 0
        try:
            self.folder = await self._make_folder()
        except OSError as error:
            raise RecordingError(f"no folder for the run: {error}") from None
        await self._start(self.folder)
        self._recording = True
        self._tell_begun()
        self._service.publish(self._service.status())

    async def keep(self, name: str, content: bytes) -> None:
        """Put a file beside the recording, if there is one."""
        folder = self.folder
        if not self._recording or folder is None:
            return
        try:
            await self._off_the_loop(lambda: write_whole(folder / name, content))
        except (OSError, TimeoutError) as error:
            self._tell("not_kept", f"{name} cannot be written beside the recording: {error}")

    def look(self) -> RecordingTrouble:
        """What is wrong with the recording; one that is lost is begun again. Called often."""
        if not self._recording:
            return NO_TROUBLE
        status = self._recorder.status
        if status.lost and not self._lost and self._restarting is None:
            task = asyncio.get_running_loop().create_task(self._restart(status.failed))
            self._restarting = task
        if not status.failed:
            self._dropped_when_well = status.dropped
        # A disk that takes nothing may go on in a moment: until then a recorder keeps what it can.
        # What is missing where a recorder died is the gap that it is begun again after.
        begun_again = status.lost or self._restarting is not None
        silent = not begun_again and status.dropped > self._dropped_when_well
        missing = status.failed if silent else ""
        return RecordingTrouble(status.failed or self._lost, self._lost or missing)

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
            simulated=service.dependencies.simulated,
            trajectory=trajectory,
            controller=controller,
            seed=self._seed,
            duration_s=(last_ns - first_ns) * 1e-9,
            cycles=self.table.rows(),
            steps=self._steps,
            holds=service.holds - self._held_before,
            refusals=service.loop.reasons.refusals - self._refused_before,
            recordings_dropped=self._recorder.status.dropped,
            final_state=service.supervisor.state.value,
            faults=self._faults,
            timing=None
            if is_virtual(service.clock)
            else service.report.loop_status(service.clock.now_ns()),
            virtual_time=is_virtual(service.clock),
        )

    def _end_soon(self) -> None:
        if self._recording:
            self._recording = False
            self._ending = asyncio.get_running_loop().create_task(self._end())

    async def _end(self) -> None:
        if self._restarting is not None:
            await self._restarting
        result = self.result()
        await self._recorder.stop()
        assert self.folder is not None
        try:
            await self._off_the_loop(partial(write_result, self.folder, result))
        except OSError as error:  # the folder is gone, the disk is full, or takes too long
            self._tell("no_result", f"the run's result cannot be written: {error}")

    async def _start(self, folder: Path) -> None:
        """Raises RecordingError."""
        clock, robot = self._service.clock, self._service.robot
        header = {"robot": robot.robot, "version": self._service.version, "seed": str(self._seed)}
        if is_virtual(clock):
            header["time"] = VIRTUAL_TIME
        if self._restarts:
            header["goes_on_after_gap"] = str(self._restarts)
        name = segment_file(self._segment)
        await self._recorder.start(folder, header, clock.now_ns(), clock.wall_time_ns(), name)

    async def _restart(self, why: str) -> None:
        """Go on in a new file, some attempts long. What happens meanwhile is in neither."""
        clock = self._service.clock
        began_ns = clock.now_ns()
        self._tell("recorder_lost", f"{why}: it is started again")
        try:
            while self._recording and self._restarts < len(_RESTART_AFTER_S):
                await asyncio.sleep(_RESTART_AFTER_S[self._restarts])
                self._restarts += 1
                try:
                    await self._begin_segment()
                except (RecordingError, OSError) as error:
                    why = str(error)
                    continue
                gap_s = (clock.now_ns() - began_ns) * 1e-9
                text = f"recording goes on in {self._recorded_in}, {gap_s:.1f} s are missing"
                self._tell("recording_gap", text)
                return
            self._lost = why
        finally:
            self._restarting = None

    async def _begin_segment(self) -> None:
        """Raises RecordingError, OSError."""
        await self._recorder.stop()
        assert self.folder is not None
        self._segment += 1
        if self._restarts > 1:  # where the last attempt has failed, the folder may be gone
            folder = await self._make_folder()
            if folder != self.folder:
                self.folder, self._segment = folder, 1
        await self._start(self.folder)
        if self._segment == 1:
            self._tell_begun()

    def _tell_begun(self) -> None:
        """A recording in a folder of its own is explained by what is in it."""
        for listener in self.begun:
            listener()

    @property
    def _recorded_in(self) -> str:
        assert self.folder is not None
        return str(self.folder / segment_file(self._segment))

    def _tell(self, name: str, text: str) -> None:
        self._service.events.tell("note", name, text, subject="recorder")

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
            reference = self._service.following.status()
            if reference is not None:
                self._followed = reference.trajectory, reference.controller
