"""`tentacled bridge openigtlink [ROBOT]`: tip, body and state for 3D Slicer."""

import argparse
import asyncio
import socket
from typing import Final

from config.documents.problems import in_words
from daemon.bridges.openigtlink.server import OpenIGTLinkServer
from daemon.commands.bridge.bridge_process import (
    add_port_arguments,
    check_target,
    follow,
    warn_of_network,
)
from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.remote_arguments import add_target_arguments

_PORT: Final = 18944
"""That of OpenIGTLink, as IANA has registered it."""
_BODY: Final = {
    "line": ("POLYDATA",),
    "points": ("POINT",),
    "both": ("POLYDATA", "POINT"),
    "none": (),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_port_arguments(parser, _PORT, "OpenIGTLink")
    parser.add_argument(
        "--body",
        choices=_BODY,
        default="line",
        help="the centreline as one line (POLYDATA), as points (POINT; markups in Slicer), or not "
        "(default: %(default)s)",
    )


def run(arguments: argparse.Namespace) -> Result:
    check_target(arguments)
    try:
        asyncio.run(_serve(arguments))
    except (OSError, OverflowError) as error:
        told = in_words(error) if isinstance(error, OSError) else str(error)
        text = f"port {arguments.port} cannot be served: {told}"
        raise CommandError("unavailable", text, place=str(arguments.port)) from None
    return Result(None)


async def _serve(arguments: argparse.Namespace) -> None:
    """Raises OSError, OverflowError."""
    family = socket.AF_INET6 if ":" in arguments.bind else socket.AF_INET
    listening = socket.create_server((arguments.bind, arguments.port), family=family)
    host, port = listening.getsockname()[:2]
    server = OpenIGTLinkServer(arguments.robot or "robot", _BODY[arguments.body])
    await server.open(listening)
    try:
        warn_of_network(arguments.bind, port)
        ready = {"host": host, "port": port, "state": "ready"}
        tell("bridge openigtlink", ready, f"OpenIGTLink at {host}:{port}; Ctrl-C ends it")
        await follow(arguments, server)
    finally:
        await server.close()
