"""Ctrl-C, Ctrl-\\, SIGTERM and SIGHUP, so that there is one way down whoever wants it."""

import asyncio
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

_STDOUT: Final = 1
_STDERR: Final = 2


class StopSignals:
    """From its making on, these signals are remembered and no longer end the process; but for a
    second Ctrl-\\, for whoever does not wait for the way down."""

    def __init__(self) -> None:
        self._requested = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._requested.set)
        loop.add_signal_handler(signal.SIGQUIT, self._quit)
        if _hang_ups_count():
            hang_up = _for_a_terminal_that_goes(self._requested.set)
            loop.add_signal_handler(signal.SIGHUP, hang_up)

    def _quit(self) -> None:
        self._requested.set()
        asyncio.get_running_loop().remove_signal_handler(signal.SIGQUIT)

    async def wait(self, duration_s: float | None) -> None:
        """Wait for one of them, or the end of `duration_s`."""
        with suppress(TimeoutError):
            async with asyncio.timeout(duration_s):
                await self._requested.wait()


@contextmanager
def all_like_ctrl_c() -> Iterator[None]:
    """While the block lasts, SIGTERM and SIGHUP do what Ctrl-C does: for work that is not told of
    signals but interrupted by them, and keeps what it has. Main thread only."""

    def interrupt() -> None:
        # A shell's background jobs ignore Ctrl-C; to be ended they may still be told.
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            raise KeyboardInterrupt
        signal.raise_signal(signal.SIGINT)

    handlers = {signal.SIGTERM: interrupt}
    if _hang_ups_count():
        handlers[signal.SIGHUP] = _for_a_terminal_that_goes(interrupt)
    before = {
        number: signal.signal(number, lambda *_, handler=handler: handler())
        for number, handler in handlers.items()
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _hang_ups_count() -> bool:
    """Not where somebody wants us to survive them, as `nohup` does."""
    return signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN


def _for_a_terminal_that_goes(stop: Callable[[], None]) -> Callable[[], None]:
    """Stops; before that, what is printed goes nowhere if it went to a terminal: that is about to
    go, and an error of a `print` must not come between a robot and its quick stop."""
    on_terminal = [number for number in (_STDOUT, _STDERR) if os.isatty(number)]

    def handler() -> None:
        # Not asked whether it is still there: the signal often comes before it has gone.
        if on_terminal:
            nowhere = os.open(os.devnull, os.O_WRONLY | os.O_CLOEXEC)
            for number in on_terminal:
                os.dup2(nowhere, number)
            os.close(nowhere)
        stop()

    return handler
