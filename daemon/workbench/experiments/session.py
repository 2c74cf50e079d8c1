"""A robot at work for the length of a block: service, recording and operator, and one way down."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Final

from config.loader import RobotFile
from config.robot import Robot
from daemon.service.operator import Operator
from daemon.service.robot_service import RobotService
from daemon.service.run_recording import MakeFolder, RunRecording
from daemon.service.surroundings import Surroundings
from drivers.bounded import end_tasks

_ENDS_WITHIN_S: Final = 8.0
"""Longer than hardware takes at the most."""


@dataclass(frozen=True)
class Session:
    """What there is while the devices are connected."""

    service: RobotService
    recording: RunRecording
    operator: Operator


@asynccontextmanager
async def session(
    file: RobotFile, robot: Robot, surroundings: Surroundings, make_folder: MakeFolder, seed: int
) -> AsyncIterator[Session]:
    """Connects the devices; in the end the drives are at rest and the recording is whole.

    robot: the file's, with its ports as they are to be opened. seed: of controllers.
    """
    service = RobotService(file, robot, surroundings)
    recording = RunRecording(service, make_folder, seed)
    operator = Operator(service, recording, seed, None)
    devices = asyncio.create_task(service.run())
    try:
        yield Session(service, recording, operator)
    finally:
        await service.rest()
        await end_tasks([devices], _ENDS_WITHIN_S)
        await recording.end()
