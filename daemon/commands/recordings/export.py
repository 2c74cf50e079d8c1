"""`tentacled export RUN`: a recording as tables that other programs read."""

import argparse
import sys
from pathlib import Path
from typing import Final

from daemon.commands.outcome.failures import about
from daemon.commands.outcome.result import Result

_FORMATS: Final = ("csv", "parquet")
_FOLDER: Final = "export"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="a run's folder, or one recording in it (run.mcap)"
    )
    parser.add_argument(
        "--foxglove",
        type=Path,
        metavar="OUT.mcap",
        help="instead of tables: with a scene, transforms and a log, for Foxglove and Lichtblick",
    )
    parser.add_argument(
        "--format", choices=_FORMATS, default=_FORMATS[0], help="default: %(default)s"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"default: {_FOLDER} in the run's folder"
    )
    parser.add_argument(
        "--table",
        action="append",
        default=[],
        metavar="NAME",
        help="this one, and whichever else is named (default: all); `steps` has a row for each "
        "control step, the others one for each message of state, tip, axes, risk, loop, event, "
        "internal_error, body, surroundings_changed, obstacles_taken, path_planned",
    )


def run(arguments: argparse.Namespace) -> Result:
    # Nobody who asks for help alone waits for what reads recordings.
    from daemon.commands.outcome.failures import UsageError

    if arguments.foxglove is not None:
        if arguments.out is not None or arguments.table:
            raise UsageError("--out and --table are of tables: --foxglove names its own file")
        return _export_for_foxglove(arguments.run, arguments.foxglove)
    from daemon.recording.export.files import write_csv, write_parquet
    from daemon.recording.export.tables import TABLES, read_tables

    try:
        with about(arguments.run):
            tables = read_tables(arguments.run, arguments.table or TABLES)
    except ValueError as error:
        if arguments.table and not set(arguments.table) <= set(TABLES):
            raise UsageError(str(error), place="--table") from None
        raise
    run_folder = arguments.run if arguments.run.is_dir() else arguments.run.parent
    folder = arguments.out or run_folder / _FOLDER
    write = {"csv": write_csv, "parquet": write_parquet}[arguments.format]
    written = write(tables, folder)
    possible = [folder / f"{name}.{arguments.format}" for name in TABLES]
    older = [path for path in possible if path not in written and path.exists()]
    stay = [f"{path} was there before, and is not of this export" for path in older]
    notes = [*tables.notes, *stay]
    for note in notes:
        print(note, file=sys.stderr)
    told = {
        "written": written,
        "rows": {name: table.rows for name, table in tables.tables.items()},
        "notes": notes,
    }
    return Result(told, "\n".join(map(str, written)))


def _export_for_foxglove(run: Path, out: Path) -> Result:
    """Raises CommandError, UnreadableRunError, OSError."""
    from daemon.commands.bridge.bridge_process import require_library
    from daemon.commands.outcome.failures import UsageError

    require_library("foxglove")
    from daemon.bridges.foxglove.export import export_foxglove

    if run.is_dir() and out.resolve().parent == run.resolve() and out.name.startswith("run"):
        raise UsageError(f"{out}: the run's own recordings have such names", place="--foxglove")
    if out.exists() and run.exists() and out.samefile(run):
        raise UsageError(f"{out}: is the recording itself", place="--foxglove")
    with about(run):
        exported = export_foxglove(run, out)
    unreadable = f", {exported.unreadable} unreadable" if exported.unreadable else ""
    told = {"written": [out], "messages": exported.messages, "unreadable": exported.unreadable}
    return Result(told, f"{out}: {exported.messages} messages{unreadable}")
