"""A serial port on this machine, as a ByteStream that reads and writes in the event loop.

pyserial opens, configures and locks the port; reading is our own, so that a timestamp is taken
where the bytes are read and nothing is ever waited for.
"""

import asyncio
import contextlib
import errno
import grp
import os
import stat
import termios
import threading
from collections import deque
from collections.abc import Callable
from fcntl import ioctl
from pathlib import Path
from struct import unpack

import serial

from drivers.bounded import in_own_thread
from drivers.byte_stream import ByteReceiver, ByteStream, StreamError, StreamOpener
from drivers.clock import Clock

OPENING_BAUD_RATE = 9600

_READ_BYTES = 4096
_MAX_QUEUED_BYTES = 65536
_BREAK_S = 0.3
_DRAIN_POLL_S = 0.002
_OPEN_TIMEOUT_S = 5.0
_CLOSE_TIMEOUT_S = 2.0


def serial_port_opener(path: str, clock: Clock, hardware_handshake: bool = False) -> StreamOpener:
    """Opens the port at `path` anew each time: 8N1, 9600 baud, locked against other programs.

    Its StreamError carries `errno`: ENOENT, EACCES, EBUSY, or another one.
    """
    closing: set[threading.Event] = set()

    async def open_port(receiver: ByteReceiver) -> ByteStream:
        # The lock of a port that is still being closed would look like another program's.
        if closing:
            await in_own_thread(_wait_for_all, set(closing), unwanted=lambda _: None)
        port = await _open_in_thread(path, hardware_handshake)
        return SerialPort(port, receiver, clock, closing)

    return open_port


class SerialPort:
    """An open port. Made by serial_port_opener."""

    def __init__(
        self,
        port: serial.Serial,
        receiver: ByteReceiver,
        clock: Clock,
        closing: set[threading.Event],
    ) -> None:
        self._port = port
        self._fd: int = port.fileno()
        self._receiver = receiver
        self._clock = clock
        self._closing = closing
        self._loop = asyncio.get_running_loop()
        self._queue: deque[bytes | int] = deque()
        self._queued_bytes = 0
        self._timer: asyncio.Handle | None = None
        self._closed = False
        self._loop.add_reader(self._fd, self._readable)

    def write(self, data: bytes) -> None:
        """Queue bytes for sending; most often they are with the kernel when this returns."""
        if self._closed:
            return
        if self._queued_bytes + len(data) > _MAX_QUEUED_BYTES:
            self._lose_soon(_lost("takes no more bytes", errno.EIO))
            return
        self._queue.append(data)
        self._queued_bytes += len(data)
        if len(self._queue) == 1:
            self._send()

    def set_baud_rate(self, baud_rate: int) -> None:
        """Change the rate, in turn with what was written before and after."""
        if self._closed:
            return
        self._queue.append(baud_rate)
        if len(self._queue) == 1:
            self._send()

    def discard_input(self) -> None:
        """Flush what the kernel has received."""
        if not self._closed:
            self._attempt(lambda: termios.tcflush(self._fd, termios.TCIFLUSH))

    async def send_break(self) -> None:
        """Hold the line low for 0.3 s. The calls that time it by themselves block, and are wrong
        by a factor of two."""
        if self._closed:
            return
        self._attempt(lambda: setattr(self._port, "break_condition", True))
        try:
            await asyncio.sleep(_BREAK_S)
        finally:
            if not self._closed:
                self._attempt(lambda: setattr(self._port, "break_condition", False))

    def close(self) -> None:
        """Let go of the port in a thread of its own: a dead adapter can block for half a minute."""
        if self._closed:
            return
        self._closed = True
        self._loop.remove_reader(self._fd)
        self._loop.remove_writer(self._fd)
        if self._timer is not None:
            self._timer.cancel()
        self._queue.clear()
        closed = threading.Event()
        self._closing.add(closed)
        arguments = (self._port, closed, self._closing)
        threading.Thread(target=_close_port, args=arguments, daemon=True).start()

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._lose(error)
            return
        t_ns = self._clock.now_ns()
        if data:
            self._receiver.bytes_received(data, t_ns)
        else:
            self._lose(_lost("was hung up", errno.EIO))

    def _send(self) -> None:
        self._loop.remove_writer(self._fd)
        while self._queue and not self._closed:
            item = self._queue[0]
            if isinstance(item, int):
                if not self._switch_baud_rate(item):
                    return
            elif not self._send_bytes(item):
                return
            self._queue.popleft()

    def _send_bytes(self, data: bytes) -> bool:
        try:
            sent = os.write(self._fd, data)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError as error:
            self._lose_soon(error)
            return False
        self._queued_bytes -= sent
        if sent < len(data):
            self._queue[0] = data[sent:]
            self._loop.add_writer(self._fd, self._send)
            return False
        return True

    def _switch_baud_rate(self, baud_rate: int) -> bool:
        waiting = self._attempt(lambda: unpack("i", ioctl(self._fd, termios.TIOCOUTQ, b"\0" * 4)))
        if waiting is None:
            return False
        if waiting[0] > 0:
            self._timer = self._loop.call_later(_DRAIN_POLL_S, self._send)
            return False
        self._attempt(lambda: setattr(self._port, "baudrate", baud_rate))
        return True

    def _attempt(self, action: "Callable[[], tuple[int] | None]") -> tuple[int] | None:
        """Ask the kernel something about the port; failing means that the port is gone."""
        try:
            return action()
        except (OSError, termios.error, ValueError) as error:
            self._lose_soon(_as_os_error(error))
            return None

    def _lose_soon(self, error: OSError) -> None:
        self._loop.call_soon(self._lose, error)

    def _lose(self, error: OSError) -> None:
        if not self._closed:
            self.close()
            self._receiver.stream_lost(error)


def _wait_for_all(closing: set[threading.Event]) -> None:
    for closed in closing:
        closed.wait(_CLOSE_TIMEOUT_S)


async def _open_in_thread(path: str, hardware_handshake: bool) -> serial.Serial:
    try:
        async with asyncio.timeout(_OPEN_TIMEOUT_S):
            return await in_own_thread(_open, path, hardware_handshake, unwanted=_close_unwanted)
    except TimeoutError:
        raise StreamError(
            errno.ETIMEDOUT,
            f"{path} does not open within {_OPEN_TIMEOUT_S:g} s",
            "unplug the adapter and plug it in again",
        ) from None


def _close_unwanted(port: serial.Serial) -> None:
    port.close()


def _open(path: str, hardware_handshake: bool) -> serial.Serial:
    """Open, configure and lock. Raises StreamError that names the check that failed."""
    _check_node(path)
    try:
        port = serial.Serial(
            path, OPENING_BAUD_RATE, timeout=0, rtscts=hardware_handshake, exclusive=True
        )
    except (OSError, ValueError, termios.error) as error:
        raise _explained(path, _as_os_error(error)) from None
    try:
        _keep_others_out(port, path)
        with contextlib.suppress(ValueError, OSError):  # not every adapter has a latency timer
            port.set_low_latency_mode(True)
    except OSError as error:
        port.close()
        raise _explained(path, error) from None
    return port


def _check_node(path: str) -> None:
    try:
        status = Path(path).stat()
    except OSError as error:
        raise _explained(path, error) from None
    if not stat.S_ISCHR(status.st_mode):
        raise _not_a_port(path)


def _is_pty(path: str) -> bool:
    return os.path.realpath(path).startswith("/dev/pts/")


def _keep_others_out(port: serial.Serial, path: str) -> None:
    """Programs that do not look at locks are kept out as well.

    Not on a pty: there the ban would outlive a client that was killed.
    """
    if not _is_pty(path):
        ioctl(port.fileno(), termios.TIOCEXCL)


def _close_port(
    port: serial.Serial, closed: threading.Event, closing: set[threading.Event]
) -> None:
    with contextlib.suppress(OSError, termios.error):
        # What is still to be sent would hold up closing, on a dead line for very long.
        termios.tcflush(port.fileno(), termios.TCOFLUSH)
    with contextlib.suppress(OSError, termios.error):
        ioctl(port.fileno(), termios.TIOCNXCL)
    with contextlib.suppress(OSError):
        port.close()
    closed.set()
    closing.discard(closed)


def _as_os_error(error: Exception) -> OSError:
    if isinstance(error, OSError):
        return error
    number = error.args[0] if error.args and isinstance(error.args[0], int) else errno.EIO
    return OSError(number, str(error))


def _lost(what: str, number: int) -> OSError:
    return OSError(number, f"the serial port {what}")


def _not_a_port(path: str) -> StreamError:
    return StreamError(
        errno.ENOTTY, f"{path} is not a serial port", "give the port's name, like /dev/ttyUSB0"
    )


def _explained(path: str, error: OSError) -> StreamError:
    number = error.errno or errno.ENOTTY  # pyserial gives none where the settings are refused
    if number == errno.ENOENT:
        return StreamError(number, f"{path} does not exist", _what_there_is())
    if number in (errno.EACCES, errno.EPERM):
        return StreamError(errno.EACCES, f"no permission to open {path}", _how_to_be_allowed(path))
    if number in (errno.EBUSY, errno.EAGAIN):
        return StreamError(
            errno.EBUSY,
            f"another program has locked {path}",
            f"end it; `fuser -v {path}` names it",
        )
    if number in (errno.ENOTTY, errno.EINVAL, errno.EISDIR, errno.ENOTDIR):
        return _not_a_port(path)
    reason = f"{path} is there, but does not work ({os.strerror(number)})"
    return StreamError(number, reason, "unplug the adapter and plug it in again")


def _what_there_is() -> str:
    by_id = Path("/dev/serial/by-id")
    ports = sorted(str(port) for port in by_id.iterdir()) if by_id.is_dir() else []
    if not ports:
        return "no USB serial adapter is plugged in: check the cable and the device's power"
    return "there are: " + ", ".join(ports)


def _how_to_be_allowed(path: str) -> str:
    group = "dialout"
    with contextlib.suppress(OSError, KeyError):
        group = grp.getgrgid(Path(path).stat().st_gid).gr_name
    return f"`sudo usermod -aG {group} $USER`, then log out and in again"
