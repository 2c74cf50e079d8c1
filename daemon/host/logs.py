"""The log of a process: lines for people on stderr, which a thread of its own writes.

Whoever logs never waits, and does no input or output: a record is put into a queue, and its
traceback is formatted (which reads source files) by the thread. What one place logs again and again
is written now and then, with how often it came meanwhile.
"""

import logging
import os
import queue
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, TextIO

from daemon.host.clock import MonotonicClock
from daemon.host.log_styles import STYLES, formatter
from drivers.clock import Clock

_KEPT: Final = 1000
"""Records that may wait: as many lines as a terminal that stands still may miss."""
_AGAIN_AFTER_S: Final = 10.0
"""Often enough to see that it goes on; a fault of every bus cycle would be 500 lines a second."""
_MOST_PLACES: Final = 200
"""More than there are in the code that log anything: what differs beyond it shares one limit."""
_CLOSES_WITHIN_S: Final = 1.0


class RateLimit(logging.Filter):
    """Lets one record of each place pass in `again_after_s`. Says in it how many it kept back."""

    def __init__(self, clock: Clock | None = None, again_after_s: float = _AGAIN_AFTER_S) -> None:
        """clock: None: the real one."""
        super().__init__()
        self._clock = MonotonicClock() if clock is None else clock
        self._again_after_s = again_after_s
        self._passed_s: dict[tuple[object, ...], float] = {}
        self._kept_back: dict[tuple[object, ...], int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        kind = record.exc_info[0] if record.exc_info else None
        place: tuple[object, ...] = (record.pathname, record.lineno, str(record.msg), kind)
        if place not in self._passed_s and len(self._passed_s) >= _MOST_PLACES:
            place = ()
        now_s = self._clock.now_ns() * 1e-9
        if now_s - self._passed_s.get(place, -float("inf")) < self._again_after_s:
            self._kept_back[place] = self._kept_back.get(place, 0) + 1
            return False
        self._passed_s[place] = now_s
        record.kept_back = self._kept_back.pop(place, 0)
        return True


class _Queued(logging.Handler):
    """Hands records to the thread; what does not fit is counted."""

    def __init__(self, waiting: "queue.Queue[logging.LogRecord | None]") -> None:
        super().__init__()
        self.lost = 0
        self._waiting = waiting
        self.addFilter(RateLimit())

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._waiting.put_nowait(record)
        except queue.Full:
            self.lost += 1


class Log:
    """What is told beside errors: a line for each happening, by the same thread."""

    def __init__(self, handler: _Queued) -> None:
        self._handler = handler

    def tell(self, level: int, source: str, text: str, **fields: object) -> None:
        """Never waits. level: as in `logging`. fields: for programs."""
        record = logging.LogRecord(source, level, source, 0, text, None, None)
        record.fields = fields
        self._handler.emit(record)  # however often it happens: each is told


_STYLE: Final = "TENTACLED_LOG_STYLE"
"""In the environment of processes whose lines come to the stderr of the one that started them."""


@contextmanager
def logging_to_stderr(
    process: str, stream: TextIO | None = None, style: str | None = None
) -> Iterator[Log]:
    """All loggers of this process write to stderr while the block lasts: errors with tracebacks.

    process: its name, in each line. stream: another one than stderr. style: one of
    `daemon.host.log_styles.STYLES`, for the processes that this one starts, too; None: as the one
    that has started this one. At the end what waits is still written, for at most a second.
    """
    if style is None:
        style = os.environ.get(_STYLE, STYLES[0])
    inherited = os.environ.get(_STYLE)
    os.environ[_STYLE] = style
    waiting: queue.Queue[logging.LogRecord | None] = queue.Queue(_KEPT)
    handler = _Queued(waiting)
    lines = formatter(style, process)
    out = sys.stderr if stream is None else stream

    def write() -> None:
        while (record := waiting.get()) is not None:
            kept_back = getattr(record, "kept_back", 0)
            record.repeated = f" (and {kept_back} times more before)" if kept_back else ""
            try:
                out.write(lines.format(record) + "\n")
                out.flush()
            except (OSError, ValueError):
                pass  # nobody reads it any more

    thread = threading.Thread(target=write, name="log", daemon=True)
    root = logging.getLogger()
    root.addHandler(handler)
    thread.start()
    try:
        yield Log(handler)
    finally:
        root.removeHandler(handler)
        os.environ.pop(_STYLE)
        if inherited is not None:
            os.environ[_STYLE] = inherited
        try:
            waiting.put_nowait(None)
        except queue.Full:
            pass  # a stream that takes nothing: what waits goes with the process
        else:
            thread.join(_CLOSES_WITHIN_S)
