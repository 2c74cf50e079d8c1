"""The bus cycle's rhythm: absolute deadlines from the kernel, whole periods skipped when late."""

import asyncio
import ctypes
import os
import struct
import sys
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

_CLOCK_MONOTONIC: Final = 1
_TFD_TIMER_ABSTIME: Final = 1
_TFD_FLAGS: Final = os.O_NONBLOCK | os.O_CLOEXEC
_ITIMERSPEC: Final = struct.Struct("@qqqq")
_NS_PER_S: Final = 1_000_000_000


class Tick(NamedTuple):
    """One beat: when it was due, and how many beats were skipped since the last one."""

    due_ns: int
    skipped: int


class PeriodicTimer(Protocol):
    """Calls back once a period until stopped."""

    def stop(self) -> None:
        """No call-back after this."""
        ...


class TimerFd:
    """A periodic timer on CLOCK_MONOTONIC, read by the running event loop."""

    def __init__(self, first_ns: int, period_ns: int, on_tick: Callable[[Tick], None]) -> None:
        self._due_ns = first_ns - period_ns
        self._period_ns = period_ns
        self._on_tick = on_tick
        self._loop = asyncio.get_running_loop()
        self._fd = timerfd(first_ns, period_ns)
        self._loop.add_reader(self._fd, self._readable)

    def stop(self) -> None:
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1

    def _readable(self) -> None:
        try:
            expirations = int.from_bytes(os.read(self._fd, 8), sys.byteorder)
        except BlockingIOError:
            return
        self._due_ns += expirations * self._period_ns
        self._on_tick(Tick(self._due_ns, expirations - 1))


class LoopTimer:
    """The same on the event loop's own clock, for virtual time."""

    def __init__(self, first_ns: int, period_ns: int, on_tick: Callable[[Tick], None]) -> None:
        self._due_ns = first_ns
        self._period_ns = period_ns
        self._on_tick = on_tick
        self._loop = asyncio.get_running_loop()
        self._handle = self._loop.call_at(first_ns * 1e-9, self._beat)

    def stop(self) -> None:
        self._handle.cancel()

    def _beat(self) -> None:
        due_ns = self._due_ns
        self._due_ns += self._period_ns
        self._handle = self._loop.call_at(self._due_ns * 1e-9, self._beat)
        self._on_tick(Tick(due_ns, 0))


def timerfd(first_ns: int, period_ns: int) -> int:
    """A timerfd that expires first at `first_ns`, then every `period_ns`."""
    libc = ctypes.CDLL(None, use_errno=True)
    fd = int(libc.timerfd_create(_CLOCK_MONOTONIC, _TFD_FLAGS))
    if fd < 0:
        raise OSError(ctypes.get_errno(), "timerfd_create")
    setting = _ITIMERSPEC.pack(*divmod(period_ns, _NS_PER_S), *divmod(first_ns, _NS_PER_S))
    if libc.timerfd_settime(fd, _TFD_TIMER_ABSTIME, setting, None) != 0:
        error = ctypes.get_errno()
        os.close(fd)
        raise OSError(error, "timerfd_settime")
    return fd
