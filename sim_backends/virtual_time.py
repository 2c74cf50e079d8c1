"""An event loop whose clock jumps to the next deadline: the same code, deterministic, at any speed.

There is no I/O in virtual time. Devices sit in the same process and pass bytes as calls, so a loop
with nothing ready and nothing scheduled can never go on: that is an error, not a wait.
"""

import asyncio
import selectors
from collections import deque
from collections.abc import Callable, Coroutine
from contextvars import Context
from heapq import heappop, heappush
from typing import Any, Final, TypeVar, TypeVarTuple

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

_RESOLUTION_S: Final = 1e-9
"""Timers no further apart are due at once."""


class VirtualTimeDeadlockError(RuntimeError):
    """Every task waits for something that nobody will ever do."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An asyncio event loop in virtual time, starting at 0 s.

    Timers are most of what such a loop does, so it keeps them itself: a heap of tuples, which are
    compared without a call, and first come, first served where two are due at once.
    """

    # What asyncio's own loop keeps, and its stubs leave out.
    _ready: deque[asyncio.Handle]
    _stopping: bool

    def __init__(self) -> None:
        super().__init__(selectors.SelectSelector())  # of which nobody ever asks anything
        self._now_s = 0.0
        self.now_ns = 0
        self._timers: list[tuple[float, int, asyncio.TimerHandle]] = []
        self._number = 0

    def time(self) -> float:
        return self._now_s

    def call_at(
        self,
        when: float,
        callback: Callable[[*Arguments], object],
        *args: *Arguments,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        handle = asyncio.TimerHandle(when, callback, args, self, context)
        self._number += 1
        heappush(self._timers, (when, self._number, handle))
        return handle

    def _run_once(self) -> None:
        """What `run_forever` calls again and again: everything that is due, then the next jump."""
        timers, ready = self._timers, self._ready
        while timers and timers[0][2].cancelled():
            heappop(timers)
        if not (ready or self._stopping):
            self._jump()
        due_s = self._now_s + _RESOLUTION_S
        while timers and timers[0][0] < due_s:
            ready.append(heappop(timers)[2])
        for _ in range(len(ready)):  # what these add has its turn after them
            handle = ready.popleft()
            if not handle.cancelled():
                handle._run()  # noqa: SLF001  as in the method that this one replaces

    def jump(self, ahead_s: float) -> None:
        """As if whatever is running took so long: nothing else runs meanwhile."""
        self._now_s += ahead_s
        self.now_ns = round(self._now_s * 1e9)

    def _jump(self) -> None:
        """To the next deadline."""
        if not self._timers:
            raise VirtualTimeDeadlockError("nothing is ready and nothing is scheduled")
        self._now_s = max(self._now_s, self._timers[0][0])
        self.now_ns = round(self._now_s * 1e9)


class VirtualClock:
    """The clock of a virtual-time loop."""

    virtual = True
    """As `drivers.clock.is_virtual` asks for it."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        self._loop = loop

    def now_ns(self) -> int:
        return self._loop.now_ns

    def wall_time_ns(self) -> int:
        """Virtual time has a date too, always the same: runs compare equal to the last byte."""
        return 1_577_836_800_000_000_000 + self.now_ns()


def run_in_virtual_time(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` to its end in virtual time, like `asyncio.run` does in real time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)


def virtual_clock() -> VirtualClock:
    """The clock of the running virtual-time loop."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    return VirtualClock(loop)
