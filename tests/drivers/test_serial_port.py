"""A serial port keeps its promises on a real pty: bytes, rates, locks, hang-ups, descriptors."""

import asyncio
import errno
import os
import termios
import threading
import tty
from collections.abc import Callable, Coroutine, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import serial

from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.byte_stream import ByteStream, StreamError
from drivers.serial_port import SerialPort, serial_port_opener

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("serial")]

CLOCK = MonotonicClock()


class Line:
    """Both ends of a pty; the far end is ours to read and write."""

    def __init__(self) -> None:
        self.far, self._near = os.openpty()
        tty.setraw(self._near)
        os.set_blocking(self.far, False)
        self.path = os.ttyname(self._near)

    def read(self) -> bytes:
        try:
            return os.read(self.far, 65536)
        except BlockingIOError:
            return b""

    @property
    def near_baud_rate(self) -> int:
        return int(termios.tcgetattr(self.far)[5])

    def hang_up(self) -> None:
        os.close(self.far)
        self.far = -1

    def close(self) -> None:
        if self.far >= 0:
            self.hang_up()
        os.close(self._near)


class Receiver:
    def __init__(self) -> None:
        self.data = bytearray()
        self.times_ns: list[int] = []
        self.losses: list[OSError] = []

    def bytes_received(self, data: bytes, t_ns: int) -> None:
        self.data += data
        self.times_ns.append(t_ns)

    def stream_lost(self, error: OSError) -> None:
        self.losses.append(error)


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.close()


def run(main: Coroutine[Any, Any, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(10.0):
            await main

    run_in_real_time(limited())


async def until(is_true: Callable[[], object]) -> None:
    async with asyncio.timeout(5.0):
        while not is_true():
            await asyncio.sleep(0.002)


async def opened(line: Line) -> tuple[ByteStream, Receiver]:
    receiver = Receiver()
    return await serial_port_opener(line.path, CLOCK)(receiver), receiver


def descriptors() -> set[str]:
    return {path.name for path in Path("/proc/self/fd").iterdir()}


def test_bytes_go_both_ways_and_carry_the_time_of_reading(line: Line) -> None:
    async def main() -> None:
        stream, receiver = await opened(line)
        stream.write(b"INIT:")
        stream.write(b"E3A5\r")
        await until(lambda: line.read() == b"INIT:E3A5\r")
        before_ns = CLOCK.now_ns()
        os.write(line.far, bytes(range(256)))
        await until(lambda: len(receiver.data) == 256)
        assert receiver.data == bytes(range(256))
        assert before_ns <= receiver.times_ns[0] <= CLOCK.now_ns()
        stream.close()

    run(main())


def test_what_the_kernel_does_not_take_at_once_is_sent_later_in_order(line: Line) -> None:
    async def main() -> None:
        stream, _ = await opened(line)
        sent = bytes(i * 7 % 251 for i in range(50_000))
        for start in range(0, len(sent), 5_000):
            stream.write(sent[start : start + 5_000])
        found = bytearray()
        while len(found) < len(sent):
            await asyncio.sleep(0)
            found += line.read()
        assert found == sent
        stream.close()

    run(main())


def test_a_line_that_takes_nothing_is_given_up_and_not_buffered_for_ever(line: Line) -> None:
    async def main() -> None:
        stream, receiver = await opened(line)
        for _ in range(40):
            stream.write(bytes(5_000))
        assert isinstance(stream, SerialPort)
        assert stream._queued_bytes <= 65536
        await until(lambda: receiver.losses)
        assert "takes no more bytes" in str(receiver.losses[0])

    run(main())


def test_the_rate_changes_in_turn_with_what_is_written(line: Line) -> None:
    async def main() -> None:
        stream, _ = await opened(line)
        assert line.near_baud_rate == termios.B9600
        stream.write(b"COMM:500000048\r")
        stream.set_baud_rate(115200)
        await until(lambda: line.near_baud_rate == termios.B115200)
        full = bytes(60_000)
        stream.write(full)
        stream.set_baud_rate(230400)
        await asyncio.sleep(0.05)
        assert line.near_baud_rate == termios.B115200  # there is still something to send
        received = 0
        while received < len(full):
            received += len(line.read())
            await asyncio.sleep(0)
        await until(lambda: line.near_baud_rate == termios.B230400)
        stream.close()

    run(main())


def test_input_can_be_discarded(line: Line) -> None:
    async def main() -> None:
        stream, receiver = await opened(line)
        os.write(line.far, b"stale")
        stream.discard_input()
        await asyncio.sleep(0.01)
        os.write(line.far, b"fresh")
        await until(lambda: receiver.data)
        assert receiver.data == b"fresh"
        stream.close()

    run(main())


def test_a_break_is_held_for_a_third_of_a_second_without_blocking(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    states: list[tuple[int, bool]] = []
    original = serial.Serial._update_break_state

    def note(port: serial.Serial) -> None:
        states.append((CLOCK.now_ns(), port.break_condition))
        original(port)

    monkeypatch.setattr(serial.Serial, "_update_break_state", note)

    async def main() -> None:
        stream, _ = await opened(line)
        ticks = 0

        async def tick() -> None:
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0.01)

        ticker = asyncio.create_task(tick())
        await stream.send_break()
        ticker.cancel()
        stream.close()
        assert ticks > 10
        (start_ns, on), (end_ns, off) = states
        assert on and not off
        assert (end_ns - start_ns) * 1e-9 >= 0.29

    run(main())


def test_a_hang_up_is_told_once_and_does_not_spin(line: Line) -> None:
    async def main() -> None:
        stream, receiver = await opened(line)
        reads = 0
        read = os.read

        def count(fd: int, size: int) -> bytes:
            nonlocal reads
            reads += 1
            return read(fd, size)

        os.read = count
        try:
            line.hang_up()
            await until(lambda: receiver.losses)
            await asyncio.sleep(0.1)
        finally:
            os.read = read
        assert len(receiver.losses) == 1
        assert reads <= 2
        stream.write(b"into the void")
        stream.set_baud_rate(115200)
        stream.discard_input()
        await stream.send_break()
        stream.close()
        await asyncio.sleep(0.02)
        assert len(receiver.losses) == 1

    run(main())


def test_after_close_nothing_is_received_nor_reported(line: Line) -> None:
    async def main() -> None:
        stream, receiver = await opened(line)
        stream.close()
        stream.close()
        os.write(line.far, b"late")
        await asyncio.sleep(0.02)
        line.hang_up()
        await asyncio.sleep(0.02)
        assert not receiver.data
        assert receiver.losses == []

    run(main())


def test_no_descriptor_is_left_after_many_connections(line: Line) -> None:
    async def main() -> None:
        others = threading.active_count()  # which earlier tests may have left
        open_port = serial_port_opener(line.path, CLOCK)
        for _ in range(3):
            (await open_port(Receiver())).close()
        await until(lambda: threading.active_count() <= others)
        before = descriptors()
        for _ in range(100):
            stream = await open_port(Receiver())
            stream.write(b"x")
            stream.close()
        await until(lambda: descriptors() <= before)

    run(main())


def test_no_descriptor_is_left_after_hang_ups_and_refusals() -> None:
    async def main() -> None:
        before = None
        for _ in range(30):
            line = Line()
            stream, receiver = await opened(line)
            with pytest.raises(StreamError):
                await opened(line)
            line.hang_up()
            await until(partial(getattr, receiver, "losses"))
            stream.close()
            line.close()
            before = before or len(descriptors())
        await until(lambda: len(descriptors()) <= (before or 0))

    run(main())


def test_an_opening_that_was_cancelled_leaves_nothing_open(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = serial.Serial.open
    release = threading.Event()

    def slow_open(port: serial.Serial) -> None:
        original(port)
        release.wait(2.0)

    async def main() -> None:
        await asyncio.get_running_loop().run_in_executor(None, descriptors)
        before = descriptors()
        monkeypatch.setattr(serial.Serial, "open", slow_open)
        opening = asyncio.create_task(opened(line))
        await until(lambda: len(descriptors()) > len(before))
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        release.set()
        await until(lambda: descriptors() <= before)

    run(main())


def test_closing_a_dead_port_does_not_block_and_the_next_opening_waits_for_it(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = serial.Serial.close
    release = threading.Event()

    def slow_close(port: serial.Serial) -> None:
        release.wait(2.0)
        original(port)

    async def main() -> None:
        open_port = serial_port_opener(line.path, CLOCK)
        stream = await open_port(Receiver())
        monkeypatch.setattr(serial.Serial, "close", slow_close)
        before_ns = CLOCK.now_ns()
        stream.close()
        assert CLOCK.now_ns() - before_ns < 50_000_000
        again = asyncio.ensure_future(open_port(Receiver()))
        await asyncio.sleep(0.05)
        assert not again.done()
        release.set()
        (await again).close()

    run(main())


def refused(path: str) -> StreamError:
    async def main() -> StreamError:
        with pytest.raises(StreamError) as raised:
            await serial_port_opener(path, CLOCK)(Receiver())
        return raised.value

    return run_in_real_time(main())


def test_a_port_that_does_not_exist_is_named_with_those_that_do() -> None:
    error = refused("/dev/serial/by-id/usb-NDI_nothing")
    assert error.errno == errno.ENOENT
    assert error.reason == "/dev/serial/by-id/usb-NDI_nothing does not exist"
    assert "no USB serial adapter is plugged in" in error.remedy or "there are:" in error.remedy


@pytest.mark.parametrize("kind", ["file", "folder", "null"])
def test_what_is_no_serial_port_is_named(kind: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    path = {"file": str(tmp_path / "file"), "folder": str(tmp_path), "null": "/dev/null"}[kind]
    error = refused(path)
    assert error.errno == errno.ENOTTY
    assert error.reason == f"{path} is not a serial port"


def test_a_port_in_use_is_named_and_whoever_has_it_keeps_it(line: Line) -> None:
    async def main() -> None:
        stream, receiver = await opened(line)
        with pytest.raises(StreamError) as raised:
            await opened(line)
        assert raised.value.errno == errno.EBUSY
        assert raised.value.reason == f"another program has locked {line.path}"
        assert "fuser -v" in raised.value.remedy
        os.write(line.far, b"still here")
        await until(lambda: receiver.data == b"still here")
        stream.close()

    run(main())


def test_a_port_without_permission_is_named_with_its_group(line: Line) -> None:
    Path(line.path).chmod(0o000)
    if os.geteuid() == 0:
        os.seteuid(65534)
    try:
        error = refused(line.path)
    finally:
        if os.getuid() == 0:
            os.seteuid(0)
    assert error.errno == errno.EACCES
    assert error.reason == f"no permission to open {line.path}"
    assert "usermod -aG" in error.remedy and "log out" in error.remedy
