"""The bus through its unix socket."""

import asyncio
import errno
import socket
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.can.frame import (
    CAN_FRAME,
    ERROR_FLAG,
    EXTENDED_FLAG,
    CanFrame,
    pack_frame,
    unpack_frame,
)
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.socket_server import ERRNO, SocketServer
from sim_backends.devices.device import Pump

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("can_socket")]


class Rig:
    """A bus with a socket, and clients in the same process."""

    def __init__(self, path: Path, **options: Any) -> None:
        self.clock = MonotonicClock()
        self.bus = CanBus(1_000_000)
        self.bus.advance(self.clock.now_ns())
        self.pump = Pump(self.bus, self.clock)
        self.faults = BusFaults(self.bus)
        self.server = SocketServer(self.bus, self.pump, self.clock, path, **options)
        self.path = path
        self.clients: list[socket.socket] = []

    async def client(self) -> socket.socket:
        client = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.clients.append(client)
        client.connect(str(self.path))
        client.setblocking(False)
        await asyncio.sleep(0.01)
        return client

    def inject(self, fault: str, **arguments: Any) -> None:
        self.faults.inject(fault, arguments, self.clock.now_ns())
        self.pump.touch()

    def close(self) -> None:
        self.server.close()
        self.pump.stop()
        for client in self.clients:
            client.close()


async def packet(client: socket.socket) -> bytes:
    return await asyncio.wait_for(asyncio.get_running_loop().sock_recv(client, 64), 60)


async def frame(client: socket.socket) -> CanFrame:
    return unpack_frame(await packet(client))


Play = Callable[[Rig], Coroutine[Any, Any, None]]


@pytest.fixture
def play(tmp_path: Path) -> Callable[..., None]:
    def run(scene: Play, **options: Any) -> None:
        async def main() -> None:
            rig = Rig(tmp_path / "can0.sock", **options)
            try:
                await scene(rig)
            finally:
                rig.close()

        run_in_real_time(main())

    return run


def test_clients_hear_each_other_and_not_themselves(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        one, other = await rig.client(), await rig.client()
        one.send(pack_frame(CanFrame(0x181, b"\x11\x22")))
        assert await frame(other) == CanFrame(0x181, b"\x11\x22")
        other.send(pack_frame(CanFrame(0x18DAF110 | EXTENDED_FLAG, bytes(8))))
        assert await frame(one) == CanFrame(0x18DAF110 | EXTENDED_FLAG, bytes(8))
        with pytest.raises(BlockingIOError):
            one.recv(64)

    play(scene)


def test_what_is_no_frame_is_dropped_and_harms_nobody(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        one, other = await rig.client(), await rig.client()
        one.send(b"rubbish")
        one.send(CAN_FRAME.pack(0x181, 9, bytes(8)))
        one.send(CAN_FRAME.pack(ERROR_FLAG | 0x40, 8, bytes(8)))
        one.send(bytes(17))
        one.send(pack_frame(CanFrame(0x182)))
        assert await frame(other) == CanFrame(0x182)

    play(scene)


def test_a_client_whose_queue_is_full_is_not_read_from(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        client = await rig.client()  # alone: nothing is acknowledged
        sent = 0
        with pytest.raises(BlockingIOError):
            while True:
                client.send(pack_frame(CanFrame(0x181, bytes(8))))
                sent += 1
                await asyncio.sleep(0)
        listener = await rig.client()
        heard = 0
        while heard < sent:
            received = await frame(listener)
            heard += received == CanFrame(0x181, bytes(8))
        client.send(pack_frame(CanFrame(0x182)))
        assert await frame(listener) == CanFrame(0x182)

    play(scene, queue_frames=8)


def test_a_client_that_does_not_read_loses_frames_and_disturbs_nobody(
    play: Callable[..., None],
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.client()
        sender, reader = await rig.client(), await rig.client()
        for number in range(1000):
            sender.send(pack_frame(CanFrame(number)))
            assert (await frame(reader)).can_id == number
        assert rig.server.frames_lost > 0

    play(scene)


def test_bus_off_is_told_like_the_kernel_does_and_ends_after_its_time(
    play: Callable[..., None],
) -> None:
    async def scene(rig: Rig) -> None:
        client, other = await rig.client(), await rig.client()
        rig.inject("off")
        off = await frame(client)
        assert off.can_id & ERROR_FLAG
        assert off.can_id & 0x40
        client.send(pack_frame(CanFrame(0x181)))  # taken and dropped, as by the kernel
        restarted = await frame(client)
        assert restarted.can_id & 0x100
        client.send(pack_frame(CanFrame(0x182)))
        while (received := await frame(other)).can_id & ERROR_FLAG:
            pass
        assert received == CanFrame(0x182)

    play(scene, restart_s=1.0)


def test_error_passive_is_told_with_the_counters(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        client = await rig.client()
        rig.inject("passive", duration=1.0)
        passive = await frame(client)
        assert passive.can_id & (ERROR_FLAG | 0x4) == ERROR_FLAG | 0x4
        assert passive.data[1] == 0x20
        assert passive.data[6] == 128
        active = await frame(client)
        assert active.data[1] == 0x40

    play(scene)


def test_an_interface_that_is_down_says_so_and_works_again_on_the_same_socket(
    play: Callable[..., None],
) -> None:
    async def scene(rig: Rig) -> None:
        client, other = await rig.client(), await rig.client()
        rig.inject("down", duration=1.0)
        assert ERRNO.unpack(await packet(client)) == (errno.ENETDOWN,)
        client.send(pack_frame(CanFrame(0x181)))
        assert ERRNO.unpack(await packet(client)) == (errno.ENETDOWN,)
        await asyncio.sleep(1.2)
        client.send(pack_frame(CanFrame(0x182)))
        assert ERRNO.unpack(await packet(other)) == (errno.ENETDOWN,)
        assert await frame(other) == CanFrame(0x182)

    play(scene)


def test_a_pulled_adapter_hangs_up_and_takes_clients_again_when_it_is_back(
    play: Callable[..., None],
) -> None:
    async def scene(rig: Rig) -> None:
        client = await rig.client()
        rig.inject("unplug", duration=1.0)
        assert await packet(client) == b""
        with pytest.raises(OSError, match="No such file"):
            await rig.client()
        await asyncio.sleep(1.2)
        again, other = await rig.client(), await rig.client()
        again.send(pack_frame(CanFrame(0x181)))
        assert await frame(other) == CanFrame(0x181)

    play(scene)


def test_clients_come_and_go(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        for _ in range(40):
            client = await rig.client()
            client.close()
        await asyncio.sleep(0.01)
        one, other = await rig.client(), await rig.client()
        one.send(pack_frame(CanFrame(0x181)))
        assert await frame(other) == CanFrame(0x181)

    play(scene)


def test_more_clients_than_there_is_room_for_are_turned_away(play: Callable[..., None]) -> None:
    async def scene(rig: Rig) -> None:
        clients = [await rig.client() for _ in range(17)]
        assert await packet(clients[-1]) == b""

    play(scene)
