"""A recording's telemetry as tables: a row for each message, a column for each number, with units.

A vector becomes a column for each of its numbers, by what they are: `tip_mm` has `tip_x_mm`,
`tip_y_mm`, `tip_z_mm`; an axis' target has the axis' name and unit. What was not known is None.
Each row has its date (`date_ns`, since 1970 in UTC), its place in the run (`t_s`, since the first
message) and the daemon's own clock (`t_ns`).
"""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path
from typing import Any, Final, TypeAlias, overload

import msgspec
import zstandard

from daemon.messages import Axes, Message, Risk, Status, Tip
from daemon.recording.format.channels import MESSAGES, TOPICS
from daemon.recording.format.mcap_file import COMPRESSION_LEVEL
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
_STEPS_OPEN: Final = 2048
"""Control steps of which more may still come: tip, axes and risk of one are told within moments."""

Row = dict[str, Any]


_TOGETHER: Final = 1024
Packed: TypeAlias = "int | array[float] | bytes | list[Any]"
"""Values that are packed together: so many that are all unknown; floats; others; what is beyond."""


def _packed(values: list[Any]) -> Packed:
    kinds = set(map(type, values))
    if kinds == {type(None)}:
        return len(values)
    if kinds == {float}:
        return array("d", values)
    try:
        return zstandard.compress(msgspec.msgpack.encode(values), COMPRESSION_LEVEL)
    except OverflowError:  # a whole number that only JSON has room for
        return values


def _unpacked(packed: Packed) -> Iterable[Any]:
    if isinstance(packed, int):
        return repeat(None, packed)
    if isinstance(packed, bytes):
        values: list[Any] = msgspec.msgpack.decode(zstandard.decompress(packed))
        return values
    return packed


class Column(Sequence[Any]):
    """A column's values in order, packed: a day's steps have to fit into memory."""

    def __init__(self, unknown: int = 0) -> None:
        """unknown: as many values before the first one are None."""
        self._packed: list[Packed] = [_packed([None] * _TOGETHER)] * (unknown // _TOGETHER)
        self._last: list[Any] = [None] * (unknown % _TOGETHER)

    def append(self, value: Any) -> None:
        self._last.append(value)
        if len(self._last) == _TOGETHER:
            self._packed.append(_packed(self._last))
            self._last = []

    def __len__(self) -> int:
        return len(self._packed) * _TOGETHER + len(self._last)

    def __iter__(self) -> Iterator[Any]:
        for values in self._packed:
            yield from _unpacked(values)
        yield from self._last

    @overload
    def __getitem__(self, index: int) -> Any: ...
    @overload
    def __getitem__(self, index: slice) -> list[Any]: ...
    def __getitem__(self, index: int | slice) -> Any:
        return list(self)[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]


@dataclass
class Table:
    """Columns of the same length, in the order in which they first came."""

    columns: dict[str, Column] = field(default_factory=dict)
    rows: int = 0

    def add(self, row: Mapping[str, Any]) -> None:
        """What a row does not have is None in it."""
        for name, value in row.items():
            column = self.columns.get(name)
            if column is None:
                column = self.columns[name] = Column(unknown=self.rows)
            column.append(value)
        self.rows += 1
        if len(row) < len(self.columns):
            for name in self.columns.keys() - row.keys():
                self.columns[name].append(None)

    def count_from(self, first_ns: int) -> None:
        """Fill in each row's place in a run that began then."""
        seconds = self.columns[_SECONDS] = Column()
        for wall_ns in self.columns[_DATE]:
            seconds.append((wall_ns - first_ns) * 1e-9)


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
    parts = RunParts(path)
    rows = _Rows(set(only), _axes_of(path))
    for message in parts.messages(_TOPICS.values()):  # of all of them `t_s` counts from the first
        rows.take(message.topic, message.wall_ns, message.data)
    if not rows.taken:
        raise UnreadableRunError(f"{path}: there is no message in it")
    return RunTables(rows.tables(), parts.whole, parts.unreadable + rows.unreadable, parts.dropped)


def _axes_of(path: Path) -> list[tuple[str, str, str]]:
    """Name, unit, and unit of the force, of each axis. Raises UnreadableRunError, OSError."""
    decode = msgspec.json.Decoder(Status).decode
    for message in RunParts(path).messages([TOPICS[Status]]):
        with suppress(msgspec.MsgspecError):
            status = decode(message.data)
            if status.axes:
                return [(axis.name, axis.unit, axis.force_unit) for axis in status.axes]
    return []


class _Rows:
    """Tables in the making, message by message, in the order of writing."""

    def __init__(self, wanted: set[str], axes: list[tuple[str, str, str]]) -> None:
        self.taken = self.unreadable = 0
        self._wanted = wanted
        self._needed = wanted | (_OF_STEPS.keys() if STEPS in wanted else set())
        self._axes = axes
        self._first_ns: int | None = None
        self._tables = {name: Table() for name in TABLES if name in wanted}
        self._steps: dict[int, dict[str, Row]] = {}
        """The newest, by their numbers: what has come of each."""

    def take(self, topic: str, wall_ns: int, data: bytes) -> None:
        if self._first_ns is None or wall_ns < self._first_ns:
            self._first_ns = wall_ns
        self.taken += 1
        name = topic.removeprefix("/")
        if name not in self._needed:
            return
        try:
            message: Message = _DECODERS[topic].decode(data)
        except msgspec.MsgspecError:
            self.taken -= 1
            self.unreadable += 1
            return
        row: Row = {_DATE: wall_ns, _SECONDS: None}
        for key in message.__struct_fields__:
            self._put(row, message, key, getattr(message, key))
        if name in self._wanted:
            self._tables[name].add(row)
        if STEPS in self._wanted and name in _OF_STEPS:
            self._steps.setdefault(row[_NUMBER], {})[name] = row
            if len(self._steps) > _STEPS_OPEN:
                self._end_steps(_STEPS_OPEN // 2)

    def tables(self) -> dict[str, Table]:
        if self._steps:
            self._end_steps(len(self._steps))
        made = {name: table for name, table in self._tables.items() if table.rows}
        for table in made.values():
            table.count_from(self._first_ns or 0)
        return made

    def _end_steps(self, count: int) -> None:
        """The oldest have got all that is told of them: a row for each."""
        for number in sorted(self._steps)[:count]:
            came = self._steps.pop(number)
            step: Row = {}
            for name, prefix in _OF_STEPS.items():
                for column, value in came.get(name, {}).items():
                    if column in _TIMES:
                        step.setdefault(column, value)
                    else:
                        said = "risk" in column.split("_")
                        step[column if said else f"{prefix}{column}"] = value
            self._tables[STEPS].add(step)

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
