"""A recording as arrays, for figures and tables."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from daemon.collector_pause import collector_paused
from daemon.recording.channels import MESSAGES
from daemon.recording.error_table import CycleError, ErrorTable
from daemon.recording.result import Result, read_result
from daemon.recording.run_files import PROVENANCE_FILE, ROBOT_FILE, RUN_FILE, unfinished
from daemon.recording.run_folder import Provenance
from daemon.recording.run_reader import RunMessage, RunReader, UnreadableRunError
from daemon.recording.run_writer import ENDING, HEADER
from daemon.remote.messages import Axes, AxisStatus, Event, Loop, Message, Risk, Status, Tip
from safety.states import OperatingState

Array = NDArray[np.float64]
Kind = TypeVar("Kind", bound=Message)

_RUNNING: Final = OperatingState.RUNNING.value
_NS: Final = 1e-9
_DECODERS: Final = {topic: msgspec.json.Decoder(kind) for topic, kind in MESSAGES.items()}
_WITH_STATE: Final = (Tip, Status)


@dataclass
class Series:
    """Values over time: `t_s` of shape (N,), everything else (N,) or (N, columns), nan: none."""

    t_s: Array
    columns: dict[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]


@dataclass
class RunData:
    """All that a report tells. A part that was not recorded is None or empty."""

    path: Path
    header: dict[str, str]
    started_ns: int
    """Date of the first message."""
    duration_s: float
    whole: bool
    """Whether the recording was ended properly."""
    dropped: int
    unreadable: int
    """Messages or chunks that could not be read."""
    counts: dict[str, int]
    """Messages by topic."""
    status: Status | None
    """The last one."""
    tip: Series | None
    """tip_mm, measured_mm, reference_mm, error_mm, cycle, running."""
    axes: Series | None
    """actual, target, proposed, permitted, force."""
    risk: Series | None
    """contact, body_point, threshold, scale, clearance_mm, place_mm, obstacle_mm, means_mm."""
    loop: Series | None
    """lateness_p50_s, lateness_p99_s, lateness_max_s, step_p50_s, step_p99_s, missed."""
    states: list[tuple[float, str]]
    """When the robot came into which state."""
    events: list[tuple[float, Event]]
    cycles: list[CycleError]
    result: Result | None = None
    provenance: Provenance | None = None
    robot_yaml: str = ""

    @property
    def axis_status(self) -> list[AxisStatus]:
        """Names and units of the axes, as far as they were told."""
        return [] if self.status is None else self.status.axes


def run_file(path: Path) -> Path:
    """The recording that is meant by a run's folder or by the file itself.

    Raises UnreadableRunError where there is none.
    """
    if not path.is_dir():
        if not path.exists():
            raise UnreadableRunError(f"{path}: there is no such file or folder")
        return path
    for candidate in (path / RUN_FILE, unfinished(path / RUN_FILE)):
        if candidate.exists():
            return candidate
    raise UnreadableRunError(f"{path}: there is no {RUN_FILE} in this folder")


def read_run(path: Path) -> RunData:
    """Read a run. path: as for `run_file`. Raises UnreadableRunError, OSError."""
    return GrowingRun(path).data()


class GrowingRun:
    """A run that may still be going on, read as far as it has been recorded."""

    def __init__(self, path: Path, also: Callable[[RunMessage], None] | None = None) -> None:
        """path: as for `run_file`; there may not be anything yet. also: gets each message too."""
        self._path = path
        self._reader = RunReader(path)
        self._gathered = _Gathered()
        self._also = also

    def catch_up(self) -> None:
        """Read what has been added. Raises UnreadableRunError, OSError."""
        self._reader.path = run_file(self._path)
        with collector_paused():
            for message in self._reader.messages():
                self._gathered.take(message.topic, message.wall_ns, message.data)
                if self._also is not None:
                    self._also(message)

    def data(self) -> RunData:
        """All there is. Raises UnreadableRunError, OSError."""
        self.catch_up()
        reader, file = self._reader, self._reader.path
        if not self._gathered.counts:
            raise UnreadableRunError(f"{file}: there is no message in it")
        with collector_paused():
            data = self._gathered.run_data(file, reader)
        dropped = reader.metadata.get(ENDING, {}).get("dropped", "0")
        data.dropped = int(dropped)
        data.result = read_result(file.parent)
        data.provenance = _read_provenance(file.parent / PROVENANCE_FILE)
        data.robot_yaml = _text_of(file.parent / ROBOT_FILE)
        return data


@dataclass
class _Gathered:
    """What has been read so far, still as messages."""

    counts: dict[str, int] = field(default_factory=dict)
    first_ns: int = 0
    last_ns: int = 0
    unreadable: int = 0
    messages: dict[type[Message], list[tuple[int, Message]]] = field(default_factory=dict)
    states: list[tuple[int, str]] = field(default_factory=list)

    def take(self, topic: str, wall_ns: int, data: bytes) -> None:
        if not self.counts:
            self.first_ns = self.last_ns = wall_ns
        if wall_ns < self.first_ns:
            self.first_ns = wall_ns
        elif wall_ns > self.last_ns:
            self.last_ns = wall_ns
        self.counts[topic] = self.counts.get(topic, 0) + 1
        decoder = _DECODERS.get(topic)
        if decoder is None:
            return
        try:
            message = decoder.decode(data)
        except msgspec.MsgspecError:
            self.unreadable += 1
            return
        self.messages.setdefault(type(message), []).append((wall_ns, message))
        # In the order of writing: a Tip is dated by its measurement, before it was told.
        if isinstance(message, _WITH_STATE):
            self._enter(wall_ns, message.state)

    def _enter(self, wall_ns: int, state: str) -> None:
        if not self.states or self.states[-1][1] != state:
            self.states.append((max([wall_ns, *(t_ns for t_ns, _ in self.states[-1:])]), state))

    def run_data(self, file: Path, reader: RunReader) -> RunData:
        tips, states = self._of(Tip), self._of(Status)
        table = ErrorTable()
        for _, tip in tips:
            table.add(tip)
        return RunData(
            path=file,
            header=reader.metadata.get(HEADER, {}),
            started_ns=self.first_ns,
            duration_s=(self.last_ns - self.first_ns) * _NS,
            whole=reader.whole and ENDING in reader.metadata,
            dropped=0,
            unreadable=self.unreadable + reader.damaged,
            counts=dict(sorted(self.counts.items())),
            status=states[-1][1] if states else None,
            tip=self._tip_series(tips),
            axes=self._axes_series(self._of(Axes)),
            risk=self._risk_series(self._of(Risk)),
            loop=self._loop_series(self._of(Loop)),
            states=[((wall_ns - self.first_ns) * _NS, state) for wall_ns, state in self.states],
            events=self._of(Event),
            cycles=table.rows(),
        )

    def _of(self, kind: type[Kind]) -> list[tuple[float, Kind]]:
        """Messages of a kind, in order of time, with the time since the start in s."""
        timed = [
            ((wall_ns - self.first_ns) * _NS, message)
            for wall_ns, message in self.messages.get(kind, [])
            if isinstance(message, kind)
        ]
        return sorted(timed, key=lambda each: each[0])

    def _tip_series(self, tips: list[tuple[float, Tip]]) -> Series | None:
        if not tips:
            return None
        each = [tip for _, tip in tips]
        return Series(
            _times(tips),
            {
                "tip_mm": _rows([tip.tip_mm for tip in each], 3),
                "measured_mm": _rows([tip.measured_mm for tip in each], 3),
                "reference_mm": _rows([tip.reference_mm for tip in each], 3),
                "error_mm": _numbers([tip.error_mm for tip in each]),
                "cycle": np.array([float(tip.cycle) for tip in each]),
                "running": np.array([float(tip.state == _RUNNING) for tip in each]),
            },
        )

    def _axes_series(self, steps: list[tuple[float, Axes]]) -> Series | None:
        if not steps:
            return None
        each = [axes for _, axes in steps]
        count = max(len(axes.actual) for axes in each)
        return Series(
            _times(steps),
            {
                "actual": _rows([axes.actual for axes in each], count),
                "target": _rows([axes.target for axes in each], count),
                "proposed": _rows([axes.proposed for axes in each], count),
                "permitted": _rows([axes.permitted for axes in each], count),
                "force": _rows([axes.force for axes in each], count),
            },
        )

    def _risk_series(self, steps: list[tuple[float, Risk]]) -> Series | None:
        if not steps:
            return None
        each = [risk for _, risk in steps]
        count = max(len(risk.means_mm or []) for risk in each)
        return Series(
            _times(steps),
            {
                "contact": _numbers([risk.contact_risk for risk in each]),
                "body_point": _numbers([risk.body_point_risk for risk in each]),
                "threshold": _numbers([risk.threshold for risk in each]),
                "scale": _numbers([risk.scale for risk in each]),
                "clearance_mm": _numbers([risk.clearance_mm for risk in each]),
                "place_mm": _rows([risk.place_mm for risk in each], 3),
                "obstacle_mm": _rows([risk.obstacle_mm for risk in each], 3),
                "means_mm": _rows([_flat(risk.means_mm) for risk in each], 3 * count),
            },
        )

    def _loop_series(self, seconds: list[tuple[float, Loop]]) -> Series | None:
        if not seconds:
            return None
        names = ("lateness_p50_s", "lateness_p99_s", "lateness_max_s", "step_p50_s", "step_p99_s")
        columns = {
            name: _numbers([getattr(loop.status, name) for _, loop in seconds]) for name in names
        }
        columns["missed"] = _numbers([float(loop.status.missed) for _, loop in seconds])
        return Series(_times(seconds), columns)


def _times(timed: list[tuple[float, Kind]]) -> Array:
    return np.array([t_s for t_s, _ in timed])


def _numbers(values: list[float | None]) -> Array:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _flat(places: list[list[float]] | None) -> list[float]:
    return [] if places is None else [number for place in places for number in place]


def _rows(values: list[list[float] | None], width: int) -> Array:
    """One row for each value, nan where it has nothing."""
    nothing = [np.nan] * width

    def row(value: list[float] | None) -> list[float]:
        return nothing if value is None else (value + nothing[len(value) :])[:width]

    rows = (value if value is not None and len(value) == width else row(value) for value in values)
    numbers = np.fromiter(chain.from_iterable(rows), np.float64, len(values) * width)
    return numbers.reshape(len(values), width)


def _read_provenance(path: Path) -> Provenance | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=Provenance)
    except (OSError, msgspec.MsgspecError):
        return None


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
