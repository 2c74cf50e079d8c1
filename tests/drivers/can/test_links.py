"""Links opened by configuration: python-can's own interfaces, serial adapters, the emulated bus."""

import asyncio
import fcntl
import logging
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import can
import pytest

from config.bus import Bus
from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.can.bus_lock import BusTakenError, bus_name
from drivers.can.conditions import OFF
from drivers.can.fd_link import FdLink
from drivers.can.link import CanLink, LinkError
from drivers.can.open_link import open_link
from drivers.can.python_can_link import PythonCanLink
from drivers.can.slcan import Refused
from drivers.can.slcan_link import SlcanLink
from drivers.exclusive_name import is_taken
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.port import Port
from sim_backends.devices.can.slcan_adapter import SlcanAdapter
from sim_backends.devices.can.socket_server import SocketServer
from sim_backends.devices.device import Pump
from sim_backends.faults import understand
from tests.drivers.can.test_fd_link import Receiver

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("links")]


def config(interface: str, channel: Path | str) -> Bus:
    return Bus(interface=interface, channel=str(channel), cycle_period_s=0.01)


class Bench:
    """A modelled bus with both front ends, one other node on it, and a link through one of them."""

    def __init__(self, folder: Path) -> None:
        self.clock = MonotonicClock()
        self.bus = CanBus(1_000_000)
        self.bus.advance(self.clock.now_ns())
        self.pump = Pump(self.bus, self.clock)
        self.heard: list[tuple[int, bytes]] = []
        self.other: Port = self.bus.attach("other", 16)
        self.other.listen({}, lambda can_id, data, _: self.heard.append((can_id, data)))
        self.server = SocketServer(self.bus, self.pump, self.clock, folder / "can0.sock")
        self.adapter = SlcanAdapter(self.bus, self.pump, self.clock, folder / "can0")
        self.faults = BusFaults(self.bus)
        self.receiver = Receiver()
        self.link: CanLink | None = None

    def inject(self, order: str) -> None:
        understand({"bus": self.faults}, order).carry_out(self.clock.now_ns())
        self.pump.touch()

    def say(self, can_id: int, data: bytes) -> None:
        self.bus.advance(self.clock.now_ns())
        self.other.send(can_id, data, self.clock.now_ns())
        self.pump.touch()

    async def until(self, true: object) -> None:
        assert callable(true)
        async with asyncio.timeout(60.0):
            while not true():
                await asyncio.sleep(0.005)


async def settle() -> None:
    """In many short pieces: a machine that stands still takes one of them."""
    for _ in range(20):
        await asyncio.sleep(0.005)


@asynccontextmanager
async def bench(folder: Path, interface: str) -> AsyncIterator[Bench]:
    one = Bench(folder)
    channel = folder / ("can0.sock" if interface == "tentacled" else "can0")
    one.link = await open_link(config(interface, channel), one.receiver, one.clock)
    try:
        yield one
    finally:
        one.link.close()
        one.server.close()
        one.adapter.close()
        one.pump.stop()


@pytest.mark.parametrize(("interface", "kind"), [("tentacled", FdLink), ("slcan", SlcanLink)])
def test_frames_pass_both_ways_and_in_order(
    tmp_path: Path, interface: str, kind: type[CanLink]
) -> None:
    async def test() -> None:
        async with bench(tmp_path, interface) as one:
            assert isinstance(one.link, kind)
            assert one.link.send(0x601, b"\x40\x00\x10\x00\x00\x00\x00\x00")
            assert one.link.send_all([(0x80, b""), (0x201, b"\x0f\x00"), (0x202, b"")]) == 3
            await one.until(lambda: len(one.heard) == 4)
            assert [can_id for can_id, _ in one.heard] == [0x601, 0x80, 0x201, 0x202]
            for number in range(20):
                one.say(0x181, bytes([number]))
                await asyncio.sleep(0.001)
            await one.until(lambda: len(one.receiver.frames) == 20)
            assert [data[0] for _, data, _ in one.receiver.frames] == list(range(20))

    run_in_real_time(test())


@pytest.mark.parametrize("interface", ["tentacled", "slcan"])
def test_read_in_the_cycle_frames_wait_for_it(tmp_path: Path, interface: str) -> None:
    async def test() -> None:
        async with bench(tmp_path, interface) as one:
            assert one.link is not None
            one.link.read_in_cycle(True)
            for number in range(5):
                one.say(0x181, bytes([number]))
            await settle()
            assert one.receiver.frames == []
            one.link.drain()
            assert len(one.receiver.frames) == 5
            one.link.drain()
            one.link.read_in_cycle(False)
            one.say(0x182, b"")
            await one.until(lambda: len(one.receiver.frames) == 6)

    run_in_real_time(test())


@pytest.mark.parametrize("in_cycle", [True, False])
@pytest.mark.parametrize("interface", ["tentacled", "slcan"])
def test_an_unplugged_adapter_is_lost_once(tmp_path: Path, interface: str, in_cycle: bool) -> None:
    async def test() -> None:
        async with bench(tmp_path, interface) as one:
            assert one.link is not None
            one.link.read_in_cycle(in_cycle)
            one.inject("bus.unplug=forever")
            for _ in range(50):
                await asyncio.sleep(0.005)
                one.link.drain()
                one.link.send(0x80, b"")
            assert len(one.receiver.lost) == 1

    run_in_real_time(test())


def test_a_serial_adapter_that_is_off_the_bus_is_opened_again(tmp_path: Path) -> None:
    async def test() -> None:
        async with bench(tmp_path, "slcan") as one:
            assert one.link is not None
            one.inject("bus.off")
            for _ in range(2000):
                one.link.send(0x80, b"")
                await asyncio.sleep(0.01)
                if (OFF, False) in one.receiver.conditions:
                    break
            assert one.receiver.conditions.index((OFF, True)) < one.receiver.conditions.index(
                (OFF, False)
            )
            one.heard.clear()
            await settle()
            assert one.link.send(0x701, b"\x05")
            await one.until(lambda: (0x701, b"\x05") in one.heard)

    run_in_real_time(test())


@pytest.mark.parametrize("refuses", [True, False])
def test_a_serial_adapter_that_has_no_status_is_used_while_frames_come(
    tmp_path: Path, refuses: bool
) -> None:
    """Many small ones: they refuse the question, or say nothing to it."""

    async def test() -> None:
        async with bench(tmp_path, "slcan") as one:
            obey = one.adapter._received
            if refuses:
                one.adapter._status = Refused  # type: ignore[method-assign]
            else:
                one.adapter._pty._on_data = lambda data: obey(data.replace(b"F\r", b""))  # type: ignore[union-attr]
            for number in range(50):  # eight refusals in a row would be a bus-off
                one.say(0x701, b"\x05")
                await asyncio.sleep(0.1)
                assert one.receiver.lost == [], f"after {number} heartbeats"
            await one.until(lambda: len(one.receiver.frames) == 50)
            assert (OFF, True) not in one.receiver.conditions

    run_in_real_time(test())


def test_a_serial_adapter_that_says_nothing_is_lost(tmp_path: Path) -> None:
    async def test() -> None:
        async with bench(tmp_path, "slcan") as one:
            one.adapter._received = lambda data: None  # type: ignore[method-assign]
            one.adapter._pty._on_data = lambda data: None  # type: ignore[union-attr]
            await one.until(lambda: one.receiver.lost)
            assert [str(error) for error in one.receiver.lost] == [
                "[Errno 110] the adapter does not answer"
            ]

    run_in_real_time(test())


@pytest.mark.parametrize("interface", ["tentacled", "slcan"])
def test_a_bus_has_one_master_and_is_free_again_when_its_link_is_closed(
    tmp_path: Path, interface: str
) -> None:
    async def test() -> None:
        async with bench(tmp_path, interface) as one:
            assert one.link is not None
            channel = tmp_path / ("can0.sock" if interface == "tentacled" else "can0")
            link = tmp_path / "another name"
            link.symlink_to(channel)
            one.heard.clear()
            for name in (channel, link):
                with pytest.raises(BusTakenError, match="is taken: this process has it open"):
                    await open_link(config(interface, name), Receiver(), one.clock)
            await settle()
            assert one.link.send(0x80, b"")
            await one.until(lambda: one.heard)
            assert one.heard == [(0x80, b"")], "not a byte has gone to the adapter"
            assert one.receiver.lost == []
            one.link.close()
            await one.until(lambda: not is_taken(bus_name(config(interface, channel))))
            one.link = await open_link(config(interface, link), one.receiver, one.clock)

    run_in_real_time(test())


def test_a_serial_adapter_that_another_kind_of_program_has_is_not_shared(tmp_path: Path) -> None:
    async def test() -> None:
        one = Bench(tmp_path)
        with (tmp_path / "can0").open("rb", buffering=0) as theirs:
            fcntl.flock(theirs, fcntl.LOCK_EX)
            with pytest.raises(LinkError, match="in use"):
                await open_link(config("slcan", tmp_path / "can0"), Receiver(), one.clock)
        assert not is_taken(bus_name(config("slcan", tmp_path / "can0")))
        one.adapter.close()
        one.server.close()
        one.pump.stop()

    run_in_real_time(test())


def test_any_interface_of_python_can_works() -> None:
    async def test() -> None:
        receiver = Receiver()
        link = await open_link(config("virtual", "links"), receiver, MonotonicClock())
        assert isinstance(link, PythonCanLink)
        with can.Bus(interface="virtual", channel="links") as other:
            assert link.send_all([(0x80, b""), (0x201, b"\x0f\x00")]) == 2
            assert [other.recv(60.0).arbitration_id for _ in range(2)] == [0x80, 0x201]  # type: ignore[union-attr]
            other.send(can.Message(arbitration_id=0x181, data=b"\x01", is_extended_id=False))
            other.send(
                can.Message(arbitration_id=0x181, is_remote_frame=True, is_extended_id=False)
            )
            other.send(can.Message(arbitration_id=0x12345, is_extended_id=True))
            longer = bytes(12)  # of CAN FD, which no drive here speaks
            other.send(
                can.Message(arbitration_id=0x181, data=longer, is_fd=True, is_extended_id=False)
            )
            other.send(can.Message(arbitration_id=0x182, is_extended_id=False))
            async with asyncio.timeout(60.0):
                while not receiver.frames or receiver.frames[-1][0] != 0x182:
                    await asyncio.sleep(0.01)
        received = [(can_id, data) for can_id, data, _ in receiver.frames]
        assert received == [(0x181, b"\x01"), (0x182, b"")]
        link.close()
        await asyncio.sleep(0.2)

    run_in_real_time(test())


@pytest.mark.parametrize("sends_first", [True, False])
def test_an_adapter_that_python_can_loses_is_lost_once(sends_first: bool) -> None:
    async def test() -> None:
        adapter, port = os.openpty()
        receiver, name = Receiver(), os.ttyname(port)
        link = await open_link(config("serial", name), receiver, MonotonicClock())
        os.close(port)
        os.close(adapter)
        for _ in range(20):
            if not sends_first:
                await asyncio.sleep(0.005)
            assert link.send_all([(0x80, b""), (0x201, b"\x0f\x00")]) == 0
        async with asyncio.timeout(60.0):
            while not receiver.lost or is_taken(bus_name(config("serial", name))):
                await asyncio.sleep(0.005)
        assert len(receiver.lost) == 1

    run_in_real_time(test())


@pytest.mark.parametrize(
    ("interface", "channel", "says"),
    [
        ("tentacled", "/nowhere/can0.sock", "check the channel in the robot file"),
        ("slcan", "/nowhere/can0", "there is no /nowhere/can0"),
        ("socketcan", "can77", "there is no interface can77"),
        ("nosuch", "can0", "check interface, channel and options"),
        ("socketcand", "can0", "missing .* 'host' and 'port': check .* options of the bus"),
    ],
)
def test_an_interface_that_cannot_be_opened_is_explained(
    interface: str, channel: str, says: str
) -> None:
    async def test() -> None:
        with pytest.raises(LinkError, match=says):
            await open_link(config(interface, channel), Receiver(), MonotonicClock())

    run_in_real_time(test())


def test_options_of_an_interface_reach_it_and_tell_buses_apart() -> None:
    here, there = (
        Bus(
            interface="virtual",
            channel="options",
            cycle_period_s=0.01,
            options={"receive_own_messages": own},
        )
        for own in (True, False)
    )
    assert bus_name(here) != bus_name(there)

    async def test() -> None:
        link = await open_link(here, Receiver(), MonotonicClock())
        assert isinstance(link, PythonCanLink)
        assert link._bus.receive_own_messages  # type: ignore[attr-defined]
        link.close()

    run_in_real_time(test())


def test_a_lost_interface_is_told_in_one_line_and_not_logged_beside(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def test() -> None:
        receiver, bus = Receiver(), can.Bus(interface="virtual", channel="fails")

        def fails(_timeout: float | None = None) -> can.Message:
            logging.getLogger("can.interfaces.socketcand").error("it failed")
            raise can.CanOperationError("it failed\nTraceback (most recent call last):\n ...")

        bus.recv = fails  # type: ignore[method-assign, assignment]
        PythonCanLink(bus, receiver, MonotonicClock())
        async with asyncio.timeout(60.0):
            while not receiver.lost:
                await asyncio.sleep(0.01)
        assert [str(error) for error in receiver.lost] == ["it failed"]

    run_in_real_time(test())
    assert not caplog.records


def test_what_an_interface_hands_back_of_our_own_is_nobody_elses() -> None:
    """Multicast over IP does. Nor does a frame that was lost on its way hide a later one."""
    own, lost, others = (0x80, b""), (0x201, b"\x0f\x00"), (0x181, b"\x01")

    async def test() -> None:
        receiver = Receiver()
        bus = can.Bus(interface="virtual", channel="echoes")
        link = PythonCanLink(bus, receiver, MonotonicClock(), echoes=True)
        with can.Bus(interface="virtual", channel="echoes") as other:
            for frame in (lost, own, own):
                assert link.send(*frame)
            for can_id, data in (own, others, own, lost):
                other.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
            async with asyncio.timeout(60.0):
                while len(receiver.frames) < 2:
                    await asyncio.sleep(0.01)
        assert [(can_id, data) for can_id, data, _ in receiver.frames] == [others, lost]
        link.close()
        await asyncio.sleep(0.2)

    run_in_real_time(test())


def test_a_dead_lab_leaves_a_socket_that_nobody_answers(tmp_path: Path) -> None:
    async def test() -> None:
        one = Bench(tmp_path)
        one.server._stop_listening()
        (tmp_path / "can0.sock").touch()
        with pytest.raises(LinkError):
            await open_link(config("tentacled", tmp_path / "can0.sock"), Receiver(), one.clock)
        one.adapter.close()
        one.server.close()
        one.pump.stop()

    run_in_real_time(test())


def test_nothing_is_left_open_after_many_openings(tmp_path: Path) -> None:
    async def test() -> None:
        one = Bench(tmp_path)
        counts = []
        for _ in range(3):
            for _ in range(10):
                link = await open_link(
                    config("tentacled", tmp_path / "can0.sock"), Receiver(), one.clock
                )
                link.close()
                await asyncio.sleep(0.001)
            await settle()
            counts.append(descriptors())
        one.adapter.close()
        one.server.close()
        one.pump.stop()
        assert counts[0] == counts[-1]

    run_in_real_time(test())


def descriptors() -> int:
    assert sys.platform == "linux"
    return len(list(Path("/proc/self/fd").iterdir()))
