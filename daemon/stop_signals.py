"""Ctrl-C and SIGTERM as an event, so that there is one way down."""

import asyncio
import signal
from contextlib import suppress


class StopSignals:
    """From its making on, Ctrl-C and SIGTERM are remembered and no longer end the process."""

    def __init__(self) -> None:
        self._told = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._told.set)

    async def wait(self, duration_s: float | None) -> None:
        """Wait for one of them, or the end of `duration_s`."""
        with suppress(TimeoutError):
            async with asyncio.timeout(duration_s):
                await self._told.wait()
