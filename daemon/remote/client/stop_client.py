"""The client's end of STOP's own way. Imports nothing that a STOP would have to wait for."""

import asyncio
import errno
import socket
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from daemon.messages import Answer, Refusal, Stop
from daemon.remote.client.client_errors import ClientError, RefusedError, TimedOutError
from daemon.remote.wire import Format, WireError, decode_one_of, encode

if TYPE_CHECKING:
    import ssl

_CONNECTS_WITHIN_S: Final = 3.0
_TRY_AGAIN_S: Final = 0.001
_OTHER_WAY_AFTER_S: Final = 0.25
"""No answer by its own way after this long: the drives may need longer, but the daemon may be an
older one too, so that the STOP is sent by the ordinary way besides."""
_ANSWER_BYTES: Final = 65536

OtherWay = Callable[[float], Awaitable[Answer]]
"""Sends a STOP as an ordinary command. Gets how long it may take; raises ClientError."""


class NoStopWayError(ClientError):
    """The daemon has no such way for us; the ordinary one is left."""


async def stop_locally(path: Path, request: str, within_s: float) -> Answer:
    """STOP by the socket at `path`. Raises ClientError."""
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.setblocking(False)
        try:
            line.bind("")  # the kernel makes up an address, for the answer
            line.connect(str(path))
        except OSError as error:
            raise NoStopWayError(f"{path}: {error.strerror or error}") from None
        try:
            async with asyncio.timeout(within_s):
                await _send(line, encode(Stop(request=request), Format.JSON), path)
                return stop_answer(await loop.sock_recv(line, _ANSWER_BYTES))
        except TimeoutError:
            raise TimedOutError(f"no answer to the STOP within {within_s:g} s") from None
        except OSError as error:
            raise NoStopWayError(f"{path}: {error.strerror or error}") from None


class StopLine:
    """A connection over tls for nothing but STOP: kept, nothing has to be made when it counts."""

    def __init__(self, endpoint: str, authority: Path, certificate: Path, key: Path) -> None:
        """endpoint: host:port."""
        self._endpoint = endpoint
        self._files = authority, certificate, key
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._busy = asyncio.Lock()

    async def __aenter__(self) -> "StopLine":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def connect(self) -> None:
        """Raises NoStopWayError; again where the connection is gone."""
        if self._streams is not None and not self._streams[0].at_eof():
            return
        await self.close()
        host, _, port = self._endpoint.rpartition(":")
        try:
            self._streams = await asyncio.open_connection(
                host.strip("[]"),
                int(port),
                ssl=self._context(),
                ssl_handshake_timeout=_CONNECTS_WITHIN_S,
            )
        except OSError as error:
            raise NoStopWayError(f"{self._endpoint}: {error.strerror or error}") from None

    async def stop(self, request: str, within_s: float) -> Answer:
        """STOP. Raises ClientError."""
        try:
            async with asyncio.timeout(within_s), self._busy:
                await self.connect()
                return await self._answered(request)
        except TimeoutError:
            raise TimedOutError(f"no answer to the STOP within {within_s:g} s") from None
        except (OSError, ValueError) as error:
            await self.close()
            raise NoStopWayError(f"{self._endpoint}: {error}") from None

    async def _answered(self, request: str) -> Answer:
        assert self._streams is not None
        reader, writer = self._streams
        writer.write(encode(Stop(request=request), Format.JSON))
        await writer.drain()
        while line := await reader.readline():
            answer = stop_answer(line)
            if answer.request == request:
                return answer
        await self.close()
        raise NoStopWayError(f"{self._endpoint} has hung up")

    async def close(self) -> None:
        """Hang up. May be repeated."""
        streams, self._streams = self._streams, None
        if streams is not None:
            streams[1].transport.abort()
            with suppress(OSError):
                await streams[1].wait_closed()

    def _context(self) -> "ssl.SSLContext":
        import ssl  # only wanted here, and slow to import

        authority, certificate, key = self._files
        context = ssl.create_default_context(cafile=str(authority))
        context.load_cert_chain(certificate, key)
        return context


async def _send(line: socket.socket, payload: bytes, path: Path) -> None:
    """Where no more fits, as many STOPs are on their way: still, ours shall be answered."""
    while True:
        try:
            line.send(payload)
            return
        except BlockingIOError:
            await asyncio.sleep(_TRY_AGAIN_S)
        except OSError as error:
            if error.errno != errno.ENOBUFS:
                raise NoStopWayError(f"{path}: {error.strerror}") from None
            await asyncio.sleep(_TRY_AGAIN_S)


def stop_answer(payload: bytes) -> Answer:
    """The answer in what came back. Raises ClientError."""
    try:
        message = decode_one_of(payload, (Answer, Refusal), Format.JSON)
    except WireError as error:
        raise NoStopWayError(f"this is not what a daemon answers: {error}") from None
    if isinstance(message, Refusal):
        raise RefusedError(message)
    assert isinstance(message, Answer)
    return message


async def first_answer(own_way: Awaitable[Answer], other_way: OtherWay, within_s: float) -> Answer:
    """By STOP's own way; and by the other one too where that brings nothing soon.

    Raises the ClientError of the way that was tried last.
    """
    direct = asyncio.ensure_future(own_way)
    tasks = [direct]
    try:
        done, _ = await asyncio.wait([direct], timeout=min(_OTHER_WAY_AFTER_S, within_s))
        if done and direct.exception() is None:
            return direct.result()
        left_s = max(within_s - _OTHER_WAY_AFTER_S, _TRY_AGAIN_S) if not done else within_s
        tasks.append(asyncio.ensure_future(other_way(left_s)))
        return await _first_result(tasks)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _first_result(tasks: Sequence[asyncio.Future[Answer]]) -> Answer:
    waiting = set(tasks)
    while waiting:
        done, waiting = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            with suppress(ClientError):
                return task.result()
    return tasks[-1].result()
