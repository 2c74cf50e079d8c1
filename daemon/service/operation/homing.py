"""Homing: axes look for their zeros by themselves, group after group, watched all the time.

Nobody checks their targets meanwhile: the drives go no faster than the gate permits, and whatever
would hold or stop the robot (a lost lease, STOP, a fault) ends it with a quick stop.
"""

import asyncio
from collections.abc import Coroutine, Sequence
from typing import Final

from daemon.service.motion_loader import CommandRefusedError
from daemon.service.robot_service import RobotService
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.homing import HomingError
from safety.states import OperatingState, Request

_LOOK_EVERY_S: Final = 0.01
_MORE_THAN_THE_DRIVE_S: Final = 10.0
"""A drive's own time limit comes first; coming to rest and changing modes is within this."""


class RobotHoming:
    """Homes axes of one robot."""

    def __init__(self, service: RobotService) -> None:
        self._service = service
        self._channels = {channel.axis.name: channel for channel in service.loop.channels}
        self._bus_of = {
            channel.index: bus for bus in service.hardware.buses for channel in bus.channels
        }

    def groups(self, names: Sequence[str]) -> list[list[AxisChannel]]:
        """The axes that are meant, group after group as the robot file orders them.

        names: empty for all that do not know their zero. Raises CommandRefusedError.
        """
        unknown = [name for name in names if name not in self._channels]
        if unknown:
            there = ", ".join(self._channels)
            raise CommandRefusedError(
                "bad_axis", f"there is no axis {unknown[0]}: there are {there}"
            )
        wanted = set(names) or {n for n, one in self._channels.items() if not one.referenced}
        if not wanted:
            raise CommandRefusedError(
                "nothing_to_home",
                "every axis knows its zero: name those that shall look for it all the same",
            )
        groups = [[n for n in group if n in wanted] for group in self._service.robot.homing_groups]
        ordered = {name for group in groups for name in group}
        left_out = [name for name in self._channels if name in wanted - ordered]
        if left_out:
            names = ", ".join(left_out)
            raise CommandRefusedError("no_order", f"{names}: not in homing_order of the robot file")
        return [[self._channels[name] for name in group] for group in groups if group]

    async def home(self, groups: Sequence[Sequence[AxisChannel]]) -> None:
        """Home them. At the end, whichever it is, the drives are off.

        Raises CommandRefusedError.
        """
        service, supervisor = self._service, self._service.supervisor
        failed: list[str] = []
        supervisor.request(Request.HOME, service.clock.now_ns())
        try:
            for group in groups:
                failed = await self._home_group(group)
                if failed or not self._going_on:
                    break
        finally:
            stopped = not self._going_on
            await self._end()
        if failed or stopped:
            why = "; ".join(failed) or "it was stopped"
            raise CommandRefusedError("not_homed", why, supervisor.stopped_by if stopped else ())

    @property
    def _going_on(self) -> bool:
        return self._service.supervisor.state is OperatingState.HOMING

    async def _home_group(self, group: Sequence[AxisChannel]) -> list[str]:
        """What has gone wrong with any of them; the first failure stops the others."""
        tasks = [asyncio.create_task(self._home_axis(channel)) for channel in group]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
            if self._going_on and any(task.exception() for task in done):
                self._service.supervisor.request(Request.HOMED, self._service.clock.now_ns())
            results = await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            for task in tasks:
                task.cancel()
        return [str(result) for result in results if isinstance(result, BaseException)]

    async def _home_axis(self, channel: AxisChannel) -> None:
        service, name = self._service, channel.axis.name
        service.events.tell("homing", "homing", f"{name} looks for its zero", subject=name)
        within_s = channel.axis.homing.timeout_s + _MORE_THAN_THE_DRIVE_S
        known = [one.position_counts if one.referenced else None for one in service.loop.channels]
        permitted = service.gate.permit_homing(channel.index, known)
        try:
            await _within(self._bus_of[channel.index].home(permitted), within_s, name)
        except HomingError as error:
            service.events.tell(
                "homing", "not_homed", f"{name} has no zero", subject=name, detail=str(error)
            )
            raise
        service.events.tell("homing", "homed", f"{name} has found its zero", subject=name)

    async def _end(self) -> None:
        """The drives go off, and the loop begins anew from where the axes now say that they are."""
        service = self._service
        await service.rest(Request.HOMED if self._going_on else Request.STOP)
        service.loop.settle()


async def _within(homing: Coroutine[None, None, None], within_s: float, name: str) -> None:
    try:
        async with asyncio.timeout(within_s):
            await homing
    except TimeoutError:
        raise HomingError(f"{name}: no end within {within_s:g} s") from None
