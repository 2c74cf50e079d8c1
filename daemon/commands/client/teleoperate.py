"""`tentacled teleoperate`: steer the tip by hand, or by the positions that come on standard input.

With `--device` by a 3D mouse, a gamepad or a mouse, while its dead-man's key is held; a journal of
that is replayed to the last bit. Else a line of standard input is `x y z` in mm, or
`x y z vx vy vz`. It counts for a short while only: whoever writes them must keep writing. When the
input ends, the robot holds.
"""

import argparse
import asyncio
import json
import math
import os
import sys
from collections.abc import Callable, Coroutine
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from daemon.commands.outcome.failures import CommandError, UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.remote_arguments import add_target_arguments, run_talk
from daemon.host.stop_signals import StopSignals
from daemon.messages import SetpointRefused
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, RefusedError
from daemon.remote.client.subscription import Subscription
from daemon.steering.devices import PROFILES
from daemon.steering.hand import HandSettings
from daemon.steering.station import JournalError, RecordedStation, Station, replayed

if TYPE_CHECKING:
    from daemon.steering.session import Asked

_STDIN: Final = 0
_MOST_BYTES: Final = 65536
_ENDED: Final = Result({"ended": "the robot holds"})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument(
        "--valid", type=float, default=0.2, metavar="S", help="how long each position counts"
    )
    parser.add_argument(
        "--controller",
        metavar="KIND",
        help="such as broyden, or its options as JSON (default: as the daemon chooses)",
    )
    hand = parser.add_argument_group(
        "by hand",
        "The tip moves while the dead-man's key is held: the left one of a 3D mouse or a mouse, "
        "the right shoulder of a gamepad. With the other one, the clutch, the hand comes back and "
        "the tip stays.",
    )
    source = hand.add_mutually_exclusive_group()
    source.add_argument(
        "--device", type=Path, metavar="PATH", help="such as /dev/input/event5, or a pipe like it"
    )
    source.add_argument(
        "--replay", type=Path, metavar="FILE", help="what --record has written, in its own rhythm"
    )
    hand.add_argument("--record", type=Path, metavar="FILE", help="write down all that comes in")
    hand.add_argument(
        "--profile", choices=sorted(PROFILES), help="of the device (default: as it looks)"
    )
    usual = HandSettings()
    for option, default, unit, what in (
        ("--speed", usual.speed_mm_s, "MM/S", "of the tip, with the device pushed all the way"),
        ("--turn", usual.turn_rad_s, "RAD/S", "the same of its direction"),
        ("--scale", usual.scale, "RATIO", "the tip's way against the hand's, with a mouse"),
        ("--leash", usual.leash_mm, "MM", "how far the target may be ahead of the tip"),
    ):
        hand.add_argument(
            option, type=float, default=default, metavar=unit, help=f"{what} (default: %(default)s)"
        )
    hand.add_argument(
        "--axes",
        default=usual.axes,
        metavar="AXES",
        help="of the base frame: where the hand's right, away and up lead, such as -y+x+z",
    )
    hand.add_argument("--pointing", action="store_true", help="steer the tip's direction, too")


def run(arguments: argparse.Namespace) -> Result:
    try:
        controller = _controller(arguments.controller)
        settings = _settings(arguments)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if arguments.device is not None:
        return _by_hand(arguments, settings, controller)
    if arguments.record is not None:
        raise UsageError("--record goes with --device")
    if arguments.replay is not None:
        return _again(arguments, controller)

    async def talk(client: RobotClient) -> Result:
        if not client.token:
            await client.acquire()
        return await _teleoperate(client, arguments.valid, controller)

    return run_talk(arguments, talk)


def _controller(text: str | None) -> dict[str, Any] | None:
    """Raises ValueError."""
    if text is None or not text.startswith("{"):
        return None if text is None else {"kind": text}
    try:
        found = json.loads(text)
    except ValueError as error:
        raise ValueError(f"--controller: {error}") from None
    assert isinstance(found, dict)
    return found


def _settings(arguments: argparse.Namespace) -> HandSettings:
    """Raises ValueError."""
    return HandSettings(
        speed_mm_s=arguments.speed,
        turn_rad_s=arguments.turn,
        scale=arguments.scale,
        leash_mm=arguments.leash,
        axes=arguments.axes,
        pointing=arguments.pointing,
    )


# By hand.


def _by_hand(
    arguments: argparse.Namespace, settings: HandSettings, controller: dict[str, Any] | None
) -> Result:
    from daemon.steering.hid_device import HidDevice

    device = HidDevice(arguments.device, arguments.profile)
    with ExitStack() as open_files:
        open_files.callback(device.close)
        station = Station(device.kind.made(), settings)
        if arguments.record is not None:
            journal = open_files.enter_context(arguments.record.open("xb"))
            station = RecordedStation(device.kind, settings, journal.write)

        async def work(client: RobotClient, asked: "Asked") -> None:
            from daemon.steering.session import steer

            await steer(client, device, station, asked, controller)
            print("the device has gone: the robot holds", file=sys.stderr, flush=True)

        return run_talk(arguments, lambda client: _until_stopped(client, arguments.valid, work))


def _again(arguments: argparse.Namespace, controller: dict[str, Any] | None) -> Result:
    try:
        with arguments.replay.open("rb") as journal:
            path = list(replayed(journal))
    except JournalError as error:
        text = f"{arguments.replay}: {error}"
        raise CommandError("unusable_data", text, place=str(arguments.replay)) from None

    async def work(client: RobotClient, asked: "Asked") -> None:
        from daemon.steering.session import replay

        await replay(client, iter(path), asked, controller)

    return run_talk(arguments, lambda client: _until_stopped(client, arguments.valid, work))


async def _until_stopped(
    client: RobotClient,
    valid_s: float,
    work: "Callable[[RobotClient, Asked], Coroutine[Any, Any, None]]",
) -> Result:
    """The work, until it ends or Ctrl-C does; then the robot holds."""
    from daemon.steering.session import Asked

    if not client.token:
        await client.acquire()
    stop = StopSignals()
    asked = Asked(client, valid_s, lambda text: print(text, file=sys.stderr, flush=True))
    tasks = [asyncio.create_task(stop.wait(None)), asyncio.create_task(work(client, asked))]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        with suppress(RefusedError):  # it holds already
            await client.hold()
    finally:
        await asked.close()
        for task in tasks:
            task.cancel()
        outcomes = await asyncio.gather(*tasks, return_exceptions=True)
    if isinstance(failure := outcomes[1], Exception):
        raise failure
    return _ENDED


# By lines of standard input.


async def _teleoperate(
    client: RobotClient, valid_s: float, controller: dict[str, Any] | None
) -> Result:
    stop = StopSignals()

    def send(line: bytes) -> None:
        position, velocity = _numbers(line)
        client.send_setpoint(position, valid_s, velocity)

    async with client.subscribe(["event"]) as events:
        await client.teleoperate(controller)
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
            raise CommandError("failed", str(outcome)) from None
    return _ENDED


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
