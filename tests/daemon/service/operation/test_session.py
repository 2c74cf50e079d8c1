"""There is one way down, whatever ends a robot's work: drives off, tasks ended, recording whole."""

import asyncio
from pathlib import Path

import pytest

from daemon.messages import Acquire, Arm
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.result import read_result
from daemon.robot.checked_robot import check_robot
from daemon.robot.lab_connections import LabConnections
from daemon.service.dependencies import Dependencies
from daemon.service.operation.session import Session
from safety.risk_source import NoModel
from safety.states import OperatingState
from sim_backends.lab.lab import Lab
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock
from tests import SOFT_ARM


class _Robot:
    """A session beside its emulated lab."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.clock = virtual_clock()
        self.file = check_robot(SOFT_ARM).file
        self.lab = Lab(self.file.robot, SOFT_ARM, self.clock, 1)
        self.lab.start()
        dependencies = Dependencies(
            LabConnections(self.lab, self.clock),
            self.clock,
            DirectRecorder(),
            NoModel(),
            simulated=True,
        )
        self.session = Session(self.file, self.file.robot, dependencies, self._make_folder, 1)

    async def _make_folder(self) -> Path:
        return self.folder

    async def armed(self) -> None:
        session = self.session
        while session.service.supervisor.state is not OperatingState.READY:
            await asyncio.sleep(0.01)
        taken = await session.operator.handle("local", Acquire())
        await session.operator.handle("local", Arm(token=getattr(taken, "token", "")))
        assert session.service.supervisor.state.energised

    def is_down(self) -> None:
        assert all(not axis.state.energised for axis in self.session.service.loop.channels)
        result = read_result(self.folder)
        assert result is not None
        assert result.final_state == OperatingState.READY.value
        self.lab.stop()


@pytest.mark.parametrize("end", ["error", "cancelled", "at its end"])
def test_however_it_ends_the_drives_are_off_and_the_recording_is_whole(
    end: str, tmp_path: Path
) -> None:
    async def work(robot: _Robot) -> None:
        async with robot.session.running():
            await robot.armed()
            if end == "error":
                raise RuntimeError("something else went wrong")
            if end == "cancelled":
                await asyncio.Event().wait()

    async def scene() -> None:
        robot = _Robot(tmp_path)
        working = asyncio.create_task(work(robot))
        await asyncio.sleep(60.0)
        working.cancel()
        (outcome,) = await asyncio.gather(working, return_exceptions=True)
        expected = {"error": RuntimeError, "cancelled": asyncio.CancelledError}
        assert type(outcome) is expected.get(end, type(None))
        robot.is_down()

    run_in_virtual_time(scene())


def test_an_error_of_the_devices_own_task_is_raised_behind_the_way_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene() -> None:
        robot = _Robot(tmp_path)

        async def fails() -> None:
            raise OSError("the port's thread is gone")

        monkeypatch.setattr(robot.session.service, "run", fails)
        with pytest.raises(OSError, match="the port's thread is gone"):
            async with robot.session.running() as devices:
                await asyncio.wait((devices,))
        robot.lab.stop()

    run_in_virtual_time(scene())


def test_a_recording_that_does_not_end_is_not_waited_for_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene() -> None:
        robot = _Robot(tmp_path)

        async def never() -> None:
            await asyncio.Event().wait()

        async with asyncio.timeout(120.0):
            async with robot.session.running():
                await robot.armed()
                monkeypatch.setattr(robot.session.recording, "end", never)
        channels = robot.session.service.loop.channels
        assert all(not channel.state.energised for channel in channels)
        robot.lab.stop()

    run_in_virtual_time(scene())
