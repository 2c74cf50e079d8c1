"""`tentacled report RUN`: one HTML file that shows what happened in a run."""

import argparse
import sys
from pathlib import Path

from config.documents.problems import in_words
from daemon.commands.terminal.command_line import EXIT_FAILED, EXIT_OK


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="a run's folder, or one recording in it (run.mcap)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="default: report.html in the run's folder"
    )


def run(arguments: argparse.Namespace) -> int:
    # matplotlib is slow to come: `--help` does without.
    from daemon.recording.run_reader import UnreadableRunError
    from daemon.workbench.report.report import write_report

    try:
        print(write_report(arguments.run, arguments.out))
    except UnreadableRunError as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    except OSError as error:
        print(in_words(error, arguments.run), file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK
