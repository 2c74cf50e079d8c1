"""Real time: the only place, with virtual time, that asks the machine what time it is."""

import asyncio
import selectors
import time
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class MonotonicClock:
    """CLOCK_MONOTONIC, the clock that asyncio's loop and timerfd go by too."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def wall_time_ns(self) -> int:
        return time.time_ns()


class ThreadTimeClock:
    """Computing time of the thread that asks: it stands still while others have the processor."""

    def now_ns(self) -> int:
        return time.thread_time_ns()


def run_in_real_time(main: Coroutine[Any, Any, T]) -> T:
    """Like `asyncio.run`, with timers true to the microsecond.

    epoll rounds a timeout up to whole milliseconds, select does not; the price is that file
    descriptors must stay below 1024.
    """
    with asyncio.Runner(
        loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())
    ) as runner:
        return runner.run(main)
