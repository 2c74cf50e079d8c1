"""`tentacled bridge foxglove [ROBOT]`: the robot live in Foxglove and Lichtblick."""

import argparse
import asyncio
import json
from importlib.resources import files
from typing import Final

from daemon.commands.bridge.bridge_process import (
    add_port_arguments,
    check_target,
    follow,
    require_library,
    warn_of_network,
)
from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.remote_arguments import add_target_arguments

_PORT: Final = 8765
"""That of Foxglove's WebSocket protocol."""
VIEWERS: Final = ("foxglove", "lichtblick")
"""Each has layouts of its own format."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_port_arguments(parser, _PORT, "its protocol")
    parser.add_argument(
        "--layout",
        choices=VIEWERS,
        help="print a layout for that viewer, to be imported there, and end",
    )


def run(arguments: argparse.Namespace) -> Result:
    if arguments.layout is not None:
        text = layout(arguments.layout)
        return Result({"viewer": arguments.layout, "layout": json.loads(text)}, text.rstrip())
    check_target(arguments)
    require_library("foxglove")
    asyncio.run(_serve(arguments))
    return Result(None)


def layout(viewer: str) -> str:
    """A JSON file's text, of one of VIEWERS: panels with topics that it does not switch on by
    itself."""
    path = files("daemon.bridges.foxglove") / "layouts" / f"{viewer}.json"
    return path.read_text(encoding="utf-8")


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
        warn_of_network(arguments.bind, server.port)
        ready = {"host": arguments.bind, "port": server.port, "state": "ready"}
        text = f"Foxglove at ws://{arguments.bind}:{server.port}; Ctrl-C ends it"
        tell("bridge foxglove", ready, text)
        await follow(arguments, server)
    finally:
        server.close()
