"""A recording's tables as files, and as pandas frames.

CSV needs nothing that is not installed anyway. pyarrow and pandas come with the extra `export`, and
are imported when they are wanted.
"""

import csv
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from daemon.recording.export.tables import STEPS, TABLES, Column, RunTables, Table, read_tables

if TYPE_CHECKING:
    from pandas import DataFrame

_DATE: Final = "date_ns"
_UTC: Final = "date_utc"


class ExportLibraryError(RuntimeError):
    """An optional library is not installed; the text says which, and how it is."""

    def __init__(self, library: str) -> None:
        super().__init__(
            f"this needs {library}, which is not installed: pip install 'tentacled[export]'"
        )
        self.library = library


def write_csv(tables: RunTables, folder: Path) -> list[Path]:
    """A file for each table. Dates are in UTC, to the nanosecond. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, table in tables.tables.items():
        path = folder / f"{name}.csv"
        names = [_UTC if column == _DATE else column for column in table.columns]
        columns = [
            map(_date, values) if column == _DATE else map(_cell, values)
            for column, values in table.columns.items()
        ]
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(names)
            writer.writerows(zip(*columns, strict=True))
        written.append(path)
    return written


def write_parquet(tables: RunTables, folder: Path) -> list[Path]:
    """A file for each table, with what is missing in its metadata.

    Raises ExportLibraryError, OSError.
    """
    arrow, parquet = _library("pyarrow"), _library("pyarrow.parquet")
    folder.mkdir(parents=True, exist_ok=True)
    about = {"tentacled.notes": "\n".join(tables.notes)}
    written = []
    for name, table in tables.tables.items():
        path = folder / f"{name}.parquet"
        columns = {
            _UTC if column == _DATE else column: _arrow_column(arrow, column, values)
            for column, values in table.columns.items()
        }
        made = arrow.table(columns).replace_schema_metadata(about)
        parquet.write_table(made, path)
        written.append(path)
    return written


def _arrow_column(arrow: Any, name: str, values: Column) -> Any:
    if name == _DATE:
        return arrow.array(list(values), arrow.timestamp("ns", tz="UTC"))
    return arrow.array(_alike(values))


def read_frames(path: Path | str, only: Sequence[str] = TABLES) -> "dict[str, DataFrame]":
    """A run as pandas frames, by the names of its tables; `steps` has a row for each control step.

    path: a run's folder, or one recording; unfinished and damaged ones are read as far as they go,
    and each frame's `attrs["notes"]` says what is missing. Columns are named with their units;
    `date_utc` is a date, `t_s` counts from the first message. Raises ExportLibraryError,
    UnreadableRunError, OSError; ValueError where there is no such table.
    """
    pandas = _library("pandas")
    run = read_tables(Path(path), only)
    frames = {}
    for name, table in run.tables.items():
        frame = _frame(pandas, table)
        frame.attrs.update(run=str(path), table=name, notes=run.notes)
        frames[name] = frame
    return frames


def read_frame(path: Path | str, table: str = STEPS) -> "DataFrame":
    """One table of a run as a pandas frame: as `read_frames`, and raises what it does."""
    frames = read_frames(path, [table])
    if table not in frames:
        raise ValueError(f"{path}: nothing was recorded of {table}")
    return frames[table]


def _frame(pandas: Any, table: Table) -> "DataFrame":
    columns = {
        _UTC if name == _DATE else name: (
            pandas.to_datetime(list(values), unit="ns", utc=True)
            if name == _DATE
            else pandas.Series(_alike(values))
        )
        for name, values in table.columns.items()
    }
    made: DataFrame = pandas.DataFrame(columns)
    return made


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != name.partition(".")[0]:
            raise
        raise ExportLibraryError(name.partition(".")[0]) from None


def _alike(column: Column) -> list[Any]:
    """Numbers of one kind: whole ones beside others are written as those."""
    values = list(column)
    if any(isinstance(value, float) for value in values):
        return [float(value) if isinstance(value, int) else value for value in values]
    return values


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else value


def _date(wall_ns: int) -> str:
    return f"{np.datetime64(wall_ns, 'ns')}Z"
