"""One robot as a bridge hears it: while its daemon runs, and again when it has come back."""

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from daemon.host.clock import MonotonicClock
from daemon.messages import Message, Status, Surroundings, WhoAmI
from daemon.remote.client.address import Address
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, DisconnectedError
from daemon.remote.client.surroundings_watch import SurroundingsWatch
from daemon.remote.keys import TELEMETRY_KEYS

_TRY_AGAIN_S: Final = 0.5
_SILENT_S: Final = 2.0
"""A daemon that publishes nothing for so long stands still, or is cut off."""
_DEPTH: Final = 256
_OFFSET_HELD_NS: Final = 60_000_000_000
"""Quartz clocks part by some 50 us in that time; a message that was not delayed comes in it."""


class Listener(Protocol):
    """What a bridge does with what is heard. Called on the event loop; none of it may wait."""

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:
        """A daemon is there. mesh: a binary STL file in mm; empty where there is none."""
        ...

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        """Others have taken the place of what was round the body."""
        ...

    def heard(self, message: Message, date_ns: int) -> None:
        """It has told this, and when that was so: ns since 1970."""
        ...

    def lost(self, why: str) -> None:
        """It is not heard any more, or not yet."""
        ...


class DaemonDate:
    """The date of the daemon's monotonic times, which no message carries.

    A message arrives after it was made: the least that a date of arrival has ever been ahead of a
    message's time is the difference of both clocks and the shortest way. It is looked for anew all
    the time, because clocks drift and are set.
    """

    def __init__(self) -> None:
        self._least: int | None = None
        self._least_lately: int | None = None
        self._since_ns = 0

    def of(self, t_ns: int, arrived_ns: int) -> int:
        """Never later than its arrival."""
        ahead = arrived_ns - t_ns
        if self._least is None or self._least_lately is None:
            self._least = self._least_lately = ahead
            self._since_ns = t_ns
        self._least = min(self._least, ahead)
        self._least_lately = min(self._least_lately, ahead)
        if not 0 <= t_ns - self._since_ns < _OFFSET_HELD_NS:
            self._least, self._least_lately, self._since_ns = self._least_lately, ahead, t_ns
        return min(t_ns + self._least, arrived_ns)


class RobotFeed:
    """`run` until cancelled."""

    def __init__(self, find: Callable[[], Address], listener: Listener) -> None:
        """find: which daemon; asked for each attempt. Raises ClientError while there is none."""
        self._find = find
        self._listener = listener
        self._clock = MonotonicClock()
        self._why = ""

    async def run(self) -> None:
        """Connect, listen, and begin again."""
        while True:
            try:
                async with await RobotClient.connect(self._find(), own_stop=False) as client:
                    await self._listen(client)
            except TimeoutError:
                self._lost("the daemon has fallen silent")
            except (ClientError, OSError, ValueError) as error:
                self._lost(str(error))
            await asyncio.sleep(_TRY_AGAIN_S)

    async def _listen(self, client: RobotClient) -> None:
        """Raises ClientError, TimeoutError."""
        subscription = client.subscribe(list(TELEMETRY_KEYS), _DEPTH)
        surroundings, mesh = await client.surroundings()
        self._why = ""
        self._listener.connected(client.me, surroundings, mesh)
        date = DaemonDate()
        self._tell(await client.status(), date)
        watch = SurroundingsWatch(client, surroundings, self._listener.surrounded)
        try:
            while True:
                async with asyncio.timeout(_SILENT_S):
                    message = await anext(subscription)
                if not client.connected:
                    raise DisconnectedError("the daemon has gone")
                self._tell(message, date)
                watch.heard(message)
        finally:
            watch.close()

    def _tell(self, message: Message, date: DaemonDate) -> None:
        arrived_ns = self._clock.wall_time_ns()
        t_ns: int | None = getattr(message, "t_ns", None)
        # A status is made at once when it is asked for, and a refused set-point has no time.
        if t_ns is None or isinstance(message, Status):
            self._listener.heard(message, arrived_ns)
        else:
            self._listener.heard(message, date.of(t_ns, arrived_ns))

    def _lost(self, why: str) -> None:
        if why != self._why:
            self._why = why
            self._listener.lost(why)
