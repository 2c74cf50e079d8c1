"""Lets in who shows a good certificate; who does not do so within a second is hung up on.

Whoever only connects costs a descriptor for that second, and nothing else: where too many do, the
oldest of them goes. So a newcomer is always let in, however many others are waiting before him.
"""

import asyncio
import socket
import ssl
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from daemon.clock import MonotonicClock

AUTHENTICATES_WITHIN_S: Final = 1.0
_MOST_SILENT: Final = 256
"""Have connected and not said anything yet."""
_MOST_HANDSHAKES: Final = 64
_ACCEPTED_PER_TURN: Final = 64
_STARTED_PER_TURN: Final = 4
"""A handshake costs a millisecond: between so many, those who are in get their turn."""

OnPeer = Callable[[str, asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


def server_context(folder: Path) -> ssl.SSLContext:
    """Shows the daemon's certificate and wants one of the same authority. Raises OSError."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.load_cert_chain(folder / "server.pem", folder / "server.key")
    context.load_verify_locations(folder / "ca.pem")
    context.verify_mode = ssl.CERT_REQUIRED
    context.num_tickets = 0
    return context


class TlsListener:
    """Accepts on a socket, from when it is made until `close`."""

    def __init__(self, listening: socket.socket, context: ssl.SSLContext, on_peer: OnPeer) -> None:
        """on_peer: gets the certificate's common name and both streams; hangs up at its end."""
        self._listening = listening
        self._context = context
        self._on_peer = on_peer
        self._loop = asyncio.get_running_loop()
        self._silent: dict[socket.socket, asyncio.TimerHandle] = {}
        self._spoke: dict[socket.socket, float] = {}
        """With when each has to be through, the oldest first."""
        self._handshakes: dict[asyncio.Task[None], None] = {}
        self._talking: set[asyncio.Task[None]] = set()
        listening.setblocking(False)
        self._loop.add_reader(listening, self._acceptable)

    def close(self) -> None:
        """Let nobody in any more, and hang up on everybody."""
        self._loop.remove_reader(self._listening)
        for connection in list(self._silent):
            self._forget(connection)
        for task in [*self._handshakes, *self._talking]:
            task.cancel()

    def _acceptable(self) -> None:
        for _ in range(_ACCEPTED_PER_TURN):
            try:
                connection, _ = self._listening.accept()
            except BlockingIOError:
                return
            except OSError:  # no descriptors: make room
                if self._silent:
                    self._forget(next(iter(self._silent)))
                return
            connection.setblocking(False)
            timer = self._loop.call_later(AUTHENTICATES_WITHIN_S, self._forget, connection)
            self._silent[connection] = timer
            self._loop.add_reader(connection, self._speaks, connection)
            if len(self._silent) > _MOST_SILENT:
                self._forget(next(iter(self._silent)))

    def _forget(self, connection: socket.socket) -> None:
        """It has said nothing, or must make room."""
        self._silent.pop(connection).cancel()
        self._spoke.pop(connection, None)
        self._loop.remove_reader(connection)
        connection.close()

    def _speaks(self, connection: socket.socket) -> None:
        self._loop.remove_reader(connection)
        self._spoke[connection] = self._silent[connection].when()
        if len(self._spoke) == 1:
            self._loop.call_soon(self._start)

    def _start(self) -> None:
        for _ in range(_STARTED_PER_TURN):
            if not self._spoke:
                return
            connection = next(iter(self._spoke))
            until_s = self._spoke.pop(connection)
            self._silent.pop(connection).cancel()
            if len(self._handshakes) >= _MOST_HANDSHAKES:
                next(iter(self._handshakes)).cancel()
            task = self._loop.create_task(self._handshake(connection, until_s))
            self._handshakes[task] = None
            task.add_done_callback(self._done)
        if self._spoke:
            self._loop.call_soon(self._start)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._handshakes.pop(task, None)
        self._talking.discard(task)
        if not task.cancelled():
            task.exception()

    async def _handshake(self, connection: socket.socket, until_s: float) -> None:
        try:
            reader = asyncio.StreamReader()
            protocol = asyncio.StreamReaderProtocol(reader)
            async with asyncio.timeout_at(until_s):
                transport, _ = await self._loop.connect_accepted_socket(
                    lambda: protocol,
                    connection,
                    ssl=self._context,
                    ssl_handshake_timeout=AUTHENTICATES_WITHIN_S,
                    ssl_shutdown_timeout=AUTHENTICATES_WITHIN_S,
                )
        except (OSError, TimeoutError):
            connection.close()
            return
        except asyncio.CancelledError:
            connection.close()
            raise
        task = asyncio.current_task()
        assert task is not None
        self._handshakes.pop(task, None)
        self._talking.add(task)
        writer = asyncio.StreamWriter(transport, protocol, reader, self._loop)
        certificate: dict[str, Any] = transport.get_extra_info("peercert") or {}
        expires = self._loop.call_later(_valid_for_s(certificate), transport.abort)
        try:
            with suppress(OSError):
                await self._on_peer(_common_name(certificate), reader, writer)
        finally:
            expires.cancel()
            transport.close()


def _common_name(certificate: dict[str, Any]) -> str:
    names = [v for part in certificate.get("subject", ()) for k, v in part if k == "commonName"]
    return str(names[0]) if len(names) == 1 else ""


def _valid_for_s(certificate: dict[str, Any]) -> float:
    """How long a certificate that was good a moment ago remains so; a week at most."""
    ends_s = ssl.cert_time_to_seconds(str(certificate.get("notAfter")))
    return min(max(ends_s - MonotonicClock().wall_time_ns() * 1e-9, 0.0), 604_800.0)
