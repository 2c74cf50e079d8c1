"""Errors of our own, kept for whoever must mend them: each is published with its traceback.

Whatever is logged as an error anywhere in the process while a robot is at work becomes a message,
and so a part of the recording. Tracebacks are formatted off the loop: that reads source files.
"""

import asyncio
import logging
import threading
import traceback
from collections.abc import Callable
from functools import partial
from typing import Final

from daemon.host.logs import RateLimit
from daemon.messages import InternalError, Message
from daemon.service.motion_loader import OffTheLoop
from drivers.clock import Clock

_LONGEST_TRACEBACK: Final = 20_000
"""Characters, from the end: the innermost calls say what went wrong. A deep recursion has more."""
_FLUSH_WITHIN_S: Final = 1.0
"""Formatting takes milliseconds, but for a disk that stands still."""


class InternalErrors(logging.Handler):
    """A handler of the root logger, from `open` to `end`. To be made on the event loop."""

    def __init__(
        self, clock: Clock, publish: Callable[[Message], None], off_the_loop: OffTheLoop
    ) -> None:
        """off_the_loop: where tracebacks are formatted."""
        super().__init__(logging.ERROR)
        self._clock = clock
        self._publish = publish
        self._off_the_loop = off_the_loop
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._formatting: set[asyncio.Task[None]] = set()
        self.addFilter(RateLimit(clock))

    def open(self) -> None:
        logging.getLogger().addHandler(self)

    async def end(self) -> None:
        """What was logged until now is published, within a second."""
        logging.getLogger().removeHandler(self)
        if self._formatting:
            await asyncio.wait(self._formatting, timeout=_FLUSH_WITHIN_S)

    def emit(self, record: logging.LogRecord) -> None:
        t_ns = self._clock.now_ns()
        if threading.get_ident() == self._thread:
            self._begin(record, t_ns)
        elif not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._begin, record, t_ns)

    def _begin(self, record: logging.LogRecord, t_ns: int) -> None:
        task = self._loop.create_task(self._keep(record, t_ns))
        self._formatting.add(task)
        task.add_done_callback(self._formatting.discard)

    async def _keep(self, record: logging.LogRecord, t_ns: int) -> None:
        try:
            message = await self._off_the_loop(partial(_as_message, record, t_ns))
        except TimeoutError:
            message = _message(record, t_ns, record.name, "")
        self._publish(message)


def _as_message(record: logging.LogRecord, t_ns: int) -> InternalError:
    lines = traceback.format_exception(*record.exc_info) if record.exc_info else []
    return _message(record, t_ns, record.getMessage(), "".join(lines)[-_LONGEST_TRACEBACK:])


def _message(record: logging.LogRecord, t_ns: int, text: str, trace: str) -> InternalError:
    return InternalError(
        t_ns=t_ns,
        place=f"{record.name}:{record.lineno}",
        text=text,
        traceback=trace,
        kept_back=getattr(record, "kept_back", 0),
    )
