"""Real time: the only place, with virtual time, that asks the machine what time it is."""

import asyncio
import os
import selectors
import sys
import threading
import time
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Final, TypeVar

T = TypeVar("T")

_CLOSES_WITHIN_S: Final = 10.0
"""For what is left when the work is done; everything of ours ends sooner by itself."""
_BY_FORCE: Final = "something that was cancelled does not end: the process is ended by force"


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
    descriptors must stay below 1024. Unlike `asyncio.run` it does not wait for ever for tasks and
    threads that `main` has left behind and that do not end: the process is ended then.
    """
    watchdog = threading.Timer(_CLOSES_WITHIN_S, _end_by_force)
    watchdog.daemon = True
    try:
        with asyncio.Runner(
            loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())
        ) as runner:
            try:
                return runner.run(main)
            finally:
                watchdog.start()
    finally:
        watchdog.cancel()


def _end_by_force() -> None:
    with suppress(OSError, ValueError):
        print(_BY_FORCE, file=sys.stderr, flush=True)
        sys.stdout.flush()
    os._exit(1)
