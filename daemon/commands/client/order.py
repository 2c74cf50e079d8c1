"""`tentacled start`, `hold`, `resume`, `disarm`, `clear`: one word to the running daemon."""

import argparse
from typing import Final

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.messages import Clear, Command, Disarm, Hold, Resume, Start, verb

_ORDERS: Final[dict[str, type[Command]]] = {
    verb(kind): kind for kind in (Start, Hold, Resume, Disarm, Clear)
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_timeout_argument(parser)


def run(arguments: argparse.Namespace) -> Result:
    return run_command(arguments, _ORDERS[arguments.command]())
