"""`tentacled recover [DIR]`: recordings that a crash has left unfinished are made whole."""

import argparse
import os
import sys
from pathlib import Path

from config.documents.problems import in_words
from daemon.commands.terminal.command_line import EXIT_FAILED, EXIT_OK
from daemon.recording.recovery import recover_unfinished


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "directory",
        type=Path,
        nargs="?",
        default=Path("runs"),
        metavar="DIR",
        help="a run's folder, or the folder of all runs (default: runs)",
    )


def run(arguments: argparse.Namespace) -> int:
    try:
        os.listdir(arguments.directory)  # noqa: PTH208 - it raises at once, iterdir only later
    except OSError as error:
        print(in_words(error), file=sys.stderr)
        return EXIT_FAILED
    outcomes = recover_unfinished(arguments.directory)
    for outcome in outcomes:
        print(outcome)
    if not outcomes:
        print(f"no unfinished recording in {arguments.directory}")
    return EXIT_OK if all(outcome.complete for outcome in outcomes) else EXIT_FAILED
