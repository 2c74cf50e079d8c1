"""The bus through a serial adapter."""

import asyncio
import os
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from daemon.host.clock import MonotonicClock, run_in_real_time
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.slcan_adapter import SlcanAdapter
from sim_backends.devices.device import Pump
from tests.sim_backends.can.rig import Node

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("slcan_adapter")]


class Rig:
    """An adapter, a program on its serial port, and a plain node on the bus."""

    def __init__(self) -> None:
        self.clock = MonotonicClock()
        self.bus = CanBus(1_000_000)
        self.bus.advance(self.clock.now_ns())
        self.pump = Pump(self.bus, self.clock)
        self.faults = BusFaults(self.bus)
        self.adapter = SlcanAdapter(self.bus, self.pump, self.clock)
        self.node = Node.on(self.bus)
        self.loop = asyncio.get_running_loop()
        self.serial = -1
        self.came = bytearray()
        self.plug_in()

    def plug_in(self) -> None:
        self.serial = os.open(self.adapter.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.loop.add_reader(self.serial, self.readable)

    def readable(self) -> None:
        try:
            self.came += os.read(self.serial, 4096)
        except OSError:
            self.loop.remove_reader(self.serial)

    async def ask(self, line: bytes) -> bytes:
        """What comes back within a moment."""
        self.came.clear()
        os.write(self.serial, line)
        await settle()
        return bytes(self.came)

    def send(self, can_id: int, data: bytes = b"") -> None:
        self.node.port.send(can_id, data, self.clock.now_ns())
        self.pump.touch()

    def inject(self, fault: str, **arguments: Any) -> None:
        self.faults.inject(fault, arguments, self.clock.now_ns())
        self.pump.touch()

    def close(self) -> None:
        self.loop.remove_reader(self.serial)
        os.close(self.serial)
        self.adapter.close()
        self.pump.stop()


async def settle() -> None:
    """In many short pieces: a machine that stands still takes one of them."""
    for _ in range(20):
        await asyncio.sleep(0.002)


def play(scene: Callable[[Rig], Coroutine[Any, Any, None]]) -> None:
    async def main() -> None:
        rig = Rig()
        try:
            await scene(rig)
        finally:
            rig.close()

    run_in_real_time(main())


@pytest.mark.parametrize(
    ("lines", "replies"),
    [
        (b"V\r", b"V1013\r"),
        (b"N\r", b"NEM01\r"),
        (b"\r\r\r", b"\r\r\r"),
        (b"O\r", b"\a"),  # no bit rate yet
        (b"S8\rO\r", b"\r\r"),
        (b"S8\rL\r", b"\r\r"),
        (b"S9\r", b"\a"),
        (b"s0014\rO\r", b"\r\r"),
        (b"S8\rO\rO\r", b"\r\r\a"),  # open already
        (b"S8\rO\rS6\r", b"\r\r\a"),
        (b"S8\rO\rZ1\r", b"\r\r\a"),
        (b"S8\rO\rC\rC\r", b"\r\r\r\a"),
        (b"F\r", b"\a"),
        (b"S8\rO\rF\r", b"\r\rF00\r"),
        (b"t1810\r", b"\a"),  # not open
        (b"S8\rO\rt1810\rT000001810\r", b"\r\rz\rZ\r"),
        (b"S8\rL\rt1810\r", b"\r\r\a"),
        (b"hello\r", b"\a"),
        (b"C\rS8\r\rO\rO\r", b"\a\r\r\r\a"),  # how python-can begins
    ],
)
def test_commands_are_answered(lines: bytes, replies: bytes) -> None:
    async def scene(rig: Rig) -> None:
        assert await rig.ask(lines) == replies

    play(scene)


def test_frames_go_both_ways() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S8\rO\r")
        await rig.ask(b"t18121122\r")
        assert [(can_id, data) for can_id, data, _ in rig.node.heard] == [(0x181, b"\x11\x22")]
        rig.came.clear()
        rig.send(0x581, bytes(8))
        await settle()
        assert rig.came == b"t58180000000000000000\r"

    play(scene)


def test_time_stamps_count_milliseconds() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S8\rZ1\rO\r")
        rig.came.clear()
        began_ns = rig.clock.now_ns()
        rig.send(0x181)
        await asyncio.sleep(0.05)
        rig.send(0x182)
        await settle()
        took_ms = (rig.clock.now_ns() - began_ns) / 1e6
        first, second = (int(line[-4:], 16) for line in bytes(rig.came).split(b"\r")[:2])
        assert 45 <= (second - first) % 60_000 <= took_ms + 5

    play(scene)


def test_bus_off_refuses_frames_and_shows_in_the_flags_until_closed_and_opened() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S8\rO\r")
        rig.inject("off")
        assert await rig.ask(b"t1810\r") == b"\a"
        assert await rig.ask(b"F\r") == b"FA6\r"
        assert await rig.ask(b"C\rO\rt1810\r") == b"\r\rz\r"
        assert await rig.ask(b"F\rF\r") == b"F00\rF00\r"

    play(scene)


def test_error_passive_shows_in_the_flags() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S8\rO\r")
        rig.inject("passive", duration=1e9)
        assert await rig.ask(b"F\r") == b"F24\r"

    play(scene)


def test_the_wrong_bit_rate_takes_the_adapter_off_the_bus() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S6\rO\r")
        rig.send(0x181)
        assert await rig.ask(b"t0800\r") == b"z\r"
        assert await rig.ask(b"F\r") == b"FA4\r"
        assert rig.node.ids == []

    play(scene)


def test_a_program_that_does_not_read_loses_whole_lines() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S8\rO\r")
        rig.loop.remove_reader(rig.serial)
        for _ in range(2500):
            rig.send(0x181, bytes(8))
            await asyncio.sleep(0.00012)
        assert rig.adapter._port.received_lost > 0
        rig.came.clear()
        rig.loop.add_reader(rig.serial, rig.readable)
        await settle()
        os.write(rig.serial, b"F\r")
        await settle()
        lines = bytes(rig.came).split(b"\r")
        assert set(lines[:-2]) == {b"t18180000000000000000"}
        assert lines[-2:] == [b"F09", b""]

    play(scene)


def test_a_pulled_adapter_is_a_hung_up_port_and_another_one_when_it_is_back() -> None:
    async def scene(rig: Rig) -> None:
        await rig.ask(b"S8\rO\r")
        rig.inject("unplug", duration=1.0)
        with pytest.raises(FileNotFoundError):
            _ = rig.adapter.path
        with pytest.raises(OSError, match="error"):
            os.write(rig.serial, b"O\r")
        rig.loop.remove_reader(rig.serial)
        os.close(rig.serial)
        await asyncio.sleep(1.2)
        rig.plug_in()
        assert await rig.ask(b"t1810\r") == b"\a"
        assert await rig.ask(b"S8\rO\rt1810\r") == b"\r\rz\r"

    play(scene)
