"""The client's end of STOP's own way. Imports nothing that a STOP would have to wait for."""

import asyncio
import errno
import socket
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from daemon.remote.client_errors import ClientError, RefusedError, TimedOutError
from daemon.remote.messages import Answer, Refusal, Stop
from daemon.remote.wire import Format, WireError, decode_one_of, encode

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
