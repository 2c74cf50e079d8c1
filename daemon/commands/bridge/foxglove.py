"""`tentacled bridge foxglove [ROBOT]`: the robot live in Foxglove and Lichtblick."""

import argparse
import asyncio
import json
import sys
from typing import Final

from daemon.commands.bridge.bridge_process import check_target, follow, require_library
from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.remote_arguments import add_target_arguments

_PORT: Final = 8765
"""That of Foxglove's WebSocket protocol."""
_LOOPBACK: Final = ("127.0.0.1", "::1", "localhost")
_VIEWERS: Final = ("foxglove", "lichtblick")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument(
        "--port", type=int, default=_PORT, metavar="N", help="default: %(default)s; 0: any"
    )
    parser.add_argument(
        "--bind",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="other than this machine: the protocol asks nobody who he is",
    )
    parser.add_argument(
        "--layout",
        choices=_VIEWERS,
        help="print a layout for that viewer, to be imported there, and end",
    )


def run(arguments: argparse.Namespace) -> Result:
    if arguments.layout is not None:
        from daemon.bridges.foxglove.layouts import layout

        text = layout(arguments.layout)
        return Result({"viewer": arguments.layout, "layout": json.loads(text)}, text.rstrip())
    check_target(arguments)
    require_library("foxglove")
    asyncio.run(_serve(arguments))
    return Result(None)


async def _serve(arguments: argparse.Namespace) -> None:
    """Raises CommandError."""
    from daemon.bridges.foxglove.live import FoxgloveServer

    try:
        name = f"tentacled {arguments.robot or ''}".strip()
        server = FoxgloveServer(name, arguments.bind, arguments.port)
    except (RuntimeError, OSError, OverflowError, ValueError) as error:
        text = f"port {arguments.port} cannot be served: {error}"
        raise CommandError("unavailable", text, place=str(arguments.port)) from None
    try:
        if arguments.bind not in _LOOPBACK:
            print(f"warning: port {server.port} is open to the network", file=sys.stderr)
        ready = {"host": arguments.bind, "port": server.port, "state": "ready"}
        text = f"Foxglove at ws://{arguments.bind}:{server.port}; Ctrl-C ends it"
        tell("bridge foxglove", ready, text)
        await follow(arguments, server)
    finally:
        server.close()
