"""Which cloud was seen at which configuration: the table that lies beside clouds of a real body.

`configurations.csv`, one row for each cloud, in the order in which they were taken:

    file,<axis>,<axis>,…[,start_<axis>,…][,test]

`file` is a PLY or NPZ file in the same folder. The axes have their names and units from the robot
file. `start_<axis>`: where it came from, on a straight line. `test`: 1 where the configuration is
kept back to test with, else 0. Rows of the same configuration are visits to it, each from another
start; every configuration has as many of them.
"""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Final

import numpy as np

from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.cloud_dataset import BoolArray, CloudDatasetError
from safety.risk.model.mixture import FloatArray

TABLE: Final = "configurations.csv"
SUFFIXES: Final = (".ply", ".npz")
_FILE, _TEST, _START = "file", "test", "start_"
_TOLD: Final = 20
"""Faults of many."""
_ROUNDED: Final = 9
"""Digits after the point, to which configurations are the same."""
_SAYS: Final = {"1": True, "true": True, "0": False, "false": False, "": False}


class CloudImportError(CloudDatasetError):
    """Clouds that cannot be used, for all the reasons that there are."""

    def __init__(self, place: Path, faults: Sequence[str]) -> None:
        self.place, self.faults = place, tuple(faults)
        super().__init__(place, self.faults)  # as it is made again on the other side of a process

    def __str__(self) -> str:
        faults = self.faults
        more = [f"and {len(faults) - _TOLD} more"] if len(faults) > _TOLD else []
        return "\n".join(f"{self.place}: {one}" for one in [*faults[:_TOLD], *more])


@dataclass(frozen=True, eq=False)
class CloudTable:
    """n configurations of m axes, each visited s times."""

    files: tuple[tuple[Path, ...], ...]
    """n times s."""
    rows: tuple[tuple[int, ...], ...]
    """Their line numbers in the table."""
    configurations: FloatArray
    """(n, m)."""
    starts: FloatArray | None
    """(n, s, m)."""
    test: BoolArray | None
    """(n,)."""


@dataclass(frozen=True)
class _Row:
    number: int
    file: Path
    at: tuple[float, ...]
    start: tuple[float, ...]
    test: bool


def read_table(folder: Path, ranges: AxisRanges) -> CloudTable:
    """Raises CloudImportError, which names all rows that are wrong."""
    path = folder / TABLE
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise CloudImportError(path, [reason or "cannot be read"]) from None
    header = [name.strip() for name in lines[0]] if lines else []
    if faults := _header_faults(header, ranges):
        raise CloudImportError(path, faults)
    read = _Reader(folder, header, ranges)
    rows = [read.row(i, line) for i, line in enumerate(lines[1:], 2) if any(line)]
    faults = read.faults or _faults_together([row for row in rows if row is not None], header)
    if not faults and not rows:
        faults = ["there is no row"]
    if faults:
        raise CloudImportError(path, faults)
    return _grouped([row for row in rows if row is not None], header)


def _header_faults(header: list[str], ranges: AxisRanges) -> list[str]:
    starts = [f"{_START}{name}" for name in ranges.names]
    wanted = [_FILE, *ranges.names]
    if any(name in header for name in starts):
        wanted += starts
    faults = [f"line 1: the column {name!r} is missing" for name in wanted if name not in header]
    faults += [
        f"line 1: the column {name!r} is unknown; there can be: "
        f"{', '.join([_FILE, *ranges.names, *starts, _TEST])}"
        for name in header
        if name not in {*wanted, *starts, _TEST}
    ]
    faults += [
        f"line 1: the column {name!r} is there {count} times"
        for name, count in Counter(header).items()
        if count > 1
    ]
    return faults


class _Reader:
    def __init__(self, folder: Path, header: list[str], ranges: AxisRanges) -> None:
        self.faults: list[str] = []
        self._folder, self._header, self._ranges = folder, header, ranges
        self._seen: dict[Path, int] = {}

    def row(self, number: int, line: list[str]) -> _Row | None:
        """None where something is wrong with it."""
        before = len(self.faults)
        if len(line) != len(self._header):
            self._fault(number, f"{len(line)} columns, not {len(self._header)}")
            return None
        cells = dict(zip(self._header, (cell.strip() for cell in line), strict=True))
        file = self._file(number, cells[_FILE])
        at = self._place(number, cells, "")
        start = self._place(number, cells, _START) if self._starts else ()
        test = _SAYS.get(cells.get(_TEST, "").lower())
        if test is None:
            self._fault(number, f"{_TEST} is {cells[_TEST]!r}; it must be 1 or 0")
        if len(self.faults) > before or file is None or test is None:
            return None
        return _Row(number, file, at, start, test)

    @property
    def _starts(self) -> bool:
        return f"{_START}{self._ranges.names[0]}" in self._header

    def _file(self, number: int, name: str) -> Path | None:
        path = self._folder / name
        if not name or Path(name).name != name:
            self._fault(
                number, f"{_FILE} is {name!r}; it must be the name of a file beside {TABLE}"
            )
        elif path.suffix.lower() not in SUFFIXES:
            self._fault(number, f"{name}: must end with {' or '.join(SUFFIXES)}")
        elif path in self._seen:
            self._fault(number, f"{name}: is there already, in line {self._seen[path]}")
        elif not path.is_file():
            self._fault(number, f"{name}: no such file")
        else:
            self._seen[path] = number
            return path
        return None

    def _place(self, number: int, cells: dict[str, str], prefix: str) -> tuple[float, ...]:
        values = []
        limits = (self._ranges.names, self._ranges.lowest, self._ranges.highest)
        for axis, lowest, highest in zip(*limits, strict=True):
            text = cells[f"{prefix}{axis}"]
            try:
                value = float(text)
            except ValueError:
                value = float("nan")
            if not isfinite(value):
                self._fault(number, f"{prefix}{axis} is {text!r}: not a finite number")
            elif not lowest <= value <= highest:
                self._fault(
                    number, f"{prefix}{axis} is {value:g}: the axis goes {lowest:g} to {highest:g}"
                )
            values.append(value)
        return tuple(values)

    def _fault(self, number: int, what: str) -> None:
        self.faults.append(f"line {number}: {what}")


def _by_configuration(rows: Sequence[_Row]) -> list[list[_Row]]:
    """Groups in the order of their first rows."""
    found: dict[tuple[float, ...], list[_Row]] = {}
    for row in rows:
        found.setdefault(tuple(round(value, _ROUNDED) + 0.0 for value in row.at), []).append(row)
    return list(found.values())


def _faults_together(rows: Sequence[_Row], header: Sequence[str]) -> list[str]:
    """What is wrong with rows that by themselves are right."""
    groups = _by_configuration(rows)
    usual = Counter(len(group) for group in groups).most_common(1)
    faults = [
        f"line {group[0].number}: its configuration is there {len(group)} times, and most are "
        f"{usual[0][0]} times: all must be as often, each time from another start"
        for group in groups
        if len(group) != usual[0][0]
    ]
    if _TEST in header:
        faults += [
            f"line {row.number}: is {'' if row.test else 'not '}to test with, and line "
            f"{group[0].number} of the same configuration is{' not' if row.test else ''}"
            for group in groups
            for row in group[1:]
            if row.test != group[0].test
        ]
        if len({row.test for row in rows}) == 1:
            faults.append(f"all rows have the same {_TEST}: some are to learn from, some to test")
    if len(groups) < 3:
        faults.append(f"{len(groups)} configurations: a body is learnt from 2, and tested with one")
    return faults


def _grouped(rows: Sequence[_Row], header: Sequence[str]) -> CloudTable:
    groups = _by_configuration(rows)
    return CloudTable(
        tuple(tuple(row.file for row in group) for group in groups),
        tuple(tuple(row.number for row in group) for group in groups),
        np.array([group[0].at for group in groups]),
        np.array([[row.start for row in group] for group in groups]) if rows[0].start else None,
        np.array([group[0].test for group in groups]) if _TEST in header else None,
    )
