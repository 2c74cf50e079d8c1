"""One teleoperation by hand: a device, a station and a robot, until one of them is gone.

Set-points go out while the station asks for something, and at no other time. That is the whole
dead-man: let go, unplugged or killed, no set-point comes any more, and the daemon holds by itself.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Final

from daemon.host.clock import MonotonicClock
from daemon.messages import Message, SetpointRefused, Status, Tip
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, RefusedError
from daemon.steering.hand import Target, Triple, direction_of
from daemon.steering.hid_device import HidDevice
from daemon.steering.station import Replayed, Station

_PERIOD_S: Final = 0.025
"""As often as a control step is made."""
_RESUMES_AGAIN_S: Final = 0.5
_WATCHED: Final = ("tip", "state", "event")
_REMEMBERED: Final = 256
_STANDS: Final = ("hold", "armed")
"""States from which a robot goes on."""
_NS_PER_S: Final = 1e9

Say = Callable[[str], object]


class Asked:
    """Sends what is asked for, and has a robot that was held go on with it."""

    def __init__(self, client: RobotClient, valid_s: float, say: Say) -> None:
        """say: hears what the operator should."""
        self._client = client
        self._valid_s = valid_s
        self._say = say
        self._clock = MonotonicClock()
        self._numbers: dict[int, int] = {}
        """Of the targets, by those of the set-points."""
        self._state = ""
        self._resuming: asyncio.Task[None] | None = None
        self._resumed_ns = 0
        self._told = ""

    def send(self, target: Target) -> None:
        """Raises DisconnectedError."""
        number = self._client.send_setpoint(
            target.position_mm, self._valid_s, direction=target.direction
        )
        self._numbers[number] = target.sequence
        self._numbers.pop(number - _REMEMBERED, None)
        if self._state in _STANDS:
            self._resume()

    def hear(self, message: Message) -> int | None:
        """What the daemon publishes. Returns the number of the target that it has refused."""
        if isinstance(message, Status):
            self._hear_state(message)
        if isinstance(message, SetpointRefused) and message.sequence in self._numbers:
            self._tell(f"refused: {message.reason}")
            return self._numbers[message.sequence]
        return None

    def _hear_state(self, status: Status) -> None:
        if status.state != self._state:
            reasons = ", ".join(reason.name for reason in status.reasons)
            self._tell(f"{status.state}{': ' if reasons else ''}{reasons}")
        self._state = status.state

    async def close(self) -> None:
        if self._resuming is not None:
            self._resuming.cancel()
            with suppress(asyncio.CancelledError):
                await self._resuming

    def _resume(self) -> None:
        now_ns = self._clock.now_ns()
        asked = self._resuming is not None and not self._resuming.done()
        if asked or now_ns - self._resumed_ns < _RESUMES_AGAIN_S * _NS_PER_S:
            return
        self._resumed_ns = now_ns
        self._resuming = asyncio.ensure_future(self._ask_to_resume())

    async def _ask_to_resume(self) -> None:
        try:
            await self._client.resume()
        except RefusedError as error:
            self._tell(f"does not go on: {error}")
        except ClientError as error:
            self._tell(str(error))

    def _tell(self, text: str) -> None:
        """Nothing twice in a row: a hand that pushes on against a wall is told so once."""
        if text != self._told:
            self._told = text
            self._say(text)


async def steer(
    client: RobotClient,
    device: HidDevice,
    station: Station,
    asked: Asked,
    controller: dict[str, Any] | None,
) -> None:
    """Until the device is unplugged or the task is cancelled. Raises ClientError."""
    clock = MonotonicClock()
    async with client.subscribe(_WATCHED) as messages:
        await client.teleoperate(controller)

        async def watch() -> None:
            async for message in messages:
                refused = asked.hear(message)
                if refused is not None:
                    station.refused(refused)
                if isinstance(message, Tip) and message.tip_mm is not None:
                    station.tip(clock.now_ns(), *_placed(message))

        async def pace() -> None:
            while not station.gone:
                target = station.advance(clock.now_ns())
                if target is not None:
                    asked.send(target)
                await asyncio.sleep(_PERIOD_S)

        async def read() -> None:
            await device.follow(lambda data: station.read(clock.now_ns(), data))
            station.unplugged()

        await _first_of(watch(), pace(), read())


async def replay(
    client: RobotClient,
    path: Iterator[Replayed],
    asked: Asked,
    controller: dict[str, Any] | None,
) -> None:
    """Ask for what was asked for once, in the same rhythm. Raises ClientError, JournalError."""
    clock = MonotonicClock()
    async with client.subscribe(_WATCHED) as messages:
        await client.teleoperate(controller)
        began_ns = clock.now_ns()

        async def watch() -> None:
            async for message in messages:
                asked.hear(message)

        async def pace() -> None:
            for t_ns, target in path:
                late_s = (clock.now_ns() - began_ns - t_ns) / _NS_PER_S
                if late_s < 0.0:
                    await asyncio.sleep(-late_s)
                if target is not None:
                    asked.send(target)

        await _first_of(watch(), pace())


async def _first_of(*works: Any) -> None:
    """Until one of them ends; what it raises is raised."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()


def _placed(tip: Tip) -> tuple[Triple, Triple | None]:
    assert tip.tip_mm is not None
    x, y, z = tip.tip_mm
    quaternion = tip.quaternion
    direction = None
    if quaternion is not None and len(quaternion) == 4:
        direction = direction_of((quaternion[0], quaternion[1], quaternion[2], quaternion[3]))
    return (x, y, z), direction
