"""The daemon's end of its gateways: started, started again should one end, and ended in time."""

import asyncio
import socket
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from daemon.host.processes import KeptProcess
from daemon.remote.server.command_desk import ErrorReports
from daemon.remote.server.gateway import CONNECTION, LARGEST_STOP_BYTES, GatewaySettings
from daemon.remote.server.stop_desk import STOPS_PER_TURN, StopDesk

_MODULE: Final = "daemon.remote.server.gateway"
_BACKLOG: Final = 1024


class GatewayProcess:
    """One of them. The listening socket is the daemon's: it stays when the process is another."""

    def __init__(
        self,
        endpoint: str,
        certificates: Path,
        users: Mapping[str, str],
        errors: ErrorReports,
        stops: socket.socket | None = None,
    ) -> None:
        """Begins to listen; `start` makes the process. Raises OSError."""
        self._listening = listening_socket(endpoint)
        own = self._listening.fileno()
        passed = None if stops is None else stops.fileno()
        settings = GatewaySettings(own, str(certificates), dict(users), passed)
        self._process = KeptProcess(
            _MODULE,
            [msgspec.json.encode(settings).decode()],
            [own] if passed is None else [own, passed],
            partial(errors.tell, "the gateway"),
        )

    async def start(self) -> None:
        """Returns when it runs; who connects meanwhile waits. Raises OSError."""
        await self._process.start()

    async def close(self) -> None:
        """Takes a second at most. May be repeated."""
        try:
            await self._process.close()
        finally:
            self._listening.close()


class StopChannel:
    """STOPs that a gateway hands on, and their answers. Opened on the loop that reads it."""

    def __init__(self, desk: StopDesk) -> None:
        self._desk = desk
        self._loop = asyncio.get_running_loop()
        self._mine, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        """theirs: for the process, and for the next one after it."""
        self._mine.setblocking(False)
        self._loop.add_reader(self._mine, self._readable)

    def close(self) -> None:
        """May be repeated."""
        if self._mine.fileno() >= 0:
            self._loop.remove_reader(self._mine)
            self._mine.close()
            self.theirs.close()

    def _readable(self) -> None:
        for _ in range(STOPS_PER_TURN):
            try:
                message = self._mine.recv(2 * LARGEST_STOP_BYTES)
            except OSError:
                return
            number, rest = message[: CONNECTION.size], message[CONNECTION.size :]
            user, _, payload = rest.partition(b"\0")
            self._desk.stop(user.decode(), number, payload, partial(self._reply, number))

    def _reply(self, number: bytes, answer: bytes) -> None:
        with suppress(OSError):  # never waits
            self._mine.send(number + answer)


def listening_socket(endpoint: str) -> socket.socket:
    """A socket that listens at host:port. Raises OSError."""
    host, _, port = endpoint.rpartition(":")
    where = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)
    family, kind, protocol, _, address = where[0]
    listening = socket.socket(family, kind, protocol)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(_BACKLOG)
    except OSError:
        listening.close()
        raise
    return listening
