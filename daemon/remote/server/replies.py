"""Answers leave by a thread of their own: a client that does not read must not hold the loop."""

import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Final

Reply = Callable[[], None]

_MOST_WAITING: Final = 256


class ReplyThread:
    """Sends answers in their order, urgent ones first. Any thread may hand them in."""

    def __init__(self) -> None:
        self._urgent: deque[Reply] = deque()
        self._others: deque[Reply] = deque()
        self._wake: SimpleQueue[bool] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="remote replies", daemon=True)
        self._thread.start()

    def send(self, reply: Reply, *, urgent: bool = False) -> bool:
        """Have `reply` called; it must not raise. False: too many wait, and it is dropped."""
        waiting = self._urgent if urgent else self._others
        if len(waiting) >= _MOST_WAITING:
            return False
        waiting.append(reply)
        self._wake.put(True)
        return True

    def close(self, within_s: float) -> None:
        """Send what waits, then end; not later than `within_s`. Blocks."""
        self._wake.put(False)
        self._thread.join(within_s)

    def _run(self) -> None:
        # Every True stands for one answer, and False comes after all of them.
        while self._wake.get():
            reply = self._urgent.popleft() if self._urgent else self._others.popleft()
            reply()
