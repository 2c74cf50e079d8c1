"""What all commands that talk to a running daemon share: finding it, and telling how it went."""

import argparse
import asyncio
import sys
from collections.abc import Awaitable, Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from config.documents.problems import did_you_mean
from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seconds
from daemon.messages import Answer, Command, Message
from daemon.remote.client.address import Address, LocalAddress, TlsAddress
from daemon.remote.client.client_errors import ARMS_WITHIN_S, DaemonNotRunningError
from daemon.remote.client.token_file import stored_token, token_file
from daemon.remote.discovery import running_daemons

if TYPE_CHECKING:  # `tentacled stop` must be quick, and needs no session
    from daemon.remote.client.client import RobotClient

Talk = Callable[["RobotClient"], Awaitable[Result]]
"""What to do with a connected client. May raise ClientError."""

LOOPBACK: Final = ("127.0.0.1", "::1", "localhost")
"""Addresses that this machine alone reaches."""


def add_target_arguments(parser: argparse.ArgumentParser) -> None:
    """Which daemon. None of them is needed where one daemon runs on this machine."""
    parser.add_argument(
        "robot", nargs="?", metavar="ROBOT", help="its name, if several are running"
    )
    parser.add_argument("--runtime-dir", type=Path, metavar="DIR", help="the daemon's folder")
    parser.add_argument("--connect", metavar="HOST:PORT", help="a daemon on another machine")
    parser.add_argument("--certificates", type=Path, metavar="DIR", help="with --connect")
    parser.add_argument("--user", metavar="NAME", help="with --connect: whose certificate")


def add_timeout_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=ARMS_WITHIN_S,
        metavar="S",
        help="how long to wait for the answer",
    )


def addresses(arguments: argparse.Namespace) -> list[Address]:
    """The daemons that are meant. Raises UsageError, DaemonNotRunningError."""
    if arguments.connect is not None:
        return [_tls_address(arguments)]
    if arguments.certificates is not None or arguments.user is not None:
        raise UsageError("--certificates and --user go with --connect")
    if arguments.runtime_dir is not None:
        return [_named(LocalAddress.in_folder(arguments.runtime_dir), arguments.robot)]
    root = _runtime_root()
    if arguments.robot is not None:
        return [_by_name(arguments.robot, root)]
    folders = running_daemons(root)
    if not folders:
        raise DaemonNotRunningError(
            "no daemon is running: start one with `tentacled run`, or name its --runtime-dir"
        )
    return [LocalAddress.in_folder(folder) for folder in folders]


def _by_name(robot: str, root: Path) -> LocalAddress:
    """Raises DaemonNotRunningError, which names the robot that may have been meant."""
    try:
        return LocalAddress.in_folder(root / robot)
    except DaemonNotRunningError as error:
        running = [folder.name for folder in running_daemons(root)]
        meant = did_you_mean(Path(robot).stem, running)
        raise DaemonNotRunningError(f"{error}{meant}") from None


def address(arguments: argparse.Namespace) -> Address:
    """The one daemon that is meant. Raises UsageError, DaemonNotRunningError."""
    found = addresses(arguments)
    if len(found) > 1:
        names = ", ".join(one.robot for one in found)
        raise UsageError(f"several daemons are running: name one of {names}")
    return found[0]


def lease_file(target: Address) -> Path:
    """Where the lease for this daemon is kept."""
    if isinstance(target, LocalAddress):
        return token_file(target.unix_socket.parent, target.user)
    folder = _runtime_root() / "leases" / target.endpoint.replace(":", "_")
    return token_file(folder, f"{target.robot}.{target.user}")


def run_command(arguments: argparse.Namespace, command: Command) -> Result:
    """Have `command` carried out with the lease that is kept. Raises UsageError, ClientError."""

    async def talk(client: "RobotClient") -> Result:
        return answer_result(await client.send(command, arguments.timeout))

    return run_talk(arguments, talk)


def run_talk(arguments: argparse.Namespace, talk: Talk) -> Result:
    """Connect to the one daemon that is meant, and talk. Raises UsageError, ClientError."""
    return asyncio.run(_talk(address(arguments), talk))


async def _talk(target: Address, talk: Talk) -> Result:
    from daemon.remote.client.client import RobotClient

    async with await RobotClient.connect(target, own_stop=False) as client:
        client.token = stored_token(lease_file(target))
        return await talk(client)


def as_json(message: Message) -> dict[str, Any]:
    """A message, for `--json`."""
    content: dict[str, Any] = msgspec.to_builtins(message)
    return content


def answer_result(answer: Answer) -> Result:
    """What is told of an answer."""

    def show() -> None:
        print(f"{answer.state}{': ' if answer.text else ''}{answer.text}")
        if not answer.confirmed:
            print(
                "NOT CONFIRMED: the drives have not said that they did it. Use the robot's own "
                "emergency stop if it moves.",
                file=sys.stderr,
            )

    return Result(as_json(answer), show, EXIT_OK if answer.confirmed else EXIT_FAILED)


def tell_text(texts: Iterable[str | Callable[[], None]]) -> None:
    """Several results' texts, one after the other."""
    for text in texts:
        if callable(text):
            text()
        elif text:
            print(text)


def _named(found: LocalAddress, robot: str | None) -> LocalAddress:
    if robot is not None and found.robot != robot:
        raise DaemonNotRunningError(f"the daemon there is the one of {found.robot}, not of {robot}")
    return found


def _tls_address(arguments: argparse.Namespace) -> TlsAddress:
    if None in (arguments.robot, arguments.certificates, arguments.user):
        raise UsageError("--connect needs the robot's name, --certificates and --user")
    if arguments.runtime_dir is not None:
        raise UsageError("--connect and --runtime-dir are two different daemons")
    return TlsAddress(arguments.robot, arguments.connect, arguments.certificates, arguments.user)


def _runtime_root() -> Path:
    # Imported when wanted: it brings the robot file's schema along, and `stop` is in a hurry.
    from daemon.robot.runtime_directory import default_runtime_directory

    return default_runtime_directory("any").parent


def network_warnings(bind: str, port: int) -> list[str]:
    """What whoever serves `port` at the address `bind` is to know of who else can connect."""
    if bind in LOOPBACK:
        return []
    return [f"warning: port {port} is open to the network, at {bind}"]
