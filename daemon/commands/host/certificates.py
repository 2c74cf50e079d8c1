"""`tentacled certificates DIR --host 192.168.1.10 --operator alice --viewer bob`."""

import argparse
import sys
from pathlib import Path

from daemon.commands.terminal.command_line import EXIT_FAILED, EXIT_OK, EXIT_USAGE
from daemon.host.clock import MonotonicClock
from daemon.remote.certificates import CertificateError, CertificateFolder
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


def run(arguments: argparse.Namespace) -> int:
    users = [*arguments.operator, *arguments.viewer]
    try:
        for user in users:
            Keys("robot").whoami(user)
    except ValueError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    if arguments.days < 1 or not (arguments.host or users):
        print("name a --host, an --operator or a --viewer, and one day at least", file=sys.stderr)
        return EXIT_USAGE
    folder = CertificateFolder(arguments.folder, MonotonicClock().wall_time_ns(), arguments.days)
    try:
        made = folder.make(arguments.host, users)
    except CertificateError as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    for path in made:
        print(f"made {path}")
    _tell(arguments)
    return EXIT_OK


def _tell(arguments: argparse.Namespace) -> None:
    host = arguments.host[0] if arguments.host else "ADDRESS"
    print("\nIn the robot file:\n\nremote:\n  tls:")
    print(f"    endpoint: {host}:{_DEFAULT_PORT}")
    print(f"    certificates: {arguments.folder.absolute()}\n  users:")
    for role in ("operator", "viewer"):
        for user in getattr(arguments, role):
            print(f"    {user}: {role}")
    print(
        "\nThe daemon needs ca.pem, server.pem and server.key; a user NAME needs ca.pem, NAME.pem"
    )
    print("and NAME.key, on the own machine. Keep ca.key where nobody else can read it.")
