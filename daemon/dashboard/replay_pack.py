"""A recording made ready for the page: one block of bytes that a browser finds its way about in.

`python -m daemon.dashboard.replay_pack RUN` writes it to standard output. It is a process of its
own for each replay, so that neither the reading nor its memory is the page's server's.

A block is: the length of the header (u32, little-endian), the header (JSON), zeros up to a multiple
of 8, and the data. The header names places in the data, in bytes from its beginning: of each kind
of message the times (f64, s since the start) and the places of the payloads (u32, one more than
there are messages), which are JSON as it was recorded; of each plotted quantity its times and
columns (f32).
"""

import sys
from array import array
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from daemon.host.real_time import collector_paused
from daemon.messages import Body, Event, Status, SurroundingsChanged
from daemon.recording.recorded_surroundings import (
    RecordedSurroundings,
    robot_values,
    surroundings_at_first,
    surroundings_told,
)
from daemon.recording.result import ErrorTable, read_result
from daemon.recording.run_parts import RunParts
from daemon.recording.run_reader import RunMessage, UnreadableRunError
from daemon.recording.run_writer import HEADER
from safety.states import OperatingState

EXIT_UNREADABLE: Final = 3
MOST_KEPT: Final = 24_000
"""Of one kind of message: ten minutes of frames. Of a longer recording every second one is shown,
or every fourth, and the header says so."""
_KINDS: Final = ("state", "tip", "axes", "risk", "loop", "body")
_TOPICS: Final = (*(f"/{kind}" for kind in _KINDS), "/event", "/surroundings_changed")
_NS: Final = 1e-9
_RUNNING: Final = OperatingState.RUNNING.value
_ALIGNED: Final = 8
_NONE: Final = float("nan")


class _Tip(msgspec.Struct):
    """What is drawn of a Tip over the whole run."""

    state: str
    tip_mm: list[float] | None = None
    reference_mm: list[float] | None = None
    error_mm: float | None = None
    cycle: int = -1


class _Axes(msgspec.Struct):
    force: list[float]


class _Risk(msgspec.Struct):
    contact_risk: float | None = None
    threshold: float = _NONE
    clearance_mm: float | None = None


class _Lateness(msgspec.Struct):
    lateness_p99_s: float


class _Loop(msgspec.Struct):
    status: _Lateness


_DECODERS: Final[dict[str, Callable[[bytes], Any]]] = {
    "state": msgspec.json.Decoder(Status).decode,
    "body": msgspec.json.Decoder(Body).decode,
    "tip": msgspec.json.Decoder(_Tip).decode,
    "axes": msgspec.json.Decoder(_Axes).decode,
    "risk": msgspec.json.Decoder(_Risk).decode,
    "loop": msgspec.json.Decoder(_Loop).decode,
}
_EVENT: Final = msgspec.json.Decoder(Event)
_CHANGED: Final = msgspec.json.Decoder(SurroundingsChanged)


class _Kept:
    """The messages of one kind, thinned out evenly where there are too many."""

    def __init__(self) -> None:
        self.every = 1
        self.rows: list[tuple[int, bytes, Any]] = []
        """Date, payload, what is drawn of it."""
        self._seen = 0

    def add(self, wall_ns: int, data: bytes, drawn: Any) -> None:
        if self._seen % self.every == 0:
            if len(self.rows) >= MOST_KEPT:
                del self.rows[1::2]
                self.every *= 2
            if self._seen % self.every == 0:
                self.rows.append((wall_ns, data, drawn))
        self._seen += 1


class _Worst(NamedTuple):
    error_mm: float
    row: tuple[int, bytes, Any]


class ReplayPacker:
    """Takes a recording message by message."""

    def __init__(self, folder: Path) -> None:
        """folder: of the run, where the meshes of its surroundings are."""
        self.unreadable = 0
        """Messages that are none."""
        self._kept = {kind: _Kept() for kind in _KINDS}
        self._events: list[tuple[int, Event]] = []
        self._folder = folder
        self._surroundings: list[tuple[int, RecordedSurroundings]] = []
        self._states: list[tuple[int, str]] = []
        self._errors = ErrorTable()
        self._worst: _Worst | None = None
        self._first_ns: int | None = None
        self._last_ns = 0

    @property
    def empty(self) -> bool:
        """Whether nothing has come."""
        return self._first_ns is None

    def take(self, message: RunMessage) -> None:
        """Any message of the telemetry, in the order of writing."""
        kind, wall_ns = message.topic[1:], message.wall_ns
        try:
            drawn = self._read(kind, wall_ns, message.data)
        except msgspec.MsgspecError:
            self.unreadable += 1
            return
        self._first_ns = wall_ns if self._first_ns is None else min(self._first_ns, wall_ns)
        self._last_ns = max(self._last_ns, wall_ns)
        if kind in self._kept:
            self._kept[kind].add(wall_ns, message.data, drawn)

    def _read(self, kind: str, wall_ns: int, data: bytes) -> Any:
        """Raises MsgspecError."""
        if kind == "event":
            self._events.append((wall_ns, _EVENT.decode(data)))
            return None
        if kind == "surroundings_changed":
            told = surroundings_told(self._folder, _CHANGED.decode(data))
            self._surroundings.append((wall_ns, told))
            return None
        decode = _DECODERS.get(kind)
        drawn = None if decode is None else decode(data)
        if isinstance(drawn, _Tip):
            self._see(wall_ns, data, drawn)
        return drawn

    def _see(self, wall_ns: int, data: bytes, tip: _Tip) -> None:
        if not self._states or self._states[-1][1] != tip.state:
            self._states.append((wall_ns, tip.state))
        if tip.error_mm is None or tip.state != _RUNNING or tip.cycle < 0:
            return
        self._errors.count(tip.cycle, tip.error_mm)
        if self._worst is None or tip.error_mm > self._worst.error_mm:
            self._worst = _Worst(tip.error_mm, (wall_ns, data, tip))

    def block(self, more: dict[str, Any]) -> Iterator[bytes]:
        """The block, piece by piece. more: what else stands in the header."""
        laid = _Laid()
        header = {
            **more,
            "duration_s": self._s(self._last_ns),
            "started_ns": self._first_ns or 0,
            "kinds": {kind: self._laid_kind(laid, kind) for kind in _KINDS},
            "series": self._series(laid),
            "states": [(self._s(wall_ns), state) for wall_ns, state in self._states],
            "surroundings": self._round_the_body(),
            "cycles": self._errors.rows(),
            "worst": None
            if self._worst is None
            else {"t_s": self._s(self._worst.row[0]), "error_mm": self._worst.error_mm},
            "events": [
                {"t_s": self._s(wall_ns), **msgspec.to_builtins(event)}
                for wall_ns, event in sorted(self._events, key=lambda each: each[0])
            ],
        }
        told = msgspec.json.encode(header)
        yield len(told).to_bytes(4, "little") + told + bytes(-(4 + len(told)) % _ALIGNED)
        yield from laid.pieces

    def _round_the_body(self) -> list[dict[str, Any]]:
        """From when what was there: the first ones from the beginning, whenever they were told."""
        told = self._surroundings or [(0, surroundings_at_first(self._folder))]
        return [
            {
                "t_s": self._s(wall_ns) if number else 0.0,
                "mesh": one.mesh,
                "file": one.file,
                "lost": one.lost,
                "regions": [region.model_dump(mode="json") for region in one.regions],
            }
            for number, (wall_ns, one) in enumerate(told)
        ]

    def _s(self, wall_ns: int) -> float:
        return 0.0 if self._first_ns is None else (wall_ns - self._first_ns) * _NS

    def _rows(self, kind: str) -> list[tuple[int, bytes, Any]]:
        """By time: a tip is dated by its measurement, before it was told."""
        rows = self._kept[kind].rows
        worst = self._worst
        if kind == "tip" and worst is not None and self._kept[kind].every > 1:
            rows = [*rows, worst.row]
        return sorted(rows, key=lambda row: row[0])

    def _laid_kind(self, laid: "_Laid", kind: str) -> dict[str, int]:
        rows = self._rows(kind)
        places = array("I", [0])
        for _, data, _ in rows:
            places.append(places[-1] + len(data))
        return {
            "count": len(rows),
            "every": self._kept[kind].every,
            "times": laid.add(self._times(rows).tobytes()),
            "places": laid.add(places.tobytes()),
            "payloads": laid.add(b"".join(data for _, data, _ in rows)),
        }

    def _times(self, rows: Sequence[tuple[int, bytes, Any]]) -> NDArray[np.float64]:
        wall_ns = np.array([row[0] for row in rows], dtype=np.int64)
        return ((wall_ns - (self._first_ns or 0)) * _NS).astype("<f8")

    def _series(self, laid: "_Laid") -> dict[str, Any]:
        tips, risks = self._rows("tip"), self._rows("risk")
        axes, loops = self._rows("axes"), self._rows("loop")
        width = max((len(drawn.force) for _, _, drawn in axes), default=0)
        columns = {
            "error": (1, tips, [[_or_none(tip.error_mm)] for _, _, tip in tips]),
            "tip": (3, tips, [_place(tip.tip_mm) for _, _, tip in tips]),
            "reference": (3, tips, [_place(tip.reference_mm) for _, _, tip in tips]),
            "force": (width, axes, [_fitted(one.force, width) for _, _, one in axes]),
            "risk": (2, risks, [[_or_none(r.contact_risk), r.threshold] for _, _, r in risks]),
            "clearance": (1, risks, [[_or_none(r.clearance_mm)] for _, _, r in risks]),
            "loop": (1, loops, [[loop.status.lateness_p99_s * 1e3] for _, _, loop in loops]),
        }
        return {name: self._laid_series(laid, *series) for name, series in columns.items()}

    def _laid_series(
        self,
        laid: "_Laid",
        width: int,
        rows: Sequence[tuple[int, bytes, Any]],
        values: list[list[float]],
    ) -> dict[str, Any]:
        table = np.array(values, dtype="<f4").reshape(len(rows), width)
        columns = [laid.add(np.ascontiguousarray(column).tobytes()) for column in table.T]
        return {
            "count": len(rows),
            "times": laid.add(self._times(rows).tobytes()),
            "columns": columns,
        }


class _Laid:
    """Pieces of data, each beginning where a browser can look at it as numbers."""

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self._bytes = 0

    def add(self, data: bytes) -> int:
        """Returns where it begins."""
        begins, padding = self._bytes, bytes(-len(data) % _ALIGNED)
        self.pieces += [data, padding]
        self._bytes += len(data) + len(padding)
        return begins


def _or_none(value: float | None) -> float:
    return _NONE if value is None else value


def _place(place_mm: list[float] | None) -> list[float]:
    return [_NONE] * 3 if place_mm is None or len(place_mm) != 3 else place_mm


def _fitted(values: list[float], width: int) -> list[float]:
    return [*values, *[_NONE] * (width - len(values))]


def pack(path: Path, out: IO[bytes]) -> None:
    """Write the block of a run, finished or not. path: as for `run_files`.

    Raises UnreadableRunError, OSError.
    """
    folder = path if path.is_dir() else path.parent
    parts, packer = RunParts(path), ReplayPacker(folder)
    with collector_paused():
        for message in parts.messages(_TOPICS):
            packer.take(message)
        if packer.empty:
            raise UnreadableRunError(f"{path}: no telemetry in it can be read")
        for piece in packer.block(_about(path, folder, parts, packer.unreadable)):
            out.write(piece)
    out.flush()


def _about(path: Path, folder: Path, parts: RunParts, no_messages: int) -> dict[str, Any]:
    result = read_result(folder)
    header = parts.metadata(HEADER)
    first_ns = min((span.first_ns for span in parts.spans.values()), default=0)
    return {
        "name": path.name,
        "robot": header.get("robot", ""),
        "header": header,
        "whole": parts.whole,
        "dropped": parts.dropped,
        "unreadable": parts.unreadable + no_messages,
        "workspace_mm": _workspace(folder),
        "result": None
        if result is None
        else {"trajectory": result.trajectory, "controller": result.controller},
        "gaps": [
            ((one.last_ns - first_ns) * _NS, (other.first_ns - first_ns) * _NS)
            for one, other in parts.gaps
        ],
    }


def _workspace(folder: Path) -> list[list[float]] | None:
    """(3, 2) of the run's own robot file; None: it has none, or cannot be read."""
    try:
        box = robot_values(folder)["workspace"]
        return [[float(end) for end in box[f"{name}_mm"]] for name in "xyz"]
    except (ValueError, KeyError, TypeError):
        return None


def main() -> int:
    try:
        pack(Path(sys.argv[1]), sys.stdout.buffer)
    except (UnreadableRunError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_UNREADABLE
    return 0


if __name__ == "__main__":
    sys.exit(main())
