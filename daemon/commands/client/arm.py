"""`tentacled arm`: energise the drives where they stand."""

import argparse

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.messages import Arm


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_timeout_argument(parser)
    parser.add_argument(
        "--despite-contact",
        action="store_true",
        help="arm a body that touches something, to lead it out",
    )


def run(arguments: argparse.Namespace) -> Result:
    return run_command(arguments, Arm(despite_contact=arguments.despite_contact))
