"""The daemon's end of its gateways: started, started again should one end, and ended in time."""

import asyncio
import socket
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from daemon.remote.server.command_desk import ErrorReports
from daemon.remote.server.gateway import CONNECTION, LARGEST_STOP_BYTES, GatewaySettings
from daemon.remote.server.stop_desk import STOPS_PER_TURN, StopDesk

_COMMAND: Final = (sys.executable, "-m", "daemon.remote.server.gateway")
_BACKLOG: Final = 1024
_LOOK_EVERY_S: Final = 0.25
_LOOK_AT_ENDING_S: Final = 0.01
_ENDS_WITHIN_S: Final = 1.0


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
        self._stops = stops
        self._errors = errors
        settings = GatewaySettings(
            self._listening.fileno(),
            str(certificates),
            dict(users),
            None if stops is None else stops.fileno(),
        )
        self._settings = msgspec.json.encode(settings).decode()
        self._process: subprocess.Popen[bytes] | None = None
        self._watching: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Returns when it runs; who connects meanwhile waits. Raises OSError."""
        self._process = await asyncio.to_thread(self._made)
        self._watching = asyncio.get_running_loop().create_task(self._watch())

    async def close(self) -> None:
        """Takes two seconds at most. May be repeated."""
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)
        self._listening.close()
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.close()
        with suppress(TimeoutError):
            async with asyncio.timeout(_ENDS_WITHIN_S):
                while process.poll() is None:
                    await asyncio.sleep(_LOOK_AT_ENDING_S)
        process.kill()
        process.wait()

    def _made(self) -> subprocess.Popen[bytes]:
        descriptors = [self._listening.fileno()]
        if self._stops is not None:
            descriptors.append(self._stops.fileno())
        return subprocess.Popen(
            [*_COMMAND, self._settings],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=descriptors,
            start_new_session=True,
        )

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            process = self._process
            if process is None or process.poll() is None:
                continue
            ended = RuntimeError(f"it ended with {process.returncode} and is started again")
            self._errors.tell("the gateway", ended)
            assert process.stdin is not None
            with suppress(OSError):
                process.stdin.close()
            try:
                self._process = await asyncio.to_thread(self._made)
            except OSError as error:
                self._errors.tell("the gateway", error)


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
