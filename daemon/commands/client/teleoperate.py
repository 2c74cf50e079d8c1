"""`tentacled teleoperate`: follow the positions that come on standard input, one line each.

A line is `x y z` in mm, or `x y z vx vy vz`. It counts for a short while only: whoever writes them
must keep writing. When the input ends, the robot holds.
"""

import argparse
import asyncio
import math
import os
import sys
from collections.abc import Callable
from typing import Final

from daemon.commands.terminal.command_line import EXIT_FAILED, EXIT_OK
from daemon.commands.terminal.remote_arguments import add_target_arguments, run_talk
from daemon.host.stop_signals import StopSignals
from daemon.messages import SetpointRefused
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError
from daemon.remote.client.subscription import Subscription

_STDIN: Final = 0
_MOST_BYTES: Final = 65536


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument(
        "--valid", type=float, default=0.2, metavar="S", help="how long each position counts"
    )


def run(arguments: argparse.Namespace) -> int:
    async def talk(client: RobotClient) -> int:
        if not client.token:
            await client.acquire()
        return await _teleoperate(client, arguments.valid)

    return run_talk(arguments, talk)


async def _teleoperate(client: RobotClient, valid_s: float) -> int:
    stop = StopSignals()

    def send(line: bytes) -> None:
        position, velocity = _numbers(line)
        client.send_setpoint(position, valid_s, velocity)

    async with client.subscribe(["event"]) as events:
        await client.teleoperate()
        tasks = [
            asyncio.create_task(work)
            for work in (stop.wait(None), _Lines(send).follow(), _tell_refused(events))
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            await client.hold()
        finally:
            for task in tasks:
                task.cancel()
            outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    for outcome in outcomes:
        if isinstance(outcome, ClientError):
            raise outcome
        if isinstance(outcome, Exception):
            print(outcome, file=sys.stderr)
            return EXIT_FAILED
    return EXIT_OK


async def _tell_refused(events: Subscription) -> None:
    async for event in events:
        if isinstance(event, SetpointRefused):
            print(f"position {event.sequence}: {event.reason}", file=sys.stderr, flush=True)


class _Lines:
    """Standard input: of what has come in together only the newest line counts."""

    def __init__(self, on_line: Callable[[bytes], None]) -> None:
        self._on_line = on_line
        self._ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._rest = b""

    async def follow(self) -> None:
        """Until the input ends. Raises ValueError, ClientError."""
        loop = asyncio.get_running_loop()
        try:
            loop.add_reader(_STDIN, self._readable)
        except PermissionError:
            raise ValueError(
                "positions come from a pipe or a terminal: a file has no pace"
            ) from None
        try:
            await self._ended
        finally:
            loop.remove_reader(_STDIN)

    def _readable(self) -> None:
        if self._ended.done():
            return
        try:
            piece = os.read(_STDIN, _MOST_BYTES)
            *lines, self._rest = (self._rest + piece).split(b"\n")
            if not piece:
                self._ended.set_result(None)
            elif lines:
                self._on_line(lines[-1])
        except (OSError, ValueError, ClientError) as error:
            self._ended.set_exception(error)


def _numbers(line: bytes) -> tuple[list[float], list[float] | None]:
    """Position and velocity. Raises ValueError."""
    try:
        numbers = [float(word) for word in line.split()]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6) or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"`x y z` or `x y z vx vy vz` is wanted, not {line[:80]!r}")
    return numbers[:3], numbers[3:] or None
