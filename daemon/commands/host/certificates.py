"""`tentacled certificates DIR --host 192.168.1.10 --operator alice --viewer bob`."""

import argparse
from pathlib import Path
from typing import Any

from config.remote import LOCAL_USER
from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.host.clock import MonotonicClock
from daemon.remote.certificates import CertificateFolder
from daemon.remote.keys import Keys

_DEFAULT_DAYS = 730
_DEFAULT_PORT = 7448


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="where they are kept")
    parser.add_argument(
        "--host",
        nargs="+",
        default=[],
        metavar="NAME",
        help="the daemon's machine, by all names and addresses that clients use for it",
    )
    parser.add_argument(
        "--operator", nargs="+", default=[], metavar="NAME", help="users who may command"
    )
    parser.add_argument(
        "--viewer", nargs="+", default=[], metavar="NAME", help="users who may watch"
    )
    parser.add_argument(
        "--days", type=int, default=_DEFAULT_DAYS, help="how long they are good for"
    )


def run(arguments: argparse.Namespace) -> Result:
    users = [*arguments.operator, *arguments.viewer]
    try:
        for user in users:
            Keys("robot").whoami(user)
    except ValueError as error:
        raise UsageError(str(error)) from None
    if LOCAL_USER in users:
        raise UsageError(f"'{LOCAL_USER}' is whoever uses the unix socket: take another name")
    if arguments.days < 1 or not (arguments.host or users):
        raise UsageError("name a --host, an --operator or a --viewer, and one day at least")
    folder = CertificateFolder(arguments.folder, MonotonicClock().wall_time_ns(), arguments.days)
    made = folder.make(arguments.host, users)
    told = "\n".join([*(f"made {path}" for path in made), *_what_is_next(arguments)])
    return Result({"made": made, "robot_file": _robot_file(arguments)}, told)


def _robot_file(arguments: argparse.Namespace) -> dict[str, Any]:
    """What goes into it."""
    host = arguments.host[0] if arguments.host else "ADDRESS"
    users = {user: role for role in ("operator", "viewer") for user in getattr(arguments, role)}
    tls = {"endpoint": f"{host}:{_DEFAULT_PORT}", "certificates": str(arguments.folder.absolute())}
    return {"remote": {"tls": tls, "users": users}}


def _what_is_next(arguments: argparse.Namespace) -> list[str]:
    remote = _robot_file(arguments)["remote"]
    return [
        "\nIn the robot file:\n\nremote:\n  tls:",
        *(f"    {key}: {value}" for key, value in remote["tls"].items()),
        "  users:",
        *(f"    {user}: {role}" for user, role in remote["users"].items()),
        "\nThe daemon needs ca.pem, server.pem and server.key; a user NAME needs ca.pem, NAME.pem",
        "and NAME.key, on the own machine. Keep ca.key where nobody else can read it.",
    ]
