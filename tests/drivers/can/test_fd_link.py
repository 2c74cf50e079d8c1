"""Frames straight from and to a descriptor, and every way in which a CAN interface can fail."""

import asyncio
import errno
import socket
from collections.abc import Callable, Coroutine
from typing import Any, cast

import pytest

from drivers.can.conditions import DOWN, OFF, OVERFLOW, PASSIVE, QUEUE_FULL
from drivers.can.fd_link import FdLink
from drivers.can.frame import CanFrame, pack_frame
from drivers.conditions import Condition


class Clock:
    def __init__(self) -> None:
        self.t_ns = 7

    def now_ns(self) -> int:
        return self.t_ns


class Receiver:
    """Keeps what a link tells."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes, int]] = []
        self.conditions: list[tuple[Condition, bool]] = []
        self.lost: list[OSError] = []
        self.on_frame: Callable[[], None] = lambda: None

    def frame_received(self, can_id: int, data: bytes, t_ns: int) -> None:
        self.frames.append((can_id, data, t_ns))
        self.on_frame()

    def condition_seen(self, condition: Condition, present: bool, detail: str) -> None:
        self.conditions.append((condition, present))

    def link_lost(self, error: OSError) -> None:
        self.lost.append(error)


class ScriptedSocket:
    """A socket whose next calls fail as told."""

    def __init__(self, real: socket.socket) -> None:
        self._real = real
        self.send_errors: list[int] = []
        self.receive_errors: list[int] = []

    def send(self, data: bytes) -> int:
        if self.send_errors:
            code = self.send_errors.pop(0)
            raise OSError(code, errno.errorcode[code])
        return self._real.send(data)

    def recv_into(self, buffer: bytearray) -> int:
        if self.receive_errors:
            code = self.receive_errors.pop(0)
            raise OSError(code, errno.errorcode[code])
        return self._real.recv_into(buffer)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


class Bench:
    """A link on one end of a socket pair."""

    def __init__(self) -> None:
        mine, self.peer = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket = ScriptedSocket(mine)
        self.receiver = Receiver()
        self.clock = Clock()
        self.link = FdLink(cast(socket.socket, self.socket), mine.close, self.receiver, self.clock)


def on_a_bench(test: Callable[[Bench], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        bench = Bench()
        await test(bench)
        bench.link.close()
        bench.peer.close()

    asyncio.run(run())


async def settle() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


def test_frames_arrive_in_order_with_the_time_of_reading() -> None:
    async def test(bench: Bench) -> None:
        for number in range(100):
            bench.peer.send(pack_frame(CanFrame(0x181, bytes([number]))))
        await settle()
        assert bench.receiver.frames == [(0x181, bytes([n]), 7) for n in range(100)]

    on_a_bench(test)


def test_a_frame_is_sent_as_the_kernel_has_it() -> None:
    async def test(bench: Bench) -> None:
        assert bench.link.send(0x201, b"\x0f\x00")
        assert bench.peer.recv(64) == bytes.fromhex("01020000 02000000 0f00000000000000")

    on_a_bench(test)


@pytest.mark.parametrize("can_id", [0x40000181, 0x80000181])
def test_remote_and_extended_frames_are_not_data(can_id: int) -> None:
    async def test(bench: Bench) -> None:
        bench.peer.send(pack_frame(CanFrame(can_id, b"\x01")))
        await settle()
        assert bench.receiver.frames == []

    on_a_bench(test)


@pytest.mark.parametrize(
    ("can_id", "data", "told"),
    [
        (0x20000040, bytes(8), [(OFF, True)]),
        (0x20000100, bytes(8), [(OFF, False), (PASSIVE, False)]),
        (0x20000004, b"\0\x20\0\0\0\0\x80\0", [(PASSIVE, True)]),
        (0x20000004, b"\0\x40\0\0\0\0\0\0", [(PASSIVE, False)]),
        (0x20000004, b"\0\x01\0\0\0\0\0\0", [(OVERFLOW, True), (OVERFLOW, False)]),
        (0x20000080, bytes(8), []),
    ],
)
def test_error_frames_become_conditions(
    can_id: int, data: bytes, told: list[tuple[Condition, bool]]
) -> None:
    async def test(bench: Bench) -> None:
        bench.peer.send(pack_frame(CanFrame(can_id, data)))
        await settle()
        assert bench.receiver.conditions == told
        assert bench.receiver.lost == []

    on_a_bench(test)


@pytest.mark.parametrize("code", [errno.ENOBUFS, errno.EAGAIN])
def test_a_full_queue_is_told_once_and_again_when_it_is_over(code: int) -> None:
    async def test(bench: Bench) -> None:
        bench.socket.send_errors = [code, code]
        assert [bench.link.send(0x80, b"") for _ in range(4)] == [False, False, True, True]
        assert bench.receiver.conditions == [(QUEUE_FULL, True), (QUEUE_FULL, False)]

    on_a_bench(test)


def test_a_real_full_socket_refuses_and_never_blocks() -> None:
    async def test(bench: Bench) -> None:
        sent = 0
        while bench.link.send(0x80, b""):
            sent += 1
            assert sent < 1_000_000
        assert bench.receiver.conditions == [(QUEUE_FULL, True)]

    on_a_bench(test)


def test_the_same_socket_goes_on_when_the_interface_was_down() -> None:
    async def test(bench: Bench) -> None:
        bench.socket.send_errors = [errno.ENETDOWN]
        bench.socket.receive_errors = [errno.ENETDOWN]
        bench.peer.send(pack_frame(CanFrame(0x701, b"\x05")))
        await settle()
        assert not bench.link.send(0x80, b"")
        bench.clock.t_ns += 300_000_000
        assert bench.link.send(0x80, b"")
        assert bench.receiver.frames == [(0x701, b"\x05", 7)]
        assert bench.receiver.conditions == [(DOWN, True), (DOWN, False)]

    on_a_bench(test)


def test_an_interface_that_is_down_by_a_packet_stays_down_while_packets_say_so() -> None:
    async def test(bench: Bench) -> None:
        for _ in range(3):
            bench.peer.send(errno.ENETDOWN.to_bytes(4, "little"))
            await settle()
            bench.clock.t_ns += 100_000_000
            assert bench.link.send(0x80, b"")
        assert bench.receiver.conditions == [(DOWN, True)]
        bench.clock.t_ns += 300_000_000
        assert bench.link.send(0x80, b"")
        assert bench.receiver.conditions == [(DOWN, True), (DOWN, False)]
        assert bench.receiver.lost == []

    on_a_bench(test)


@pytest.mark.parametrize("code", [errno.ENODEV, errno.ENXIO, errno.EPIPE, errno.ECONNRESET])
@pytest.mark.parametrize("where", ["send_errors", "receive_errors"])
def test_an_unplugged_adapter_is_lost_once_and_closed(code: int, where: str) -> None:
    async def test(bench: Bench) -> None:
        setattr(bench.socket, where, [code, code])
        bench.peer.send(pack_frame(CanFrame(0x701, b"\x05")))
        bench.link.send(0x80, b"")
        await settle()
        bench.link.close()
        assert [error.errno for error in bench.receiver.lost] == [code]
        assert bench.socket.fileno() == -1

    on_a_bench(test)


def test_the_other_end_closing_is_a_loss_and_does_not_spin() -> None:
    async def test(bench: Bench) -> None:
        bench.peer.close()
        await settle()
        assert [error.errno for error in bench.receiver.lost] == [errno.ECONNRESET]

    on_a_bench(test)


@pytest.mark.parametrize("packet", [b"", b"\0" * 15, b"\0" * 8])
def test_a_packet_that_is_no_frame_ends_the_link(packet: bytes) -> None:
    async def test(bench: Bench) -> None:
        bench.peer.send(packet)
        await settle()
        assert len(bench.receiver.lost) == 1

    on_a_bench(test)


def test_closing_within_a_call_back_stops_the_reading() -> None:
    async def test(bench: Bench) -> None:
        bench.receiver.on_frame = bench.link.close
        for _ in range(3):
            bench.peer.send(pack_frame(CanFrame(0x181, b"")))
        await settle()
        assert len(bench.receiver.frames) == 1
        assert bench.receiver.lost == []

    on_a_bench(test)
