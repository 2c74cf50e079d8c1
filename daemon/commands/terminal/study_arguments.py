"""The words on the command line that say which study, how much of it, and where to."""

import argparse
from importlib.resources import files
from pathlib import Path


def add_grid_arguments(parser: argparse.ArgumentParser) -> None:
    """What is to be run, and where it goes."""
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="for runs, tables and pictures; runs that are there and finished are not done again",
    )
    parser.add_argument("--seeds", type=int, metavar="N", help="instead of the study's")
    parser.add_argument(
        "--plants", type=int, metavar="N", help="instead of the study's; 0: the robot file's own"
    )
    parser.add_argument(
        "--jobs", type=int, default=2, metavar="N", help="processes at the same time (default 2)"
    )
    parser.add_argument(
        "--keep-recordings", action="store_true", help="16 MB for each run of 400 s"
    )


def shipped_study(name: str) -> Path:
    """The file of a shipped study, or the path that is meant itself."""
    shipped = Path(str(files("config") / "studies" / f"{name}.yaml"))
    return shipped if shipped.is_file() else Path(name)
