"""What an emulated device has still to do, and when."""

import heapq
from collections.abc import Callable
from itertools import count


class Agenda:
    """Actions by host time. While one runs, `now_ns` is the time it was due."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()

    def at(self, t_ns: int, action: Callable[[], None]) -> None:
        """Do it then; what is due at the same time is done in the order it was put down."""
        heapq.heappush(self._due, (max(t_ns, self.now_ns), next(self._order), action))

    def after(self, wait_ns: int, action: Callable[[], None]) -> None:
        """Do it in so long."""
        self.at(self.now_ns + wait_ns, action)

    def clear(self) -> None:
        """Do none of it."""
        self._due.clear()

    def run(self, t_ns: int) -> int | None:
        """Do all that is due up to then; returns when the next thing is due."""
        while self._due and self._due[0][0] <= t_ns:
            self.now_ns, _, action = heapq.heappop(self._due)
            action()
        self.now_ns = max(self.now_ns, t_ns)
        return self._due[0][0] if self._due else None
