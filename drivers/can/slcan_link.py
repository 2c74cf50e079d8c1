"""A serial CAN adapter (SLCAN), read and written directly once python-can has opened it.

python-can drains the serial line after every frame and reads it byte by byte; a cycle of seven
frames then costs more than the cycle. The adapter is asked for its status flags from time to time,
which is also how its silence is noticed: some do not know the question, but pass on frames.
"""

import array
import asyncio
import errno
import fcntl
import os
import termios
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

import can
from can.interfaces.slcan import slcanBus

from drivers.can.conditions import ERRORS, OFF, OVERFLOW, PASSIVE, QUEUE_FULL
from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG, CanFrame
from drivers.can.link import FrameReceiver
from drivers.can.slcan import (
    AdapterStatus,
    Close,
    LineReader,
    Open,
    ReadStatus,
    Received,
    Refused,
    SlcanError,
    StatusFlag,
    decode_data_frame,
    decode_reply,
    encode_command,
    encode_frame,
)
from drivers.clock import Clock
from drivers.conditions import Condition

_READ_BYTES: Final = 4096
_BACKLOG_BYTES: Final = 512  # about one cycle of twelve axes: behind more, targets grow old
_ASK_EVERY_S: Final = 0.5
_CLOSING_LOOKS: Final = 20
_CLOSING_LOOK_S: Final = 0.01  # 0.2 s in all: 512 bytes at 57 600 baud take half of it
_CONTROL_CHARACTERS: Final = 6
_REFUSALS_OF_BUS_OFF: Final = 8
_NOT_DATA: Final = EXTENDED_FLAG | REMOTE_FLAG
_CONDITION_OF_FLAG: Final = (
    (StatusFlag.ERROR_PASSIVE, PASSIVE),
    (StatusFlag.BUS_ERROR, ERRORS),
    (StatusFlag.RECEIVE_QUEUE_FULL | StatusFlag.DATA_OVERRUN, OVERFLOW),
)


class SlcanLink:
    """An open SLCAN adapter."""

    def __init__(
        self,
        bus: slcanBus,
        receiver: FrameReceiver,
        clock: Clock,
        on_closed: Callable[[], None] = lambda: None,
    ) -> None:
        """on_closed: called when the port has been let go of, in a thread of its own."""
        self._bus = bus
        self._on_closed = on_closed
        self._receiver = receiver
        self._clock = clock
        self._lines = LineReader()
        self._fd: int = bus.serialPortOrig.fileno()
        os.set_blocking(self._fd, False)
        _let_empty_reads_say_so(self._fd)
        self._unsent = b""
        self._answered = True
        self._refused_in_a_row = 0
        self._off = self._full = False
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self.drain)
        self._asking = self._loop.call_later(_ASK_EVERY_S, self._ask)

    def send(self, can_id: int, data: bytes) -> bool:
        return self.send_all([(can_id, data)]) == 1

    def send_all(self, frames: Sequence[tuple[int, bytes]]) -> int:
        """One write for all of them."""
        if not self._open or self._off:
            return 0
        lines = b"".join([encode_frame(CanFrame(can_id, data)) for can_id, data in frames])
        sent = _backlog(self._fd) < _BACKLOG_BYTES and self._write(lines)
        if sent is self._full:
            self._full = not sent
            self._receiver.condition_seen(QUEUE_FULL, self._full, "serial line")
        return len(frames) if sent else 0

    def read_in_cycle(self, on: bool) -> None:
        if not self._open:
            return
        if on:
            self._loop.remove_reader(self._fd)
        else:
            self._loop.add_reader(self._fd, self.drain)

    def close(self) -> None:
        if self._open:
            self._open = False
            self._asking.cancel()
            self._loop.remove_reader(self._fd)
            self._write(encode_command(Close()))
            # What a dead adapter never takes would hold up its closing for half a minute.
            threading.Thread(target=self._let_go, name="slcan close", daemon=True).start()

    def _let_go(self) -> None:
        try:
            with suppress(OSError, termios.error):
                _wait_until_sent(self._fd)
                termios.tcflush(self._fd, termios.TCOFLUSH)
            abandon(self._bus)
        finally:
            self._on_closed()

    def _write(self, line: bytes) -> bool:
        """Write lines, behind what is left of those before. False: nothing of them was taken."""
        try:
            if self._unsent:
                self._unsent = self._unsent[os.write(self._fd, self._unsent) :]
                if self._unsent:
                    return False
            self._unsent = line[os.write(self._fd, line) :]
        except BlockingIOError:
            return False
        except OSError as error:
            self._lose(error)
            return False
        return True

    def drain(self) -> None:
        if not self._open:
            return
        t_ns = self._clock.now_ns()
        try:
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(error)
            return
        if not data:
            self._lose(OSError(errno.EIO, "the serial port has been unplugged"))
            return
        for line in self._lines.feed(data):
            self._line(line, t_ns)

    def _line(self, line: bytes, t_ns: int) -> None:
        if not self._open:
            return
        frame = decode_data_frame(line)
        if frame is not None:
            self._answered, self._refused_in_a_row = True, 0  # off the bus it would hear none
            self._receiver.frame_received(frame.can_id, frame.data, t_ns)
            return
        try:
            reply = decode_reply(line)
        except SlcanError:  # a byte was lost: the next line is whole again
            self._pass(OVERFLOW, line[:20].decode("ascii", "replace"))
            return
        self._answered = True
        if isinstance(reply, Received):
            self._refused_in_a_row = 0
            if not reply.frame.can_id & _NOT_DATA:
                self._receiver.frame_received(reply.frame.can_id, reply.frame.data, t_ns)
        elif isinstance(reply, Refused):
            self._refused_in_a_row += 1
            if self._refused_in_a_row == _REFUSALS_OF_BUS_OFF:
                self._bus_off(True)
        elif isinstance(reply, AdapterStatus):
            self._status(reply.flags)
        else:
            self._refused_in_a_row = 0

    def _status(self, flags: int) -> None:
        for bits, condition in _CONDITION_OF_FLAG:
            if flags & bits:
                self._receiver.condition_seen(condition, True, f"status flags {flags:#04x}")
            else:
                self._receiver.condition_seen(condition, False, "")

    def _ask(self) -> None:
        """Ask for the status; an adapter off the bus is closed and opened again."""
        if not self._answered:
            self._lose(OSError(errno.ETIMEDOUT, "the adapter does not answer"))
            return
        if self._off:
            self._bus_off(False)
            self._write(encode_command(Close()) + encode_command(Open()))
        self._answered = False
        self._write(encode_command(ReadStatus()))
        self._asking = self._loop.call_later(_ASK_EVERY_S, self._ask)

    def _bus_off(self, off: bool) -> None:
        self._off, self._refused_in_a_row = off, 0
        self._receiver.condition_seen(OFF, off, "the adapter refuses every frame")

    def _pass(self, condition: Condition, detail: str) -> None:
        self._receiver.condition_seen(condition, True, detail)
        self._receiver.condition_seen(condition, False, "")

    def _lose(self, error: OSError) -> None:
        if self._open:
            self.close()
            self._receiver.link_lost(error)


def _backlog(fd: int) -> int:
    """Bytes that the operating system has not put on the line yet."""
    waiting = array.array("i", [0])
    try:
        fcntl.ioctl(fd, termios.TIOCOUTQ, waiting)
    except OSError:
        return 0
    return waiting[0]


def _wait_until_sent(fd: int) -> None:
    """For the last command, at most; in a thread that may wait."""
    pause = threading.Event()
    for _ in range(_CLOSING_LOOKS):
        if not _backlog(fd):
            return
        pause.wait(_CLOSING_LOOK_S)


def abandon(bus: slcanBus) -> None:
    """Close the port as it is. The bus' own way down would write to it first."""
    bus.serialPortOrig.close()
    can.BusABC.shutdown(bus)


def _let_empty_reads_say_so(fd: int) -> None:
    """pyserial's settings let a read without data look like the end of the line."""
    settings = termios.tcgetattr(fd)
    settings[_CONTROL_CHARACTERS][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, settings)
