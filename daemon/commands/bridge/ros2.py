"""`tentacled bridge ros2 [ROBOT]`: tip, body, axes and causes for ROS 2 with rmw_zenoh."""

import argparse
import asyncio
import os
from typing import Final

from daemon.commands.bridge.bridge_process import check_target, follow, require_library
from daemon.commands.outcome.failures import CommandError, UsageError
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.remote_arguments import add_target_arguments, address
from daemon.remote.client.client_errors import ClientError

_ROUTER: Final = "tcp/localhost:7447"
_DISTROS: Final = ("jazzy", "kilted")
_PROTOCOLS: Final = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream", "vsock")
"""Of zenoh."""
_DOMAIN: Final = "ROS_DOMAIN_ID"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument(
        "--router",
        type=_endpoint,
        default=_ROUTER,
        metavar="ENDPOINT",
        help="of rmw_zenoh's router (default: %(default)s)",
    )
    parser.add_argument(
        "--be-router", action="store_true", help="be the router there: none runs on this bench"
    )
    parser.add_argument(
        "--domain", type=int, metavar="N", help=f"ROS domain (default: ${_DOMAIN}, or 0)"
    )
    parser.add_argument("--distro", choices=_DISTROS, default=_DISTROS[0], help="of those who hear")


def _endpoint(text: str) -> str:
    """Raises ArgumentTypeError."""
    protocol, _, address = text.partition("/")
    if protocol not in _PROTOCOLS or not address:
        raise argparse.ArgumentTypeError(f"{text!r} is no endpoint such as {_ROUTER}")
    return text


def run(arguments: argparse.Namespace) -> Result:
    check_target(arguments)
    told = os.environ.get(_DOMAIN) or "0"
    if arguments.domain is None and not told.isdecimal():
        raise UsageError(f"${_DOMAIN} is {told!r}, which is no number", place=_DOMAIN)
    require_library("rosbags")
    domain = int(told) if arguments.domain is None else arguments.domain
    asyncio.run(_publish(arguments, _name(arguments), domain))
    return Result(None)


def _name(arguments: argparse.Namespace) -> str:
    """Topics are declared before the daemon is there: who leaves its name out gets that of the one
    that runs, or `robot`."""
    try:
        return address(arguments).robot
    except ClientError:
        return str(arguments.robot or "robot")


async def _publish(arguments: argparse.Namespace, robot: str, domain: int) -> None:
    """Raises CommandError."""
    import zenoh

    from daemon.bridges.ros2.publisher import RosPublisher

    endpoint = arguments.router
    try:
        publisher = RosPublisher(
            robot, domain, endpoint, distro=arguments.distro, router=arguments.be_router
        )
    except ValueError as error:
        raise UsageError(str(error)) from None
    except zenoh.ZError as error:
        raise CommandError("unavailable", f"{endpoint}: {error}", place=endpoint) from None
    try:
        way = "router at" if arguments.be_router else "by the router at"
        ready = {"domain": domain, "router": endpoint, "state": "ready"}
        tell("bridge ros2", ready, f"ROS domain {domain}, {way} {endpoint}; Ctrl-C ends it")
        await follow(arguments, publisher)
    finally:
        publisher.close()
