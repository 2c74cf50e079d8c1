"""STOP by a way of its own: no session, no queue and no descriptor that others could use up.

On this machine it is a datagram socket beside the daemon's other files: every datagram is a STOP,
whatever is in it and also when nothing is. Whoever may open the socket may command. There is
nothing to accept and nothing to keep for a sender, so no number of clients can be in the way.
"""

import asyncio
import os
import socket
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import msgspec

from daemon.messages import Answer, Command, Refusal, Stop
from daemon.remote.server.command_desk import ErrorReports
from daemon.remote.wire import Format, encode, request_in

LARGEST_STOP_BYTES: Final = 4096
STOPS_PER_TURN: Final = 16
"""So many are taken before the loop gets round to its other work; the first has stopped it."""
_MOST_WAITING: Final = 256
"""So many wait for the drives' confirmation at once; more are obeyed and not answered."""


Reply = Callable[[bytes], None]


class StopHandler(Protocol):
    """What carries a STOP out. Called on the event loop."""

    def stop_now(self) -> None:
        """Quick stop on the bus before this returns."""
        ...

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        """Wait until the drives have confirmed it."""
        ...


class _Waiting(NamedTuple):
    user: str
    request: str
    reply: Reply


class StopDesk:
    """Obeys at once; answers when the drives confirm, all who wait together."""

    def __init__(self, handler: StopHandler, errors: ErrorReports) -> None:
        self._handler = handler
        self._errors = errors
        self._waiting: dict[Hashable, _Waiting] = {}
        """By sender: one that sends many gets one answer for all that came meanwhile."""
        self._answering: asyncio.Task[None] | None = None

    def stop(self, user: str, sender: Hashable, payload: bytes, reply: Reply) -> None:
        """Stop, whatever the payload. reply: gets the answer in JSON; must not raise."""
        try:
            self._handler.stop_now()
        except Exception as error:
            self._errors.tell("STOP", error)
        if sender in self._waiting or len(self._waiting) < _MOST_WAITING:
            self._waiting[sender] = _Waiting(user, request_in(payload), reply)
        if self._answering is None or self._answering.done():
            self._answering = asyncio.get_running_loop().create_task(self._answer())

    async def close(self) -> None:
        """Answer nobody any more."""
        if self._answering is not None:
            self._answering.cancel()
            await asyncio.gather(self._answering, return_exceptions=True)

    async def _answer(self) -> None:
        while self._waiting:
            waiting, self._waiting = list(self._waiting.values()), {}
            outcome: Answer | Refusal
            try:
                outcome = await self._handler.handle(waiting[0].user, Stop())
            except Exception as error:
                self._errors.tell("STOP", error)
                text = f"{type(error).__name__}: {error}"
                outcome = Refusal(request="", state="", name="internal", text=text)
            for one in waiting:
                answer = msgspec.structs.replace(outcome, request=one.request)
                one.reply(encode(answer, Format.JSON))


class LocalStopSocket:
    """The datagram socket of this machine's users. Opened on the loop that reads it."""

    def __init__(
        self, path: Path, mode: int, on_stop: Callable[[Hashable, bytes, Reply], None]
    ) -> None:
        """mode: who may write to it. on_stop: gets sender, payload and the way back.

        Raises OSError. Whoever calls this holds the runtime folder's lock: a socket that is found
        is a dead daemon's.
        """
        self._path = path
        self._on_stop = on_stop
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            path.unlink(missing_ok=True)
            os.fchmod(self._socket.fileno(), mode)  # or anybody's for a moment
            self._socket.bind(str(path))
            path.chmod(mode)
        except OSError:
            self._socket.close()
            raise
        self._loop.add_reader(self._socket, self._readable)

    def close(self) -> None:
        """Nobody can stop the robot by this way any more. May be repeated."""
        if self._socket.fileno() >= 0:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._path.unlink(missing_ok=True)

    def _readable(self) -> None:
        for _ in range(STOPS_PER_TURN):
            try:
                payload, sender = self._socket.recvfrom(LARGEST_STOP_BYTES)
            except OSError:
                return
            self._on_stop(sender, payload, partial(self._reply, sender))

    def _reply(self, sender: bytes | str | None, answer: bytes) -> None:
        # Never waits: who does not read, or has no address, goes without.
        if sender:
            with suppress(OSError):
                self._socket.sendto(answer, sender)
