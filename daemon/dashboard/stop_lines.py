"""A process for nothing but STOP: `python -m daemon.dashboard.stop_lines DESCRIPTOR`.

A browser has a line for STOP open before it is wanted. The page's server hands the connection on to
this process, which ends it and tells the daemon: neither telemetry nor a replay, nor a server that
hangs, is in a STOP's way.
"""

import asyncio
import os
import signal
import socket
import sys
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import msgspec
from wsproto import WSConnection
from wsproto.connection import ConnectionType
from wsproto.events import (
    AcceptConnection,
    BytesMessage,
    CloseConnection,
    Event,
    Ping,
    Request,
    TextMessage,
)
from wsproto.utilities import ProtocolError

from daemon.host.logs import logging_to_stderr
from daemon.messages import Answer
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client_errors import ClientError

STOPS_WITHIN_S: Final = 4.0
MOST_LINES: Final = 64
"""Of all browsers; who comes after them has requests."""
_MOST_STOPS: Final = 8
"""Of one browser's, waiting for their answers: the robot has been told so often then."""
_MOST_AT_ONCE: Final = 16
"""Events in what was read at once: nobody presses so often."""
_LARGEST_BYTES: Final = 4096
_REST_S: Final = 0.005
"""Between two looks at one line: who writes without end leaves the others their time."""
_PRIORITY: Final = 10
"""SCHED_FIFO, where it is permitted: it has little to do, and is to do it before whatever draws
pictures. A daemon's loop goes before it."""

Stop = Callable[[str], Awaitable[Answer]]
"""STOP of the robot of that name. Raises ClientError."""


class Robots(msgspec.Struct, tag="robots", frozen=True):
    """Which there are, and the runtime folders of their daemons."""

    folders: dict[str, str]


class Line(msgspec.Struct, tag="line", frozen=True):
    """A connection comes with it, whose HTTP request asks for a WebSocket and has been let in."""

    headers: list[tuple[str, str]]
    """Of the request."""


class _StopAsked(msgspec.Struct):
    """What a browser says on its line."""

    robot: str
    n: int = 0
    """Its own number, by which it knows the answer."""


HANDED_ON: Final = msgspec.json.Decoder(Robots | Line)
LARGEST_HANDED_ON_BYTES: Final = 65536
_STOP_ASKED: Final = msgspec.json.Decoder(_StopAsked)


async def outcome_of(stopping: Awaitable[Answer]) -> dict[str, Any]:
    """What came of a STOP, as browsers are told."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    try:
        answer = await stopping
    except ClientError as error:
        return {"outcome": "no answer", "text": str(error)}
    outcome = "confirmed" if answer.confirmed else "not confirmed"
    took_ms = (loop.time() - began_s) * 1e3
    return {"outcome": outcome, "took_ms": took_ms, "text": answer.text}


class StopLine:
    """One browser's. Every message on it is a STOP, and nothing else comes this way."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, stop: Stop
    ) -> None:
        self._reader, self._writer, self._stop = reader, writer, stop
        self._frames = WSConnection(ConnectionType.SERVER)
        self._text = ""
        self._answering: set[asyncio.Task[None]] = set()

    async def serve(self, headers: list[tuple[str, str]]) -> None:
        """Until either side ends it. headers: of the request that asks for it."""
        try:
            self._frames.initiate_upgrade_connection(
                [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers],
                "/stop",
            )
            while not self._ended():  # what has come goes on first
                await asyncio.sleep(_REST_S)
                data = await self._reader.read(_LARGEST_BYTES)
                if not data:
                    return
                self._frames.receive_data(data)
        except (OSError, ProtocolError):
            return
        finally:
            self._writer.transport.abort()
            # Whoever has pressed may leave at once: the STOP goes nevertheless.
            await asyncio.gather(*self._answering, return_exceptions=True)

    def _ended(self) -> bool:
        """Takes what has come. Raises ProtocolError."""
        for number, event in enumerate(self._frames.events()):
            if number >= _MOST_AT_ONCE or self._ends(event):
                return True
        return False

    def _ends(self, event: Event) -> bool:
        match event:
            case Request():
                self._send(AcceptConnection())
            case TextMessage():
                return not self._heard(event)
            case Ping():
                self._send(event.response())
            case CloseConnection():
                self._send(event.response())
                return True
            case _:
                pass
        return False

    def _heard(self, part: TextMessage) -> bool:
        """What is no STOP does nothing, and gets no answer. Returns False where it has no end."""
        self._text += part.data
        if len(self._text) > _LARGEST_BYTES:
            return False
        if part.message_finished:
            text, self._text = self._text, ""
            with suppress(msgspec.DecodeError):
                self._ask(_STOP_ASKED.decode(text))
        return True

    def _ask(self, asked: _StopAsked) -> None:
        if len(self._answering) >= _MOST_STOPS:
            return
        task = asyncio.create_task(self._answer(asked))
        self._answering.add(task)
        task.add_done_callback(self._answering.discard)

    async def _answer(self, asked: _StopAsked) -> None:
        stopping = asyncio.ensure_future(outcome_of(self._stop(asked.robot)))
        await asyncio.sleep(0)  # it goes before it is told that it does
        if not stopping.done():
            self._tell({"n": asked.n, "sent": True})
        self._tell({"n": asked.n, **await stopping})

    def _tell(self, told: dict[str, Any]) -> None:
        if self._writer.is_closing():
            return
        with suppress(ProtocolError):
            self._send(BytesMessage(data=msgspec.json.encode(told)))

    def _send(self, event: Event) -> None:
        self._writer.write(self._frames.send(event))


class StopLines:
    """All of them. Opened on the loop that reads the server's socket."""

    def __init__(self, server: socket.socket) -> None:
        """server: where connections come from, SOCK_SEQPACKET."""
        self._server = server
        self._folders: dict[str, str] = {}
        self._lines: set[asyncio.Task[None]] = set()
        server.setblocking(False)
        asyncio.get_running_loop().add_reader(server, self._handed_on)

    def _handed_on(self) -> None:
        try:
            message, descriptors, _, _ = socket.recv_fds(self._server, LARGEST_HANDED_ON_BYTES, 1)
            told = HANDED_ON.decode(message)
        except (BlockingIOError, msgspec.DecodeError):
            return
        if isinstance(told, Robots):
            self._folders = told.folders
            return
        connection = socket.socket(fileno=descriptors[0])
        if len(self._lines) >= MOST_LINES:
            connection.close()
            return
        line = asyncio.create_task(self._talk(connection, told.headers))
        self._lines.add(line)
        line.add_done_callback(self._lines.discard)

    async def _talk(self, connection: socket.socket, headers: list[tuple[str, str]]) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        reader, writer = await asyncio.open_connection(sock=connection, limit=_LARGEST_BYTES)
        await StopLine(reader, writer, self._stop).serve(headers)

    async def _stop(self, robot: str) -> Answer:
        folder = self._folders.get(robot)
        if folder is None:
            raise ClientError("there is no such robot here")
        return await LocalAddress.in_folder(Path(folder)).stop("page", STOPS_WITHIN_S)


async def _serve(server: socket.socket) -> None:
    """Until the page's server has gone: then standard input ends."""
    gone = asyncio.Event()
    asyncio.get_running_loop().add_reader(sys.stdin.fileno(), gone.set)
    StopLines(server)
    await gone.wait()


def main() -> int:
    """Entry point of the process. Returns the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError):
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(_PRIORITY))
    with socket.socket(fileno=int(sys.argv[1])) as server, logging_to_stderr("stop lines"):
        asyncio.run(_serve(server))
    return 0


if __name__ == "__main__":
    sys.exit(main())
