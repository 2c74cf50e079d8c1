"""`tentacled start`: follow what was loaded, from its beginning."""

import argparse

from daemon.remote.command_line import (
    add_json_argument,
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.remote.messages import Start


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    add_json_argument(parser)
    add_timeout_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    return run_command(arguments, Start())
