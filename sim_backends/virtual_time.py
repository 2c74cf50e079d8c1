"""An event loop whose clock jumps to the next deadline: the same code, deterministic, at any speed.

There is no I/O in virtual time. Devices sit in the same process and pass bytes as calls, so a loop
with nothing ready and nothing scheduled can never go on: that is an error, not a wait.
"""

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class VirtualTimeDeadlockError(RuntimeError):
    """Every task waits for something that nobody will ever do."""


class _JumpingSelector(selectors.SelectSelector):
    """Where an ordinary selector sleeps, this one moves the clock."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            raise VirtualTimeDeadlockError("nothing is ready and nothing is scheduled")
        self.now_s += max(timeout, 0.0)
        return []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An asyncio event loop in virtual time, starting at 0 s."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now_s


class VirtualClock:
    """The clock of a virtual-time loop."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        self._loop = loop

    def now_ns(self) -> int:
        return round(self._loop.time() * 1e9)

    def wall_time_ns(self) -> int:
        """Virtual time has a date too, always the same: runs compare equal to the last byte."""
        return 1_577_836_800_000_000_000 + self.now_ns()


def run_in_virtual_time(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` to its end in virtual time, like `asyncio.run` does in real time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)


def virtual_clock() -> VirtualClock:
    """The clock of the running virtual-time loop."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    return VirtualClock(loop)
