"""`tentacled recover [DIR]`: recordings that a crash has left unfinished are made whole."""

import argparse
import os
from pathlib import Path

from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.result import Result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "directory",
        type=Path,
        nargs="?",
        default=Path("runs"),
        metavar="DIR",
        help="a run's folder, or the folder of all runs (default: runs)",
    )


def run(arguments: argparse.Namespace) -> Result:
    # Nobody who asks for help alone waits for what reads recordings.
    from daemon.recording.recovery import recover_unfinished

    os.listdir(arguments.directory)  # noqa: PTH208 - it raises at once, iterdir only later
    outcomes = recover_unfinished(arguments.directory)
    lines = [str(outcome) for outcome in outcomes]
    return Result(
        {"recordings": outcomes},
        "\n".join(lines) or f"no unfinished recording in {arguments.directory}",
        EXIT_OK if all(outcome.complete for outcome in outcomes) else EXIT_FAILED,
    )
