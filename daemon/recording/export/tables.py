"""A recording's telemetry as tables: a row for each message, a column for each number, with units.

A vector becomes a column for each of its numbers, by what they are: `tip_mm` has `tip_x_mm`,
`tip_y_mm`, `tip_z_mm`; an axis' target has the axis' name and unit. What was not known is None.
Each row has its date (`date_ns`, since 1970 in UTC), its place in the run (`t_s`, since the first
message) and the daemon's own clock (`t_ns`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from daemon.messages import Axes, Message, Risk, Status, Tip
from daemon.recording.format.channels import MESSAGES
from daemon.recording.run_parts import RunParts
from daemon.recording.run_reader import UnreadableRunError

STEPS: Final = "steps"
"""The table of control steps: what was measured, sent and decided in each, side by side."""

_TOPICS: Final = {topic.removeprefix("/"): topic for topic in MESSAGES}
TABLES: Final = (STEPS, *_TOPICS)
"""Names of all tables that there may be."""

_DECODERS: Final = {topic: msgspec.json.Decoder(kind) for topic, kind in MESSAGES.items()}
_DATE, _SECONDS, _CLOCK, _NUMBER = "date_ns", "t_s", "t_ns", "sequence"
_TIMES: Final = (_DATE, _SECONDS, _CLOCK, _NUMBER)
_UNITS: Final = ("mm_s", "mm")
_PLACE: Final = ("x", "y", "z")
_QUATERNION: Final = ("w", "x", "y", "z")
_VECTORS: Final[dict[type[Message], set[str]]] = {
    kind: {
        field.name
        for field in msgspec.structs.fields(kind)
        if field.type in (list[float], list[float] | None)
    }
    for kind in (Axes, Risk, Status, Tip)
}
"""Fields of fixed lengths: what is as long as a body has points, or cycles, is told as JSON."""
_OF_STEPS: Final = {"tip": "", "axes": "", "risk": "risk_"}
"""What a control step is put together from, and what is put before its columns' names."""

Row = dict[str, Any]


@dataclass
class Table:
    """Columns of the same length, in the order in which they first came."""

    columns: dict[str, list[Any]] = field(default_factory=dict)
    rows: int = 0

    def add(self, row: Mapping[str, Any]) -> None:
        """What a row does not have is None in it."""
        for name, value in row.items():
            column = self.columns.get(name)
            if column is None:
                column = self.columns[name] = [None] * self.rows
            column.append(value)
        self.rows += 1
        for column in self.columns.values():
            if len(column) < self.rows:
                column.append(None)


@dataclass
class RunTables:
    """All tables of a run, and what is missing in them."""

    tables: dict[str, Table]
    """By name; those without a row are left out."""
    whole: bool
    """Whether the recording has come to its proper end."""
    unreadable: int
    """Messages or stretches that could not be read."""
    dropped: int
    """Messages that the recorder says it has left out."""

    @property
    def notes(self) -> list[str]:
        """What somebody who computes with it should know."""
        found = []
        if not self.whole:
            found.append("the recording has no proper end: what was recorded until then is here")
        if self.unreadable:
            found.append(f"{self.unreadable} parts of the recording could not be read")
        if self.dropped:
            found.append(f"{self.dropped} messages were left out by the recorder, which came late")
        return found


def read_tables(path: Path, only: Sequence[str] = TABLES) -> RunTables:
    """Read a run. path: its folder, or one recording. only: these tables.

    Raises UnreadableRunError, OSError; ValueError where there is no such table.
    """
    unknown = [name for name in only if name not in TABLES]
    if unknown:
        raise ValueError(f"there is no table {', '.join(unknown)}: there are {', '.join(TABLES)}")
    wanted = {name for name in only if name != STEPS}
    needed = wanted | (set(_OF_STEPS) if STEPS in only else set()) | {"state"}  # which knows axes
    rows = _Rows(needed)
    parts = RunParts(path)
    for message in parts.messages(_TOPICS.values()):  # of all of them `t_s` counts from the first
        rows.take(message.topic, message.wall_ns, message.data)
    if not any(rows.messages.values()):
        raise UnreadableRunError(f"{path}: there is no message in it")
    tables = rows.tables(wanted, steps=STEPS in only)
    return RunTables(tables, parts.whole, parts.unreadable + rows.unreadable, parts.dropped)


class _Rows:
    """What has been read, in the order of writing."""

    def __init__(self, needed: set[str]) -> None:
        self.messages: dict[str, list[tuple[int, Message]]] = {name: [] for name in needed}
        self.unreadable = 0
        self._axes: list[tuple[str, str, str]] = []
        """Name, unit, and unit of the force."""
        self._first_ns: int | None = None

    def take(self, topic: str, wall_ns: int, data: bytes) -> None:
        if self._first_ns is None or wall_ns < self._first_ns:
            self._first_ns = wall_ns
        name = topic.removeprefix("/")
        if name not in self.messages:
            return
        try:
            message: Message = _DECODERS[topic].decode(data)
        except msgspec.MsgspecError:
            self.unreadable += 1
            return
        if isinstance(message, Status) and message.axes:
            self._axes = [(axis.name, axis.unit, axis.force_unit) for axis in message.axes]
        self.messages[name].append((wall_ns, message))

    def tables(self, wanted: set[str], *, steps: bool) -> dict[str, Table]:
        made: dict[str, Table] = {}
        if steps:
            made[STEPS] = self._steps()
        for name in (name for name in TABLES if name in wanted):
            made[name] = table = Table()
            for row in self._rows(name):
                table.add(row)
        return {name: table for name, table in made.items() if table.rows}

    def _steps(self) -> Table:
        """A row for each step of which anything was recorded."""
        by_number: dict[int, Row] = {}
        for name, prefix in _OF_STEPS.items():
            for row in self._rows(name):
                step = by_number.setdefault(row[_NUMBER], {})
                for column, value in row.items():
                    if column in _TIMES:
                        step.setdefault(column, value)
                    else:
                        said = "risk" in column.split("_")
                        step[column if said else f"{prefix}{column}"] = value
        table = Table()
        for number in sorted(by_number):
            table.add(by_number[number])
        return table

    def _rows(self, name: str) -> Iterator[Row]:
        first_ns = self._first_ns or 0
        for wall_ns, message in self.messages[name]:
            row: Row = {_DATE: wall_ns, _SECONDS: (wall_ns - first_ns) * 1e-9}
            for key in message.__struct_fields__:
                self._put(row, message, key, getattr(message, key))
            yield row

    def _put(self, row: Row, message: Message, key: str, value: Any) -> None:
        if isinstance(value, msgspec.Struct):
            for inner in value.__struct_fields__:
                self._put(row, message, f"{key}_{inner}", getattr(value, inner))
        elif key in _VECTORS.get(type(message), ()):
            by_name = self._by_axis if isinstance(message, Axes) else _by_place
            row.update(by_name(key, value))
        elif isinstance(value, list):
            row[key] = msgspec.json.encode(value).decode()
        else:
            row[key] = value

    def _by_axis(self, key: str, values: list[float] | None) -> Row:
        if values is None:
            values = [None] * len(self._axes)  # type: ignore[list-item]
        if len(values) != len(self._axes):
            return {f"{key}_{number}": value for number, value in enumerate(values, 1)}
        return {
            f"{key}_{name}_{_as_name(force if key == 'force' else unit)}": value
            for value, (name, unit, force) in zip(values, self._axes, strict=True)
        }


def _by_place(key: str, values: list[float] | None) -> Row:
    """A place or a direction by its coordinates, a quaternion scalar first."""
    names = _QUATERNION if key.endswith("quaternion") else _PLACE
    unit = next((unit for unit in _UNITS if key.endswith(f"_{unit}")), "")
    stem, tail = (key.removesuffix(f"_{unit}"), f"_{unit}") if unit else (key, "")
    known = values if values is not None and len(values) == len(names) else [None] * len(names)
    return {f"{stem}_{name}{tail}": value for name, value in zip(names, known, strict=True)}


def _as_name(unit: str) -> str:
    """As it stands in names: `mL` is `ml`, `%` is `percent`, `N m` is `nm`."""
    return unit.replace("%", "percent").replace(" ", "").replace("·", "").lower()
