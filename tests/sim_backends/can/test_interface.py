"""The python-can interface to the emulated bus."""

import asyncio
import errno
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import can
import pytest

from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.interface import EmulatedCanBus
from sim_backends.devices.can.socket_server import SocketServer
from sim_backends.devices.device import Pump
from tests.sim_backends.can.rig import Node

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("can_interface")]


class Rig:
    """A bus with a plain node on it; `opened` clients are closed at the end."""

    def __init__(self, path: Path) -> None:
        self.clock = MonotonicClock()
        self.emulated = CanBus(1_000_000)
        self.emulated.advance(self.clock.now_ns())
        self.pump = Pump(self.emulated, self.clock)
        self.faults = BusFaults(self.emulated)
        self.server = SocketServer(self.emulated, self.pump, self.clock, path, queue_frames=8)
        self.node = Node.on(self.emulated)
        self.path = path
        self.opened: list[EmulatedCanBus] = []

    async def open(self, **options: Any) -> EmulatedCanBus:
        bus = can.Bus(interface="tentacled", channel=str(self.path), **options)
        assert isinstance(bus, EmulatedCanBus)
        self.opened.append(bus)
        await asyncio.sleep(0.01)
        return bus

    def send(self, can_id: int, data: bytes = b"") -> None:
        self.node.port.send(can_id, data, self.clock.now_ns())
        self.pump.touch()

    def close(self) -> None:
        for bus in self.opened:
            bus.shutdown()
        self.server.close()
        self.pump.stop()


@pytest.fixture
def play(tmp_path: Path) -> Callable[..., None]:
    def run(scene: Callable[[Rig], Coroutine[Any, Any, None]]) -> None:
        async def main() -> None:
            rig = Rig(tmp_path / "can0.sock")
            try:
                await scene(rig)
            finally:
                rig.close()

        run_in_real_time(main())

    return run


async def settle() -> None:
    """In many short pieces: a machine that stands still takes one of them."""
    for _ in range(20):
        await asyncio.sleep(0.005)


def receive(bus: can.BusABC, timeout: float = 60.0) -> Coroutine[Any, Any, can.Message | None]:
    return asyncio.to_thread(bus.recv, timeout)


def test_messages_go_both_ways(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        assert bus.carries_can_frames
        assert bus.fileno() == bus.socket.fileno()
        for message in (
            can.Message(arbitration_id=0x181, data=b"\x11\x22", is_extended_id=False),
            can.Message(arbitration_id=0x18DAF110, data=bytes(8), is_extended_id=True),
            can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True, dlc=1),
        ):
            bus.send(message)
        await settle()
        assert [(can_id, data) for can_id, data, _ in rig.node.heard] == [
            (0x181, b"\x11\x22"),
            (0x18DAF110 | EXTENDED_FLAG, bytes(8)),
            (0x701 | REMOTE_FLAG, b"\x00"),
        ]
        rig.send(0x581, b"\x01\x02")
        rig.send(0x18DAF110 | EXTENDED_FLAG, b"\x03")
        rig.send(0x702 | REMOTE_FLAG, b"\x00")
        standard, extended, remote = [await receive(bus) for _ in range(3)]
        assert standard is not None
        assert (standard.arbitration_id, bytes(standard.data)) == (0x581, b"\x01\x02")
        assert not standard.is_extended_id
        assert standard.timestamp > 1.7e9
        assert extended is not None
        assert (extended.arbitration_id, extended.is_extended_id) == (0x18DAF110, True)
        assert remote is not None
        assert (remote.arbitration_id, remote.is_remote_frame, remote.dlc) == (0x702, True, 1)

    play(scene)


def test_nothing_to_receive_is_none_after_the_timeout(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        assert await receive(bus, 0.01) is None
        assert bus.recv(0) is None

    play(scene)


def test_filters_work(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open(can_filters=[{"can_id": 0x080, "can_mask": 0x780}])
        for can_id in (0x181, 0x085, 0x700):
            rig.send(can_id)
        message = await receive(bus)
        assert message is not None
        assert message.arbitration_id == 0x085
        assert await receive(bus, 0.02) is None

    play(scene)


def test_a_full_queue_is_an_operation_error_with_its_number(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        rig.faults.inject("full", {"duration": 1e9}, rig.clock.now_ns())
        message = can.Message(arbitration_id=0x181, is_extended_id=False)
        with pytest.raises(can.CanOperationError) as raised:
            for _ in range(100):
                bus.send(message, timeout=0)
        assert raised.value.error_code == errno.ENOBUFS

        def send_patiently() -> None:
            for _ in range(100):
                bus.send(message, timeout=0.02)

        with pytest.raises(can.CanOperationError):
            await asyncio.to_thread(send_patiently)

    play(scene)


def test_sending_can_wait_for_room(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        message = can.Message(arbitration_id=0x181, is_extended_id=False)

        def burst() -> None:
            for _ in range(100):
                bus.send(message, timeout=60)

        await asyncio.to_thread(burst)
        await settle()
        assert len(rig.node.heard) == 100

    play(scene)


def test_error_frames_are_error_frames(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        rig.faults.inject("off", {}, rig.clock.now_ns())
        rig.pump.touch()
        message = await receive(bus)
        assert message is not None
        assert message.is_error_frame
        assert message.arbitration_id & 0x40

    play(scene)


def test_an_interface_that_is_down_is_enetdown(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        rig.faults.inject("down", {"duration": 0.05}, rig.clock.now_ns())
        rig.pump.touch()
        with pytest.raises(can.CanOperationError) as raised:
            await receive(bus)
        assert raised.value.error_code == errno.ENETDOWN
        await asyncio.sleep(0.1)
        rig.send(0x181)
        assert await receive(bus) is not None

    play(scene)


def test_a_pulled_adapter_is_enodev(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        rig.faults.inject("unplug", {"duration": 1e9}, rig.clock.now_ns())
        with pytest.raises(can.CanOperationError) as raised:
            await receive(bus)
        assert raised.value.error_code == errno.ENODEV
        with pytest.raises(can.CanOperationError):
            bus.send(can.Message(arbitration_id=0x181, is_extended_id=False))

    play(scene)


def test_can_fd_is_refused(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        bus = await rig.open()
        with pytest.raises(can.CanOperationError) as raised:
            bus.send(can.Message(arbitration_id=0x181, is_fd=True, is_extended_id=False))
        assert raised.value.error_code == errno.EINVAL

    play(scene)


def test_without_a_lab_there_is_no_bus(tmp_path: Path) -> None:
    with pytest.raises(can.CanInitializationError, match="lab running"):
        can.Bus(interface="tentacled", channel=str(tmp_path / "nothing.sock"))
