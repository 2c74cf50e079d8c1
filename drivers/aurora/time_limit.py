"""A time limit that is set anew for every reply and hardly ever exceeded."""

import asyncio
from collections.abc import Callable


class TimeLimit:
    """Calls back once when a limit is exceeded that was not called off in time.

    One timer of the loop serves many limits: when it ends, it is set to what is left of the limit
    that holds then. A timer for each would cost more than all the rest of waiting for a reply.
    """

    def __init__(self, on_exceeded: Callable[[], None]) -> None:
        self._on_exceeded = on_exceeded
        self._ends_s: float | None = None
        """Loop time at which the limit ends; None: none is set."""
        self._timer: asyncio.TimerHandle | None = None

    def set(self, limit_s: float) -> None:
        """From now on. The limit before it holds no longer."""
        loop = asyncio.get_running_loop()
        self._ends_s = ends_s = loop.time() + limit_s
        if self._timer is None:
            self._timer = loop.call_at(ends_s, self._look)
        elif ends_s < self._timer.when():
            self._timer.cancel()
            self._timer = loop.call_at(ends_s, self._look)

    def call_off(self) -> None:
        """Until it is set again there is no limit."""
        self._ends_s = None

    def _look(self) -> None:
        assert self._timer is not None
        ended_s, self._timer = self._timer.when(), None
        if self._ends_s is None:
            return
        if self._ends_s <= ended_s:
            self._ends_s = None
            self._on_exceeded()
        else:
            self._timer = asyncio.get_running_loop().call_at(self._ends_s, self._look)
