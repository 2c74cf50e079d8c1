"""One robot at work: service, recording and operator together, and the one way down.

Whatever ends it (a signal, the end of an experiment, an error, a cancellation), the drives come to
rest, the devices' tasks end, and the recording is whole, each within a bounded time.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

from config.loader import RobotFile
from config.robot import Robot
from daemon.host.stop_signals import StopSignals
from daemon.service.dependencies import Dependencies
from daemon.service.motion_loader import OffTheLoop, at_once
from daemon.service.operation.internal_errors import InternalErrors
from daemon.service.operation.operator import Operator
from daemon.service.operation.planning import PlanPath
from daemon.service.operation.run_recording import MakeFolder, RunRecording
from daemon.service.robot_service import RobotService
from drivers.bounded import end_tasks

_DEVICES_END_WITHIN_S: Final = 8.0
"""Longer than hardware takes at the most: its own parts are given 2 s each, one after the other."""
_RECORDING_ENDS_WITHIN_S: Final = 30.0
"""Longer than a recorder takes that is killed when it does not end, with a result on a slow disk:
only a disk that stands still takes more."""


class Session:
    """Made with nothing connected; `running` connects the devices for the length of a block."""

    def __init__(
        self,
        file: RobotFile,
        robot: Robot,
        dependencies: Dependencies,
        make_folder: MakeFolder,
        seed: int,
        *,
        inject: Callable[[str], Awaitable[None]] | None = None,
        files: Path | None = None,
        off_the_loop: OffTheLoop = at_once,
        plan_path: PlanPath | None = None,
    ) -> None:
        """robot: the file's, with its ports as they are to be opened. seed: of controllers.

        inject, files, off_the_loop, plan_path: as for `Operator` and `RunRecording`. Raises
        EdsError.
        """
        self._off_the_loop = off_the_loop
        self.service = RobotService(file, robot, dependencies)
        self.recording = RunRecording(self.service, make_folder, seed, off_the_loop)
        self.operator = Operator(
            self.service, self.recording, seed, inject, files, off_the_loop, file.path, plan_path
        )

    @asynccontextmanager
    async def running(self) -> AsyncIterator["asyncio.Task[None]"]:
        """The devices' own task. Should it have failed, its error is raised behind the block's end.

        Every end of the block is the same way down.
        """
        errors = InternalErrors(self.service.clock, self.service.publish, self._off_the_loop)
        errors.open()
        devices = asyncio.create_task(self.service.run())
        try:
            yield devices
        finally:
            await self._down(devices, errors)
        if devices.done() and not devices.cancelled():
            devices.result()

    async def serve(self, stop: StopSignals) -> None:
        """Until a signal ends it, or the devices' own task fails, whose error is raised."""
        async with self.running() as devices:
            ending = asyncio.create_task(stop.wait(None))
            try:
                await asyncio.wait((devices, ending), return_when=asyncio.FIRST_COMPLETED)
            finally:
                ending.cancel()

    async def _down(self, devices: "asyncio.Task[None]", errors: InternalErrors) -> None:
        """Each step is taken whatever becomes of the one before."""
        try:
            await self.service.rest()
        finally:
            try:
                await end_tasks([devices], _DEVICES_END_WITHIN_S)
            finally:
                try:
                    await errors.end()
                finally:
                    await self._end_recording()
                    self.operator.surrounding.close()

    async def _end_recording(self) -> None:
        # What was written until then is there, and recovery completes it.
        with suppress(TimeoutError):
            async with asyncio.timeout(_RECORDING_ENDS_WITHIN_S):
                await self.recording.end()
