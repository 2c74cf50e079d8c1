"""`tentacled report RUN`: one HTML file that shows what happened in a run."""

import argparse
from pathlib import Path

from daemon.commands.outcome.failures import about
from daemon.commands.outcome.result import Result


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="a run's folder, or one recording in it (run.mcap)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="default: report.html in the run's folder"
    )


def run(arguments: argparse.Namespace) -> Result:
    # matplotlib is slow to come: `--help` does without.
    from daemon.workbench.report.report import write_report

    with about(arguments.run):
        written = write_report(arguments.run, arguments.out)
    return Result({"report": written}, str(written))
