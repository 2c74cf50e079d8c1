"""However its devices behave, hardware lets go of all of them in bounded time."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from config.robot import Robot
from config.tracker import Tracker
from daemon.robot.checked_robot import check_robot
from daemon.robot.hardware import Hardware, Listeners
from daemon.robot.lab_connections import LabConnections
from drivers.byte_stream import ByteReceiver, ByteStream, StreamOpener
from drivers.can.link import CanLink, FrameReceiver
from drivers.cia402.drive_bus import DriveBus, LinkOpener
from sim_backends.lab.lab import Lab
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock
from tests import SOFT_ARM

ENDS_WITHIN_S = 6.5


async def never(over: asyncio.Event) -> Any:
    """Opens nothing, and does not mind being cancelled."""
    while not over.is_set():
        try:
            await asyncio.wait_for(over.wait(), 1000.0)
        except (asyncio.CancelledError, TimeoutError):
            continue
    raise OSError


class Stubborn(LabConnections):
    """Its tracker or its bus swallows a cancel, as a wait for a shielded call does now and then."""

    def __init__(self, lab: Lab, part: str) -> None:
        super().__init__(lab, virtual_clock())
        self.over = asyncio.Event()
        self._part = part

    def tracker(self, config: Tracker) -> StreamOpener:
        async def open_stream(receiver: ByteReceiver) -> ByteStream:
            del receiver
            stream: ByteStream = await never(self.over)
            return stream

        return open_stream if self._part == "tracker" else super().tracker(config)

    def bus(self, name: str, robot: Robot) -> LinkOpener:
        async def open_bus(receiver: FrameReceiver) -> CanLink:
            del receiver
            link: CanLink = await never(self.over)
            return link

        return open_bus if self._part == "bus" else super().bus(name, robot)


def ending_takes_s(part: str, before: Callable[[Hardware], None] = lambda _: None) -> float:
    """How long hardware takes to end, a second after it was started."""

    async def test() -> float:
        file = check_robot(SOFT_ARM).file
        clock = virtual_clock()
        lab = Lab(file.robot, file.path, clock, 1)
        lab.start()
        connections = Stubborn(lab, part)
        hardware = Hardware(
            file, file.robot, connections, clock, Listeners(lambda _: None, lambda _: None)
        )
        before(hardware)
        running = asyncio.create_task(hardware.run())
        await asyncio.sleep(1.0)
        began_ns = clock.now_ns()
        running.cancel()
        await asyncio.wait([running], timeout=1000.0)
        took_s = (clock.now_ns() - began_ns) * 1e-9
        assert running.done()
        connections.over.set()
        await asyncio.sleep(1.0)
        lab.stop()
        return took_s

    return run_in_virtual_time(test())


@pytest.mark.parametrize("part", ["tracker", "bus"])
def test_a_device_that_swallows_its_cancellation_is_left_behind(part: str) -> None:
    assert ending_takes_s(part) < ENDS_WITHIN_S


def test_a_bus_that_does_not_close_is_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    async def hangs(self: DriveBus, within_s: float = 1.0) -> None:
        del self, within_s
        await asyncio.sleep(1e6)

    monkeypatch.setattr(DriveBus, "close", hangs)
    assert ending_takes_s("none") < ENDS_WITHIN_S


def test_devices_that_behave_are_let_go_of_at_once() -> None:
    assert ending_takes_s("none") < 0.5
