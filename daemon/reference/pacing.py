"""How fast a trajectory's own clock goes: slower, where who follows it wants that.

Whoever follows with a lag leads the body along what the reference will be. So a pace that is asked
for counts from some time later on: until then nobody has to take back what was foretold.
"""

from collections import deque
from typing import Final

AGREED_S: Final = 1.2
"""So long before it counts a pace is asked for: as far ahead as a body of a second's lag is led."""


class Pacing:
    """Passes between the clock of the robot and that of the trajectory."""

    def __init__(self) -> None:
        self.asked = 1.0
        """Seconds of the trajectory for each second, of what is not agreed yet."""
        self._agreed: deque[tuple[float, float]] = deque()
        """What comes next, in its order: seconds, and the pace. Empty: all as it is asked."""

    def ask(self, pace: float) -> None:
        """Go on so fast, above 0, after what is agreed."""
        if pace != self.asked and not self._agreed:
            self._agreed.append((AGREED_S, self.asked))
        self.asked = pace

    def advance(self, dt_s: float) -> None:
        """So much time passes."""
        agreed = self._agreed
        if not agreed:
            return
        agreed.append((dt_s, self.asked))
        while agreed and agreed[0][0] <= dt_s:
            dt_s -= agreed.popleft()[0]
        if agreed:
            agreed[0] = agreed[0][0] - dt_s, agreed[0][1]
        if all(pace == self.asked for _, pace in agreed):
            agreed.clear()

    def along(self, from_s: float, to_s: float) -> float:
        """Seconds of the trajectory between two times from now on."""
        return to_s - from_s if self._steady else self._until(to_s) - self._until(from_s)

    def at(self, ahead_s: float) -> float:
        """The pace after so many seconds."""
        for seconds, pace in self._agreed:
            ahead_s -= seconds
            if ahead_s < 0.0:
                return pace
        return self.asked

    @property
    def _steady(self) -> bool:
        return not self._agreed and self.asked == 1.0

    def _until(self, ahead_s: float) -> float:
        along_s = 0.0
        for seconds, pace in self._agreed:
            if ahead_s <= seconds:
                return along_s + ahead_s * pace
            along_s += seconds * pace
            ahead_s -= seconds
        return along_s + ahead_s * self.asked
