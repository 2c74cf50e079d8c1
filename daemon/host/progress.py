"""How far long work is, and how long it still takes: in words, without a clock and without output.

Whoever does long work tells a `Progress`; `Pace` makes a line of what it hears; who shows that line
is another matter (`daemon.commands.terminal.progress_line`).
"""

from collections import deque
from typing import Final, Protocol


class Progress(Protocol):
    """Hears how far long work is."""

    def begin(self, what: str, total: float, done: float = 0.0) -> None:
        """Something of `total` parts begins; `done` of them were there before."""
        ...

    def advance(self, by: float = 1.0) -> None:
        """So many parts more are done."""
        ...

    def reach(self, done: float, total: float = 0.0, what: str = "") -> None:
        """So many parts are done, together with those that were there before.

        total, what: where they have turned out to be others.
        """
        ...


class Unheard:
    """A `Progress` where nobody listens."""

    def begin(self, what: str, total: float, done: float = 0.0) -> None:
        del what, total, done

    def advance(self, by: float = 1.0) -> None:
        del by

    def reach(self, done: float, total: float = 0.0, what: str = "") -> None:
        del done, total, what


_BASIS_S: Final = 3.0
"""Before this there is no time to go: what comes first is not like the rest."""
_BASIS_SHARE: Final = 0.02
_BASIS_STEPS: Final = 2
"""Times that something was done, for the same reason."""
_WINDOW_S: Final = 30.0
_WINDOW_SHARE: Final = 0.5
"""Of the time that has passed. The pace is that of the last part of it, or of so many seconds if
they are more: work does not take its time evenly."""
_SMOOTH_S: Final = 5.0
"""Within this what is shown follows what was reckoned."""
_SAMPLES: Final = 512


class Pace:
    """Of one piece of work, told by its time, whatever clock that is from."""

    def __init__(self, what: str, total: float, now_s: float, done: float = 0.0) -> None:
        """total, done: in parts of any kind; a total of 0 is one that nobody knows."""
        self.what = what
        self.total = total
        self.done = min(done, total) if total > 0.0 else done
        self._began_s = now_s
        self._first = self.done
        self._steps = 0
        self._samples: deque[tuple[float, float]] = deque([(now_s, self.done)], maxlen=_SAMPLES)
        self._end_s: float | None = None
        """When it will be done, as it is shown."""
        self._shown_s = now_s

    def reach(self, done: float, now_s: float) -> None:
        """So much is done. It never becomes less."""
        if done > self.done:
            self._steps += 1
            self.done = min(done, self.total) if self.total > 0.0 else done
            self._samples.append((now_s, self.done))

    @property
    def share(self) -> float | None:
        """Of the whole, 0 to 1; None where nobody knows the whole."""
        return None if self.total <= 0.0 else self.done / self.total

    def elapsed_s(self, now_s: float) -> float:
        """Since it began."""
        return now_s - self._began_s

    def to_go_s(self, now_s: float) -> float | None:
        """Smoothed; None as long as there is no basis for it, 0 when all is done."""
        if self.total > 0.0 and self.done >= self.total:
            return 0.0
        reckoned_s = self._reckoned_s(now_s)
        if reckoned_s is None:
            return None
        end_s = now_s + reckoned_s
        if self._end_s is None:
            self._end_s = end_s
        else:
            weight = min(max(now_s - self._shown_s, 0.0) / _SMOOTH_S, 1.0)
            self._end_s += weight * (end_s - self._end_s)
        self._shown_s = now_s
        return max(self._end_s - now_s, 0.0)

    def line(self, now_s: float) -> str:
        """What is being done, how much of it is done, and how long it still takes."""
        share = self.share
        told = [self.what]
        if share is not None:
            told.append(f"{share:.0%}")
        to_go_s = self.to_go_s(now_s)
        if to_go_s is not None and share != 1.0:
            told.append(f"{duration(to_go_s)} to go")
        elif share is None:
            told.append(f"{self.elapsed_s(now_s):.0f} s so far")
        return ", ".join(told)

    def _reckoned_s(self, now_s: float) -> float | None:
        """From the pace lately. Time in which nothing was done counts too."""
        passed_s = self.elapsed_s(now_s)
        share = self.share
        if share is None or passed_s < _BASIS_S or self._steps < _BASIS_STEPS:
            return None
        if self.done - self._first < _BASIS_SHARE * (self.total - self._first):
            return None
        since_s = now_s - max(_WINDOW_S, _WINDOW_SHARE * passed_s)
        then_s, then = self._samples[0]
        for at_s, done in self._samples:
            if at_s > since_s:
                break
            then_s, then = at_s, done
        if self.done <= then:  # nothing for the whole window: the pace of all of it
            then_s, then = self._began_s, self._first
        return (self.total - self.done) * (now_s - then_s) / (self.done - then)


def duration(seconds: float) -> str:
    """As exact as a guess is: `a few seconds`, `about 40 s`, `about 3 min`, `about 1 h 20 min`."""
    if seconds < 7.5:
        return "a few seconds"
    if seconds < 57.5:
        return f"about {5 * round(seconds / 5):.0f} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"about {minutes} min"
    hours, minutes = divmod(10 * round(seconds / 600), 60)
    return f"about {hours} h {minutes} min" if minutes else f"about {hours} h"


_EACH_SHARE: Final = 0.1
_EACH_S: Final = 30.0
_NOT_SOONER_S: Final = 10.0


class Milestones:
    """When to tell of it where every line stays: each tenth, each half minute, and at its end."""

    def __init__(self, now_s: float) -> None:
        self._told_s = now_s
        self._told_share = 0.0

    def due(self, share: float | None, now_s: float) -> bool:
        """Whether a line is to be told now; short work has none at all."""
        waited_s = now_s - self._told_s
        far = share is not None and share - self._told_share >= _EACH_SHARE - 1e-9
        if waited_s < _NOT_SOONER_S or not (far or waited_s >= _EACH_S):
            return False
        self._told_s = now_s
        self._told_share = share or 0.0
        return True
