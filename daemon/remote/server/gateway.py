"""A process between the network and the daemon: `python -m daemon.remote.server.gateway SETTINGS`.

It ends TLS, knows by the certificate who is there, and keeps everybody to his share. What floods it
has neither the daemon's descriptors nor its time. There are two of them, which share nothing: one
hands each user's bytes to the zenoh session that the daemon has for this user, the other takes
nothing but STOP.
"""

import asyncio
import os
import resource
import signal
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from daemon.host.logs import logging_to_stderr
from daemon.messages import Refusal
from daemon.remote.server.tls_listener import TlsListener, server_context
from daemon.remote.wire import Format, encode

CONNECTIONS_PER_USER: Final = 16
LARGEST_STOP_BYTES: Final = 4096
CONNECTION: Final = struct.Struct("!Q")
"""Before each STOP on its way to the daemon, and each answer on its way back: whose it is."""
_CHUNK_BYTES: Final = 65536
_UNKNOWN: Final = (
    "it does not know the user '{}': list it under `remote: {{users: ...}}` in the robot file, and "
    "use the certificate of that name"
)
_NICENESS: Final = 5
"""Of who hands on everything else: less than a STOP, and less than the control loop."""
_NICENESS_OF_STOP: Final = -10
"""It has little to do, and is to do it before whatever keeps the machine busy."""


class GatewaySettings(msgspec.Struct, frozen=True):
    """What the daemon tells its gateway."""

    listening: int
    """Descriptor of the socket."""
    certificates: str
    users: dict[str, str]
    """Where each one's zenoh session listens; for STOP: each one's role."""
    stops: int | None = None
    """Descriptor of the way to the daemon, for the one that takes STOP."""


class Relay:
    """Hands on what each user sends, both ways."""

    def __init__(self, sockets: dict[str, str]) -> None:
        self._sockets = sockets
        self._connections = dict.fromkeys(sockets, 0)

    async def talk(
        self, user: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Until one end hangs up; at once where the user has his share already."""
        path = self._sockets.get(user)
        if path is None:
            await _refuse(writer, "not_permitted", _UNKNOWN.format(user))
            return
        if self._connections[user] >= CONNECTIONS_PER_USER:
            text = (
                f"'{user}' has {CONNECTIONS_PER_USER} connections already, which is a user's share"
            )
            await _refuse(writer, "busy", text)
            return
        self._connections[user] += 1
        try:
            inner_reader, inner_writer = await asyncio.open_unix_connection(path)
            try:
                pumps = [
                    asyncio.ensure_future(_pump(reader, inner_writer)),
                    asyncio.ensure_future(_pump(inner_reader, writer)),
                ]
                try:
                    await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    for pump in pumps:
                        pump.cancel()
                    await asyncio.gather(*pumps, return_exceptions=True)
            finally:
                inner_writer.close()
        finally:
            self._connections[user] -= 1


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(_CHUNK_BYTES):
        writer.write(data)
        await writer.drain()


class Stops:
    """Every byte of an operator is a STOP. A connection may wait, ready for it."""

    def __init__(self, roles: dict[str, str], daemon: socket.socket) -> None:
        self._roles = roles
        self._daemon = daemon
        self._loop = asyncio.get_running_loop()
        self._count = 0
        self._writers: dict[int, asyncio.StreamWriter] = {}
        self._of: dict[str, list[int]] = {user: [] for user in roles}
        daemon.setblocking(False)
        self._loop.add_reader(daemon, self._answered)

    async def talk(
        self, user: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Until the user hangs up, or wants more connections than are his share."""
        role = self._roles.get(user)
        if role != "operator":
            text = f"'{user}' is a {role} and may not command: that takes an operator"
            await _refuse(writer, "not_permitted", _UNKNOWN.format(user) if role is None else text)
            return
        self._count += 1
        number, mine = self._count, self._of[user]
        if len(mine) >= CONNECTIONS_PER_USER:
            self._writers[mine[0]].transport.abort()
        mine.append(number)
        self._writers[number] = writer
        try:
            while data := await reader.read(LARGEST_STOP_BYTES):
                message = CONNECTION.pack(number) + user.encode() + b"\0" + data
                await self._loop.sock_sendall(self._daemon, message)
        finally:
            mine.remove(number)
            del self._writers[number]

    def _answered(self) -> None:
        try:
            answer = self._daemon.recv(_CHUNK_BYTES)
        except BlockingIOError:
            return
        if not answer:  # the daemon has gone
            self._loop.remove_reader(self._daemon)
            return
        (number,) = CONNECTION.unpack_from(answer)
        writer = self._writers.get(number)
        if writer is not None and writer.transport.get_write_buffer_size() < _CHUNK_BYTES:
            writer.write(answer[CONNECTION.size :] + b"\n")


async def _refuse(writer: asyncio.StreamWriter, name: str, text: str) -> None:
    refusal = Refusal(request="", state="", name=name, text=text)
    writer.write(encode(refusal, Format.JSON) + b"\n")
    await writer.drain()


async def _serve(settings: GatewaySettings) -> None:
    """Until the daemon has gone: then standard input ends."""
    loop, gone = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(sys.stdin.fileno(), gone.set)
    service: Relay | Stops
    if settings.stops is None:
        service = Relay(settings.users)
    else:
        service = Stops(settings.users, socket.socket(fileno=settings.stops))
    listening = socket.socket(fileno=settings.listening)
    context = server_context(Path(settings.certificates))
    listener = TlsListener(listening, context, service.talk)
    await gone.wait()
    listener.close()


def main() -> int:
    """Whatever is pressed on a terminal is for the daemon."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError):  # a real-time daemon's children inherit its priority
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    settings = msgspec.json.decode(sys.argv[1], type=GatewaySettings)
    with suppress(OSError):  # more than its share is not everybody's to give
        os.nice(_NICENESS if settings.stops is None else _NICENESS_OF_STOP)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with logging_to_stderr("gateway"):
        asyncio.run(_serve(settings))  # by epoll: there may be thousands of descriptors
    return 0


if __name__ == "__main__":
    sys.exit(main())
