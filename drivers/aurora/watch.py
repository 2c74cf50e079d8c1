"""Notices what does not happen: replies that stay away, frames that stay the same or get lost."""

import asyncio

from drivers.aurora.conditions import CRC_ERRORS, FRAMES_MISSED, FROZEN, SILENT
from drivers.aurora.health import Health
from drivers.clock import Clock

_CLEAN_NS = 1_000_000_000
"""Without a damaged reply for so long, the line counts as good again."""
_WINDOW_FRAMES = 200
_TOLERATED_SHARE = 0.05


class Watch:
    """Watches over a running tracker, from `start` to `stop`."""

    def __init__(self, silent_after_s: float, clock: Clock, health: Health) -> None:
        self._configured_ns = self._limit_ns = round(silent_after_s * 1e9)
        self._clock = clock
        self._health = health
        self._reply_ns = self._fresh_ns = self._damaged_ns = 0
        self._alarmed = False
        self._window_got = self._window_missed = 0
        self._timer: asyncio.TimerHandle | None = None

    def start(self, exchange_ns: int) -> None:
        """Watch from now on. A request and its reply take `exchange_ns` on the line: on a slow one
        the limit has to be longer than configured."""
        self._limit_ns = max(self._configured_ns, 2 * exchange_ns)
        self._alarmed = True  # whatever was raised before: the first reply clears it
        self._reply_ns = self._fresh_ns = self._clock.now_ns()
        self._arm(self._limit_ns)

    def stop(self) -> None:
        """What holds now keeps holding; nothing new is noticed."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def replied(self, t_ns: int) -> None:
        """A sound reply came, whatever is in it."""
        self._reply_ns = t_ns
        if self._alarmed:
            self._health.clear(SILENT)

    def idle(self, t_ns: int) -> None:
        """Nothing is followed, so that there is no new frame to wait for."""
        self._fresh_ns = t_ns

    def fresh(self, t_ns: int, missed: int) -> None:
        """A new frame came, and `missed` others before it did not."""
        self._fresh_ns = t_ns
        if self._alarmed:
            self._alarmed = False
            self._health.clear(FROZEN)
        else:
            self._window_missed += missed  # what a silence has cost is no slow line
        self._window_got += 1
        if self._window_got + self._window_missed >= _WINDOW_FRAMES:
            self._close_window()

    def damaged(self, detail: str) -> None:
        """A reply came that must not be believed."""
        self._damaged_ns = self._clock.now_ns()
        self._health.set(CRC_ERRORS, detail=detail)

    def _close_window(self) -> None:
        got, missed = self._window_got, self._window_missed
        self._window_got = self._window_missed = 0
        if missed > _TOLERATED_SHARE * (got + missed):
            self._health.set(FRAMES_MISSED, detail=f"{missed} of {got + missed}")
        else:
            self._health.clear(FRAMES_MISSED)

    def _arm(self, wait_ns: int) -> None:
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(wait_ns * 1e-9, self._look)

    def _look(self) -> None:
        now_ns = self._clock.now_ns()
        stale_ns = now_ns - self._fresh_ns
        if stale_ns >= self._limit_ns:
            self._alarmed = True
            if now_ns - self._reply_ns >= self._limit_ns:
                self._health.clear(FROZEN)
                self._health.set(SILENT)
            else:
                self._health.set(FROZEN)
        if self._damaged_ns and now_ns - self._damaged_ns >= _CLEAN_NS:
            self._damaged_ns = 0
            self._health.clear(CRC_ERRORS)
        self._arm(max(self._limit_ns - stale_ns, self._limit_ns // 4))
