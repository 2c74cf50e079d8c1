"""What is due when: one queue of timers for a bus and everything that lives on it."""

from collections.abc import Callable
from heapq import heappush
from typing import Any

NEVER_NS = 1 << 62


class EventQueue:
    """Timers in the order of their time; of those due at the same time, in the order of setting."""

    def __init__(self) -> None:
        self.heap: list[tuple[Any, ...]] = []
        """(t_ns, number, timer), or (t_ns, number, None, ...) for what the bus keeps here."""
        self.number = 0
        """Counts up with every entry: it orders what is due at the same time."""

    def timer(self, action: Callable[[int], None]) -> "Timer":
        """A timer that calls `action(t_ns)` when it is due."""
        return Timer(self, action)


class Timer:
    """Calls its action once, at the time it was last set to.

    Made for deadlines that move with every frame: to set it to later costs an attribute.
    """

    __slots__ = ("_action", "_queue", "_queued_ns", "due_ns")

    def __init__(self, queue: EventQueue, action: Callable[[int], None]) -> None:
        self._queue = queue
        self._action = action
        self._queued_ns = NEVER_NS
        self.due_ns = NEVER_NS

    def set(self, t_ns: int) -> None:
        """Be due at `t_ns`, and no longer when it was due before."""
        self.due_ns = t_ns
        if t_ns < self._queued_ns:
            self._queued_ns = t_ns
            self._queue.number += 1
            heappush(self._queue.heap, (t_ns, self._queue.number, self))

    def cancel(self) -> None:
        """Never be due."""
        self.due_ns = NEVER_NS

    @property
    def running(self) -> bool:
        """Whether it is going to be due."""
        return self.due_ns != NEVER_NS

    def fire(self, t_ns: int) -> None:
        """An entry of this timer has come up."""
        if t_ns != self._queued_ns:
            return  # an entry for which an earlier one was queued since
        self._queued_ns = NEVER_NS
        due_ns = self.due_ns
        if due_ns > t_ns:
            if due_ns != NEVER_NS:
                self.set(due_ns)
            return
        self.due_ns = NEVER_NS
        self._action(t_ns)
