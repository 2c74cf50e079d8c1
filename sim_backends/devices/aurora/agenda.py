"""What an emulated device has still to do, and when."""

import heapq
from collections.abc import Callable
from itertools import count


class Agenda:
    """Actions by host time. While one runs, `now_ns` is the time it was due."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns
        self._due: list[tuple[int, int, Callable[[], None], int]] = []
        self._order = count()

    def at(self, t_ns: int, action: Callable[[], None], unseen_ns: int = 0) -> None:
        """Do it then; what is due at the same time is done in the order it was put down.

        unseen_ns: for how long nobody outside can see whether it was done. So long it may wait for
        other things; it will not know.
        """
        if t_ns < self.now_ns:
            t_ns = self.now_ns
        heapq.heappush(self._due, (t_ns, next(self._order), action, t_ns + unseen_ns))

    def after(self, wait_ns: int, action: Callable[[], None]) -> None:
        """Do it in so long."""
        self.at(self.now_ns + wait_ns, action)

    def clear(self) -> None:
        """Do none of it."""
        self._due.clear()

    def run(self, t_ns: int) -> int | None:
        """Do all that is due up to then; returns when it has to be called again."""
        due = self._due
        while due and due[0][0] <= t_ns:
            self.now_ns, _, action, _ = heapq.heappop(due)
            action()
        if t_ns > self.now_ns:
            self.now_ns = t_ns
        next_ns = None
        for _, _, _, seen_ns in due:
            if next_ns is None or seen_ns < next_ns:
                next_ns = seen_ns
        return next_ns
