"""What comes and goes is told as it comes; what flaps is told once a second, with how often."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from drivers.clock import Clock

_AT_ONCE: Final = 16
"""So many changes of one thing are told as they come, ..."""
_EVERY_NS: Final = 1_000_000_000
"""... and where it flaps, one in that time: a tracker that sees a sensor in every other frame would
fill log and recording. Chosen."""

Key = tuple[str, ...]
Words = Mapping[str, Any]
"""What is told of a change. `detail`: in which it is said how many others were not told."""


@dataclass(slots=True)
class _Flapping:
    """How often one thing has changed lately, and what is not told of it yet."""

    present: bool = False
    """As told last."""
    told: int = 0
    """Changes, less one for each `_EVERY_NS` since."""
    since_ns: int = 0
    untold: int = 0

    def may_be_told(self, t_ns: int) -> bool:
        """Whether one more change may be told now, which is counted then."""
        gone = (t_ns - self.since_ns) // _EVERY_NS
        self.told, self.since_ns = max(0, self.told - gone), self.since_ns + gone * _EVERY_NS
        if self.told >= _AT_ONCE:
            return False
        self.told += 1
        return True


class Changes:
    """Of things that come and go, each by its key."""

    def __init__(self, clock: Clock, tell: Callable[[Key, bool, Words], None]) -> None:
        """tell: hears of a change that may be told: whose, whether it came, and what of it."""
        self._clock = clock
        self._tell = tell
        self._flapping: dict[Key, _Flapping] = {}
        self._untold: dict[Key, Words] = {}
        """The newest change of each, where it is another than was told last."""

    def add(self, key: Key, present: bool, words: Words) -> None:
        """It came, or it went."""
        flapping = self._flapping.setdefault(key, _Flapping())
        if not flapping.untold and flapping.may_be_told(self._clock.now_ns()):
            self._tell_change(key, present, words)
            return
        flapping.untold += 1
        if present == flapping.present:
            self._untold.pop(key, None)
        else:
            self._untold[key] = words

    def catch_up(self) -> None:
        """Tell what may be told by now. To be called often."""
        if not self._untold:
            return
        now_ns = self._clock.now_ns()
        for key, words in tuple(self._untold.items()):
            flapping = self._flapping[key]
            if flapping.may_be_told(now_ns):
                del self._untold[key]
                lost = flapping.untold - 1
                more = f"it comes and goes: {lost} changes were not told" if lost else ""
                detail = "; ".join(filter(None, (words.get("detail"), more)))
                flapping.untold = 0
                self._tell_change(key, not flapping.present, {**words, "detail": detail})

    def _tell_change(self, key: Key, present: bool, words: Words) -> None:
        self._flapping[key].present = present
        self._tell(key, present, words)
