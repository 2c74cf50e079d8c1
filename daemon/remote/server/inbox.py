"""What zenoh's threads hand to the event loop: bounded, stops first, the newest set-point wins."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from typing import Final, Generic, TypeVar

from drivers.clock import Clock

T = TypeVar("T")

_MOST_WAITING: Final = 16


class Inbox(Generic[T]):
    """Questions per asker, and one place for a set-point per asker.

    `stop`, `question` and `setpoint` may be called from any thread: they only leave things and
    wake the loop. Between two questions the loop gets round to its other work.
    """

    def __init__(self, askers: Iterable[str]) -> None:
        self._questions: dict[str, deque[T]] = {asker: deque() for asker in askers}
        self._stops: dict[str, deque[T]] = {asker: deque() for asker in self._questions}
        self._turns = deque(self._questions.values())
        self._setpoints: dict[str, tuple[bytes, str]] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._on_question: Callable[[T], None] | None = None
        self._on_setpoint: Callable[[str, bytes, str], None] | None = None
        self._woken = False

    def open(
        self,
        on_question: Callable[[T], None],
        on_setpoint: Callable[[str, bytes, str], None],
    ) -> None:
        """From now on have these called, on the loop that is running now."""
        self._on_question = on_question
        self._on_setpoint = on_setpoint
        self._loop = asyncio.get_running_loop()

    def close(self) -> list[T]:
        """Take nothing any more. Returns the questions that waited."""
        self._loop = None
        queues = [*self._stops.values(), *self._questions.values()]
        waiting = [question for queue in queues for question in queue]
        for queue in queues:
            queue.clear()
        self._setpoints.clear()
        return waiting

    def stop(self, asker: str, question: T) -> bool:
        """A STOP: before everything else that waits. False: closed, or no room."""
        return self._leave(self._stops[asker], question)

    def question(self, asker: str, question: T) -> bool:
        """Anything else that wants an answer. False: closed, or no room."""
        return self._leave(self._questions[asker], question)

    def setpoint(self, asker: str, payload: bytes, encoding: str) -> None:
        """A set-point; one that waits still is forgotten."""
        self._setpoints[asker] = (payload, encoding)
        self._wake()

    def _leave(self, queue: deque[T], question: T) -> bool:
        if self._loop is None or len(queue) >= _MOST_WAITING:
            return False
        queue.append(question)
        return self._wake()

    def _wake(self) -> bool:
        # What is left is left before this flag is read, and the loop takes the flag back before it
        # looks: so nothing that was left can be overlooked.
        if not self._woken:
            self._woken = True
            if self._loop is None:
                return False
            try:
                self._loop.call_soon_threadsafe(self._look)
            except RuntimeError:  # the loop has ended without us
                self._loop = None
                return False
        return True

    def _look(self) -> None:
        self._woken = False
        if self._loop is None or self._on_question is None or self._on_setpoint is None:
            return
        for stops in self._stops.values():
            for _ in range(len(stops)):
                self._on_question(stops.popleft())
        for asker in list(self._setpoints):
            self._on_setpoint(asker, *self._setpoints.pop(asker))
        for _ in range(len(self._turns)):
            queue = self._turns[0]
            self._turns.rotate(-1)
            if queue:
                self._on_question(queue.popleft())
                break
        if any(self._turns) or any(self._stops.values()):
            self._wake()


class Quota:
    """So many a second, of which those of a whole second may come at once. For one thread."""

    def __init__(self, per_s: int, clock: Clock) -> None:
        self._per_s = per_s
        self._clock = clock
        self._left = float(per_s)
        self._t_ns = clock.now_ns()

    def take(self) -> bool:
        """Whether one more is within it."""
        now_ns = self._clock.now_ns()
        self._left = min(self._left + (now_ns - self._t_ns) * 1e-9 * self._per_s, self._per_s)
        self._t_ns = now_ns
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
