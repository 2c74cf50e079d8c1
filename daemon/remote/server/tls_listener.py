"""Lets in who shows a good certificate; who does not do so within a second is hung up on.

Whoever only connects costs a descriptor for that second, and nothing else: where too many do, the
oldest of them goes. So a newcomer is always let in, however many others are waiting before him.
"""

import asyncio
import resource
import select
import socket
import ssl
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from daemon.host.clock import MonotonicClock

AUTHENTICATES_WITHIN_S: Final = 1.0
_MOST_SILENT: Final = 8192
"""Have connected and not said anything yet; not more than half of the descriptors."""
_MOST_HANDSHAKES: Final = 64
_ACCEPTED_PER_TURN: Final = 16
_SWEEP_EVERY_S: Final = 0.02
_SWEEP_AGAIN_S: Final = 0.002
"""Where there are more."""
_DROPPED_PER_SWEEP: Final = 20
"""To hang up costs 10 us: a STOP that comes meanwhile does not wait for hundreds of them."""
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


class _Newcomer(NamedTuple):
    """Has connected and shown nothing yet."""

    connection: socket.socket
    until_s: float


class TlsListener:
    """Accepts on a socket, from when it is made until `close`."""

    def __init__(self, listening: socket.socket, context: ssl.SSLContext, on_peer: OnPeer) -> None:
        """on_peer: gets the certificate's common name and both streams; hangs up at its end."""
        self._listening = listening
        self._context = context
        self._on_peer = on_peer
        self._loop = asyncio.get_running_loop()
        self._most_silent = _most_silent()
        self._silent: dict[int, _Newcomer] = {}
        """By descriptor, the oldest first."""
        self._speaking = select.epoll()
        """Which of them have said something: watched here, each costs the loop nothing."""
        self._spoke: deque[_Newcomer] = deque()
        self._handshakes: dict[asyncio.Task[None], None] = {}
        self._talking: set[asyncio.Task[None]] = set()
        self._closed = False
        listening.setblocking(False)
        self._loop.add_reader(listening, self._acceptable)
        self._loop.add_reader(self._speaking, self._heard)
        self._sweeping = self._loop.call_later(_SWEEP_EVERY_S, self._sweep)

    def close(self) -> None:
        """Let nobody in any more, and hang up on everybody."""
        self._closed = True
        self._sweeping.cancel()
        self._loop.remove_reader(self._listening)
        self._loop.remove_reader(self._speaking)
        self._speaking.close()
        for newcomer in [*self._silent.values(), *self._spoke]:
            newcomer.connection.close()
        for task in [*self._handshakes, *self._talking]:
            task.cancel()

    def _acceptable(self) -> None:
        until_s = self._loop.time() + AUTHENTICATES_WITHIN_S
        for _ in range(_ACCEPTED_PER_TURN):
            try:
                connection, _ = self._listening.accept()
            except BlockingIOError:
                return
            except OSError:  # no descriptors: make room
                self._drop_oldest()
                return
            connection.setblocking(False)
            self._silent[connection.fileno()] = _Newcomer(connection, until_s)
            self._speaking.register(connection, select.EPOLLIN | select.EPOLLRDHUP)
            if len(self._silent) > self._most_silent:
                self._drop_oldest()

    def _sweep(self) -> None:
        """Hang up on those whose time is over."""
        now_s, again_s = self._loop.time(), _SWEEP_AGAIN_S
        for _ in range(_DROPPED_PER_SWEEP):
            oldest = next(iter(self._silent.values()), None)
            if oldest is None or oldest.until_s > now_s:
                again_s = _SWEEP_EVERY_S
                break
            self._drop_oldest()
        self._sweeping = self._loop.call_later(again_s, self._sweep)

    def _drop_oldest(self) -> None:
        descriptor = next(iter(self._silent), None)
        if descriptor is not None:
            self._silent.pop(descriptor).connection.close()  # which the epoll sees

    def _heard(self) -> None:
        for descriptor, _ in self._speaking.poll(0, _ACCEPTED_PER_TURN):
            self._speaking.unregister(descriptor)
            self._spoke.append(self._silent.pop(descriptor))
            if len(self._spoke) == 1:
                self._loop.call_soon(self._start)
            elif len(self._spoke) > self._most_silent:
                self._spoke.popleft().connection.close()

    def _start(self) -> None:
        if self._closed:
            return
        for _ in range(_STARTED_PER_TURN):
            if not self._spoke:
                return
            newcomer = self._spoke.popleft()
            if len(self._handshakes) >= _MOST_HANDSHAKES:
                next(iter(self._handshakes)).cancel()
            task = self._loop.create_task(self._handshake(*newcomer))
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


def _most_silent() -> int:
    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return min(_MOST_SILENT, most // 2)


def _common_name(certificate: dict[str, Any]) -> str:
    names = [v for part in certificate.get("subject", ()) for k, v in part if k == "commonName"]
    return str(names[0]) if len(names) == 1 else ""


def _valid_for_s(certificate: dict[str, Any]) -> float:
    """How long a certificate that was good a moment ago remains so; a week at most."""
    ends_s = ssl.cert_time_to_seconds(str(certificate.get("notAfter")))
    return min(max(ends_s - MonotonicClock().wall_time_ns() * 1e-9, 0.0), 604_800.0)
