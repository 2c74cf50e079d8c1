"""What all bridges share as processes: which robot and port, what they say, and their end."""

import argparse
import asyncio
import sys
from contextlib import suppress
from importlib.util import find_spec

from daemon.bridges.robot_feed import Listener, RobotFeed
from daemon.commands.outcome.failures import CommandError, UsageError
from daemon.commands.terminal.argument_types import port_number
from daemon.commands.terminal.remote_arguments import address, network_warnings
from daemon.host.stop_signals import StopSignals
from daemon.messages import Message, Surroundings, WhoAmI
from daemon.remote.client.address import Address
from daemon.remote.client.client_errors import ClientError


def add_port_arguments(parser: argparse.ArgumentParser, port: int, protocol: str) -> None:
    """Where others connect to. protocol: its name, for people."""
    parser.add_argument(
        "--port", type=port_number, default=port, metavar="N", help="default: %(default)s; 0: any"
    )
    parser.add_argument(
        "--bind",
        default="127.0.0.1",
        metavar="ADDRESS",
        help=f"other than this machine: {protocol} asks nobody who he is",
    )


def warn_of_network(bind: str, port: int) -> None:
    """On stderr, where others than this machine can connect."""
    for text in network_warnings(bind, port):
        print(text, file=sys.stderr)


def require_library(module: str, extra: str = "bridges") -> None:
    """Raises CommandError, which says how it is installed, where an optional one is not there."""
    if find_spec(module) is None:
        raise CommandError(
            "unavailable",
            f"this needs the library '{module}', which is not installed: "
            f"pip install 'tentacled[{extra}]'",
            place=module,
        )


def check_target(arguments: argparse.Namespace) -> None:
    """Raises UsageError where the words that say which daemon are wrong. One that is not running
    yet is waited for."""
    with suppress(ClientError):
        address(arguments)


async def follow(arguments: argparse.Namespace, listener: Listener) -> None:
    """Hand what the robot tells to a bridge, until Ctrl-C."""

    def find() -> Address:
        """A second daemon that comes makes nothing of what was said wrong for good."""
        try:
            return address(arguments)
        except UsageError as error:
            raise ClientError(str(error)) from None

    feed = RobotFeed(find, _Telling(listener))
    following = asyncio.create_task(feed.run())
    stopping = asyncio.create_task(StopSignals().wait(None))
    try:
        await asyncio.wait((following, stopping), return_when=asyncio.FIRST_COMPLETED)
        if following.done():  # only by an error of our own
            following.result()
    finally:
        for task in (following, stopping):
            task.cancel()
        await asyncio.gather(following, stopping, return_exceptions=True)


class _Telling:
    """Says on the terminal when a daemon comes and goes."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._was_there = False

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:
        self._was_there = True
        simulated = " (simulated)" if me.simulated else ""
        print(f"{me.robot}{simulated}: connected", flush=True)
        self._listener.connected(me, surroundings, mesh)

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        self._listener.surrounded(surroundings, mesh)

    def heard(self, message: Message, date_ns: int) -> None:
        self._listener.heard(message, date_ns)

    def lost(self, why: str) -> None:
        print(f"{'lost' if self._was_there else 'waiting'}: {why}", file=sys.stderr, flush=True)
        self._listener.lost(why)
