"""Shows how far long work is: one line that is written over, or a line now and then. On stderr."""

import shutil
import sys
from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from typing import Final, TextIO

from daemon.host.clock import MonotonicClock
from daemon.host.progress import Milestones, Pace
from drivers.clock import Clock

_EACH_S: Final = 0.2
"""Between two lines on a terminal."""
_SILENT_S: Final = 0.5
"""What takes no longer is not shown at all."""
_ENDS_WITHIN_S: Final = 2.0
_CLEAR: Final = "\r\x1b[K"


class _Place:
    """Where lines go: the last line of a terminal, or one after the other."""

    def __init__(self, out: TextIO) -> None:
        self.on_terminal = out.isatty()
        self._out = out
        self._there = False
        """Whether there is a line of ours on the terminal."""

    def show(self, line: str) -> None:
        """Instead of the one that is there; below it where there is no terminal."""
        if not self.on_terminal:
            self._write(f"{line}\n")
            return
        columns = shutil.get_terminal_size().columns - 1
        self._write(f"{_CLEAR}{line[:columns]}")
        self._there = True

    def take_away(self) -> None:
        """What is there, if it can be."""
        if self._there:
            self._write(_CLEAR)
            self._there = False

    def _write(self, text: str) -> None:
        try:
            self._out.write(text)
            self._out.flush()
        except (OSError, ValueError):  # nobody reads it: no reason to stop
            self.on_terminal = self._there = False


class ProgressLine:
    """A `daemon.host.progress.Progress` for people. What is told otherwise comes past it.

    Where stderr is a terminal, its last line is ours, and is taken away in the end.
    """

    def __init__(
        self, out: TextIO | None = None, clock: Clock | None = None, place: _Place | None = None
    ) -> None:
        """out: instead of stderr. clock: instead of the machine's. place: that is shared."""
        self._place = _Place(sys.stderr if out is None else out) if place is None else place
        self._clock = MonotonicClock() if clock is None else clock
        self._pace: Pace | None = None
        self._milestones = Milestones(0.0)
        self._shown_s = 0.0

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def between(self) -> "ProgressLine":
        """For what is done now and then while something else goes on, on the same line."""
        return ProgressLine(clock=self._clock, place=self._place)

    def begin(self, what: str, total: float, done: float = 0.0) -> None:
        """Something else begins: what was before is over."""
        self.end()
        now_s = self._now_s()
        self._pace, self._milestones = Pace(what, total, now_s, done), Milestones(now_s)
        self._shown_s = now_s + _SILENT_S - _EACH_S

    def advance(self, by: float = 1.0) -> None:
        if self._pace is not None:
            self.reach(self._pace.done + by)

    def reach(self, done: float, total: float = 0.0, what: str = "") -> None:
        if self._pace is None:
            return
        now_s = self._now_s()
        self._pace.total = total or self._pace.total
        self._pace.what = what or self._pace.what
        self._pace.reach(done, now_s)
        self._show(self._pace, now_s)

    def tell(self, text: str, out: TextIO | None = None) -> None:
        """Something that is to stay, past the line that is written over. out: instead of stdout."""
        self._place.take_away()
        print(text, file=out, flush=True)

    def end(self) -> None:
        """Nothing is being done; the line goes."""
        self._place.take_away()
        self._pace = None

    def _show(self, pace: Pace, now_s: float) -> None:
        if not self._place.on_terminal:
            pace.to_go_s(now_s)  # it is smoothed from look to look
            if self._milestones.due(pace.share, now_s):
                self._place.show(pace.line(now_s))
        elif now_s - self._shown_s >= _EACH_S:
            self._shown_s = now_s
            self._place.show(pace.line(now_s))

    def _now_s(self) -> float:
        return self._clock.now_ns() * 1e-9


class Aside:
    """The same for who must never wait: a thread of its own tells it."""

    def __init__(self, progress: ProgressLine) -> None:
        self._progress = progress
        self._told: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = Thread(target=self._tell, name="progress", daemon=True)

    def __enter__(self) -> "Aside":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._told.put(None)
        self._thread.join(_ENDS_WITHIN_S)

    def begin(self, what: str, total: float, done: float = 0.0) -> None:
        self._told.put(lambda: self._progress.begin(what, total, done))

    def advance(self, by: float = 1.0) -> None:
        self._told.put(lambda: self._progress.advance(by))

    def reach(self, done: float, total: float = 0.0, what: str = "") -> None:
        self._told.put(lambda: self._progress.reach(done, total, what))

    def tell(self, text: str) -> None:
        """Something that is to stay."""
        self._told.put(lambda: self._progress.tell(text))

    def _tell(self) -> None:
        while (told := self._told.get()) is not None:
            told()
