"""`tentacled status`: the robot at a glance, once or live, for people or for programs."""

import argparse
import asyncio
from typing import Final

from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.argument_types import seconds
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    as_json,
    run_talk,
)
from daemon.host.stop_signals import StopSignals
from daemon.messages import Status
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError

_EVERY_S: Final = 0.25


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument("--watch", action="store_true", help="live, until Ctrl-C")
    parser.add_argument(
        "--every", type=seconds, default=_EVERY_S, metavar="S", help="with --watch: how often"
    )


def run(arguments: argparse.Namespace) -> Result:
    async def talk(client: RobotClient) -> Result:
        if not arguments.watch:
            status = await client.status()
            return Result(as_json(status), lambda: _show_once(status))
        if arguments.json:
            await _write(client, arguments.every)
        else:
            await _watch(client, arguments.every)
        return Result(None)

    return run_talk(arguments, talk)


def _show_once(status: Status) -> None:
    from daemon.commands.views.page import Size, print_page
    from daemon.commands.views.status_view import status_view

    print_page(status_view(status, Size.of_terminal()))


async def _write(client: RobotClient, every_s: float) -> None:
    stopping = asyncio.create_task(StopSignals().wait(None))
    while not stopping.done():
        tell("status", as_json(await client.status()))
        await asyncio.wait((stopping,), timeout=every_s)


async def _watch(client: RobotClient, every_s: float) -> None:
    """Goes on while the daemon is away: the connection comes back by itself."""
    from daemon.commands.views.page import LivePage, Size
    from daemon.commands.views.status_view import gone_view, status_view

    stopping = asyncio.create_task(StopSignals().wait(None))
    loop = asyncio.get_running_loop()
    last, last_s = None, loop.time()
    with LivePage() as live:
        while not stopping.done():
            try:
                last, last_s = await client.status(), loop.time()
                live.show(status_view(last, Size.of_terminal()))
            except ClientError as error:
                live.show(gone_view(last, str(error), loop.time() - last_s))
            await asyncio.wait((stopping,), timeout=every_s)
