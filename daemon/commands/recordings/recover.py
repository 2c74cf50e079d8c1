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
        help="a run's folder, a recording in it, or the folder of all runs (default: runs)",
    )


def run(arguments: argparse.Namespace) -> Result:
    # Nobody who asks for help alone waits for what reads recordings.
    from daemon.recording.recovery import recover_unfinished
    from daemon.recording.run_parts import segment_number

    named: Path = arguments.directory
    a_recording = named.is_file() and segment_number(named) is not None
    folder = named.parent if a_recording else named
    os.listdir(folder)  # noqa: PTH208 - it raises at once, iterdir only later
    outcomes = recover_unfinished(folder)
    lines = [str(outcome) for outcome in outcomes]
    return Result(
        {"recordings": outcomes},
        "\n".join(lines) or f"no unfinished recording in {folder}",
        EXIT_OK if all(outcome.complete for outcome in outcomes) else EXIT_FAILED,
    )
