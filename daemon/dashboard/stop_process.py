"""The page's server's end of the process for STOP: lines are handed on to it."""

import asyncio
import logging
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec
from aiohttp import web

from daemon.dashboard.stop_lines import Line, Robots
from daemon.host.processes import KeptProcess

_HEADERS: Final = (
    "Host",
    "Upgrade",
    "Connection",
    "Sec-WebSocket-Key",
    "Sec-WebSocket-Version",
)
"""All that it has to know of a request: it offers neither extensions nor protocols."""
_CHUNK_BYTES: Final = 4096

_log: Final = logging.getLogger(__name__)


class StopProcess:
    """Made on the loop; `start` makes the process."""

    def __init__(self) -> None:
        self._mine, self._theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._mine.setblocking(False)
        descriptor = self._theirs.fileno()
        self._process = KeptProcess(
            "daemon.dashboard.stop_lines", [str(descriptor)], [descriptor], self._ended
        )
        self._robots = Robots({})

    async def start(self) -> None:
        """Raises OSError."""
        await self._process.start()

    async def close(self) -> None:
        """Takes a second at most. May be repeated."""
        try:
            await self._process.close()
        finally:
            self._mine.close()
            self._theirs.close()

    def robots(self, folders: Mapping[str, Path]) -> None:
        """By their names, with the runtime folders of their daemons."""
        self._robots = Robots({name: str(folder) for name, folder in folders.items()})
        self._hand_on(self._robots)

    async def take(self, request: web.Request) -> web.StreamResponse:
        """A browser's line, which has been let in. Returns when it is over for this server.

        Raises HTTPBadRequest, HTTPServiceUnavailable.
        """
        if not web.WebSocketResponse().can_prepare(request):
            raise web.HTTPBadRequest(reason="this is a line for STOP: a WebSocket")
        line = Line([(name, request.headers[name]) for name in _HEADERS])
        transport = request.transport
        assert transport is not None
        connection: socket.socket = transport.get_extra_info("socket")
        if transport.get_extra_info("sslcontext") is not None:
            await self._through_us(transport, line)
        elif not self._hand_on(line, connection.fileno()):
            raise web.HTTPServiceUnavailable(reason="STOP goes as a request for now")
        transport.abort()  # ours: the process has a descriptor of its own
        return web.Response(status=101)

    async def _through_us(self, transport: asyncio.Transport, line: Line) -> None:
        """TLS ends here: what comes is handed on as it comes."""
        inside, theirs = socket.socketpair()
        with inside, theirs:
            inside.setblocking(False)
            handed_on = self._hand_on(line, theirs.fileno())
            theirs.close()
            if handed_on:
                await _pumped(transport, inside)

    def _hand_on(self, told: Robots | Line, descriptor: int | None = None) -> bool:
        descriptors = [] if descriptor is None else [descriptor]
        try:
            socket.send_fds(self._mine, [msgspec.json.encode(told)], descriptors)
        except OSError:  # full: the process does not look
            return False
        return True

    def _ended(self, error: Exception) -> None:
        _log.warning("the process for STOP: %s", error)
        self._hand_on(self._robots)


class _Pump(asyncio.Protocol):
    """From a browser to the process."""

    def __init__(self, inside: socket.socket) -> None:
        self._inside = inside
        self.over = asyncio.Event()

    def data_received(self, data: bytes) -> None:
        """All of it at once, or it ends: nobody who presses STOP fills a socket."""
        try:
            whole = self._inside.send(data) == len(data)
        except OSError:
            whole = False
        if not whole:
            self.over.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """The browser has gone."""
        del exc
        self.over.set()


async def _pumped(transport: asyncio.Transport, inside: socket.socket) -> None:
    """Both ways, until either has gone."""
    loop, pump = asyncio.get_running_loop(), _Pump(inside)

    def answered() -> None:
        with suppress(BlockingIOError):
            try:
                data = inside.recv(_CHUNK_BYTES)
            except ConnectionError:
                data = b""
            if data:
                transport.write(data)
            else:
                pump.over.set()

    transport.set_protocol(pump)
    loop.add_reader(inside, answered)
    try:
        await pump.over.wait()
    finally:
        loop.remove_reader(inside)
