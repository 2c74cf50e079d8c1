"""`tentacled home`: let axes look for their zeros, and show how far they are."""

import argparse
import asyncio
import sys
from typing import TYPE_CHECKING

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seconds
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    answer_result,
    run_talk,
)
from daemon.messages import Event
from daemon.remote.client.client_errors import HOMES_WITHIN_S

if TYPE_CHECKING:
    from daemon.remote.client.client import RobotClient


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--axis",
        action="append",
        default=[],
        metavar="NAME",
        help="this one, and whichever else is named; without any: all that do not know their zero",
    )
    add_target_arguments(parser)
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=HOMES_WITHIN_S,
        metavar="S",
        help="how long to wait for the answer; the axes have limits of their own",
    )


def run(arguments: argparse.Namespace) -> Result:
    async def talk(client: "RobotClient") -> Result:
        showing = asyncio.create_task(_show(client))
        try:
            answer = await client.home(arguments.axis, arguments.timeout)
        finally:
            showing.cancel()
        return answer_result(answer)

    return run_talk(arguments, talk)


async def _show(client: "RobotClient") -> None:
    async with client.subscribe(["event"]) as events:
        async for event in events:
            if isinstance(event, Event) and event.kind == "homing":
                detail = f": {event.detail}" if event.detail else ""
                print(f"{event.text}{detail}", file=sys.stderr, flush=True)
