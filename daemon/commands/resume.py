"""`tentacled resume`: go on from where the motion was held."""

import argparse

from daemon.remote.command_line import (
    add_json_argument,
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.remote.messages import Resume


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_json_argument(parser)
    add_timeout_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    return run_command(arguments, Resume())
