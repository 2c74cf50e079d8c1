"""Clearing: what was wrong is over, and what goes by itself soon is waited for.

The answer to `clear` comes when `arm` may follow at once, or says what is not over yet.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from daemon.service.robot_service import AT_REST_WITHIN_S, RobotService
from safety.causes import Cause
from safety.failsafe import ActiveReason

_LOOK_EVERY_S: Final = 0.002
"""A bus cycle of the fastest shipped robot."""
_RESET_WITHIN_S: Final = 0.2
"""What a fault reset has done shows in the drives' next answers."""
_READY_WITHIN_S: Final = 6.0
"""A drive that was lost is set up anew, and the tracker brought up: seconds each."""
_PASSES: Final = frozenset(
    {Cause.NODE_NOT_READY, Cause.TRACKER_NOT_READY, Cause.TRACKER_LATE, Cause.TRACKER_QUALITY}
)
_COMES_BACK: Final = frozenset({Cause.NODE_LOST, Cause.NODE_RESET})
"""What a stall leaves behind: drives are set up anew, and the tip is seen again."""


class Clearing:
    """Clears the causes of one robot."""

    def __init__(self, service: RobotService) -> None:
        self._service = service

    async def at_rest(self) -> None:
        """Wait for drives that come to rest, but no longer than they need."""
        supervisor = self._service.supervisor
        await _pass(lambda: supervisor.comes_to_rest, AT_REST_WITHIN_S)

    async def clear(self) -> tuple[ActiveReason, ...]:
        """What still holds when drives had time for a reset, and lost ones to be set up anew."""
        supervisor, clock = self._service.supervisor, self._service.clock
        began_ns = clock.now_ns()
        while left := supervisor.clear(clock.now_ns()):
            returns = all(reason.cause in _COMES_BACK for reason in left)
            within_s = _READY_WITHIN_S if returns else _RESET_WITHIN_S
            if clock.now_ns() - began_ns >= within_s * 1e9:
                break
            await asyncio.sleep(_RESET_WITHIN_S)
        return left

    async def not_yet_over(self) -> list[str]:
        """Names of what stands in the way of arming, once what passes by itself had its time."""
        await _pass(lambda: self._only_for_a_moment or self._still_on, _READY_WITHIN_S)
        blocking = self._service.supervisor.blocking
        return list(dict.fromkeys(reason.cause.value for reason in blocking))

    @property
    def _only_for_a_moment(self) -> bool:
        """Whether nothing keeps the robot from being armed but what goes by itself soon."""
        causes = {reason.cause for reason in self._service.supervisor.blocking if not reason.over}
        return bool(causes) and causes <= _PASSES

    @property
    def _still_on(self) -> bool:
        """Whether drives have torque that nobody wants: one that was lost is switched off when it
        is heard again."""
        buses = self._service.hardware.buses
        return self._service.supervisor.comes_to_rest or any(bus.energised for bus in buses)


async def _pass(goes_on: Callable[[], bool], within_s: float) -> None:
    """Wait for something to be over, but no longer than that."""
    with suppress(TimeoutError):
        async with asyncio.timeout(within_s):
            while goes_on():
                await asyncio.sleep(_LOOK_EVERY_S)
