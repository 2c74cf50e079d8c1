"""A recording as arrays, for figures and tables."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from config.tasks.planned_path import PlannedPath
from daemon.host.real_time import collector_paused
from daemon.messages import (
    Axes,
    AxisStatus,
    Event,
    InternalError,
    Loop,
    Message,
    PathPlanned,
    Risk,
    Status,
    Tip,
)
from daemon.recording.format.channels import MESSAGES
from daemon.recording.result import CycleError, ErrorTable, Result, read_result
from daemon.recording.run_folder import (
    PROVENANCE_FILE,
    ROBOT_FILE,
    VIRTUAL_TIME,
    Provenance,
)
from daemon.recording.run_parts import RunParts, run_files, segment_number
from daemon.recording.run_reader import RunMessage, UnreadableRunError
from daemon.recording.run_writer import HEADER
from daemon.reference.planned_path import PlannedPathError, read_path
from daemon.workbench.report.report_table import Array, Column, MessageTable, fitted, number
from safety.risk_source import NoModel
from safety.states import OperatingState

_RUNNING: Final = OperatingState.RUNNING.value
_NS: Final = 1e-9
_DECODERS: Final = {topic: msgspec.json.Decoder(kind) for topic, kind in MESSAGES.items()}
_WITH_STATE: Final = (Tip, Status)
NO_MODEL: Final = NoModel().name


def _flat(places: list[list[float]] | None) -> list[float] | None:
    return None if places is None else [number for place in places for number in place]


def _no_model(risk: Risk) -> bool:
    """What a stand-in says is no figure."""
    return risk.source == NO_MODEL


_COLUMNS: Final[dict[type[Message], dict[str, Column]]] = {
    Tip: {
        "tip_mm": Column(lambda tip: tip.tip_mm, 3),
        "measured_mm": Column(lambda tip: tip.measured_mm, 3),
        "reference_mm": Column(lambda tip: tip.reference_mm, 3),
        "error_mm": number(lambda tip: tip.error_mm),
        "error_rad": number(lambda tip: tip.error_rad),
        "expected_mm": number(lambda tip: tip.expected_mm),
        "cycle": number(lambda tip: tip.cycle),
        "running": number(lambda tip: tip.state == _RUNNING),
        "believed": number(lambda tip: tip.believed),
    },
    Axes: {
        "actual": Column(lambda axes: axes.actual),
        "target": Column(lambda axes: axes.target),
        "proposed": Column(lambda axes: axes.proposed),
        "permitted": Column(lambda axes: axes.permitted),
        "force": Column(lambda axes: axes.force),
    },
    Risk: {
        "contact": number(lambda risk: None if _no_model(risk) else risk.contact_risk),
        "body_point": number(lambda risk: risk.body_point_risk),
        "threshold": number(lambda risk: risk.threshold),
        "scale": number(lambda risk: risk.scale),
        "clearance_mm": number(lambda risk: risk.clearance_mm),
        "aside_arc_mm": number(lambda risk: risk.aside_arc_mm),
        "given_up_mm": number(lambda risk: risk.given_up_mm),
        "place_mm": Column(lambda risk: risk.place_mm, 3),
        "obstacle_mm": Column(lambda risk: risk.obstacle_mm, 3),
        "means_mm": Column(lambda risk: _flat(risk.means_mm)),
        "tip_statistic": number(lambda risk: risk.tip_statistic),
        "tip_off_mm": number(lambda risk: risk.tip_off_mm),
        "path": number(lambda risk: risk.path_risk),
        "minute": number(lambda risk: risk.minute_risk),
    },
    Loop: {
        "lateness_p50_s": number(lambda loop: loop.status.lateness_p50_s),
        "lateness_p99_s": number(lambda loop: loop.status.lateness_p99_s),
        "lateness_max_s": number(lambda loop: loop.status.lateness_max_s),
        "step_p50_s": number(lambda loop: loop.status.step_p50_s),
        "step_p99_s": number(lambda loop: loop.status.step_p99_s),
        "missed": number(lambda loop: loop.status.missed),
    },
}


@dataclass
class Series:
    """Values over time: `t_s` of shape (N,), everything else (N,) or (N, columns), nan: none."""

    t_s: Array
    columns: dict[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]


class Gap(NamedTuple):
    """A time that nobody recorded, between one recording and the next."""

    from_s: float
    to_s: float
    before: str
    """Name of the recording that ended."""
    after: str


class PlannedInRun(NamedTuple):
    """One path that was planned in a run."""

    t_s: float
    """When, since the run's beginning."""
    told: PathPlanned
    path: PlannedPath | None
    """Its file beside the recording; None: it is not there, or cannot be read."""

    def figure(self, name: str) -> float | None:
        """One of the planner's own figures."""
        value = None if self.path is None else self.path.figures.get(name)
        return float(value) if isinstance(value, int | float) else None

    @property
    def before(self) -> float | None:
        """Contact risk of the roadmap's path, before it was refined."""
        value = None if self.path is None else self.path.figures.get("before")
        found = value.get("contact_risk") if isinstance(value, dict) else None
        return float(found) if isinstance(found, int | float) else None

    @property
    def course(self) -> tuple[Array, Array] | None:
        """(k,) s and (k,) share of the bodies that touch at each place, as it was planned."""
        if self.path is None:
            return None
        risks = self.path.figures.get("contact_risk_by_place")
        if not isinstance(risks, list) or len(risks) != len(self.path.t_s):
            return None
        try:
            return np.array(self.path.t_s), np.array(risks, np.float64)
        except (TypeError, ValueError):
            return None


@dataclass
class RunData:
    """All that a report tells. A part that was not recorded is None or empty."""

    path: Path
    """Of the recording, or of the first one."""
    header: dict[str, str]
    started_ns: int
    """Date of the first message."""
    duration_s: float
    whole: bool
    """Whether the recording was ended properly."""
    dropped: int
    unreadable: int
    """Messages or chunks that could not be read."""
    files: list[str]
    """Names of the recordings, in order."""
    gaps: list[Gap]
    one_of_more: bool
    """Whether it is only one of its run's recordings that is shown."""
    counts: dict[str, int]
    """Messages by topic."""
    status: Status | None
    """The last one."""
    tip: Series | None
    """tip_mm, measured_mm, reference_mm, error_mm, error_rad, expected_mm, cycle, running and
    believed."""
    axes: Series | None
    """actual, target, proposed, permitted, force."""
    risk: Series | None
    """contact, body_point, threshold, scale, clearance_mm, aside_arc_mm, given_up_mm, place_mm,
    obstacle_mm, means_mm, tip_statistic, tip_off_mm, path, minute."""
    loop: Series | None
    """lateness_p50_s, lateness_p99_s, lateness_max_s, step_p50_s, step_p99_s, missed."""
    states: list[tuple[float, str]]
    """When the robot came into which state."""
    events: list[tuple[float, Event]]
    internal_errors: list[tuple[float, InternalError]]
    """Of the daemon's own, with their tracebacks."""
    cycles: list[CycleError]
    risk_sources: tuple[str, ...] = ()
    """Who told of the risk."""
    plans: list[PlannedInRun] = field(default_factory=list)
    """Paths that were planned meanwhile."""
    result: Result | None = None
    provenance: Provenance | None = None
    robot_yaml: str = ""

    @property
    def in_virtual_time(self) -> bool:
        """Whether its clock jumped: it has no date, and what took how long says nothing."""
        if self.result is not None and self.result.virtual_time:
            return True
        return self.header.get("time") == VIRTUAL_TIME

    @property
    def axis_status(self) -> list[AxisStatus]:
        """Names and units of the axes, as far as they were told."""
        return [] if self.status is None else self.status.axes


def read_run(path: Path) -> RunData:
    """Read a run. path: as for `run_files`. Raises UnreadableRunError, OSError."""
    return GrowingRun(path).data()


class GrowingRun:
    """A run that may still be going on, read as far as it has been recorded."""

    def __init__(self, path: Path, also: Callable[[RunMessage], None] | None = None) -> None:
        """path: as for `run_files`; there may not be anything yet. also: gets each message too."""
        self._path = path
        self._parts = RunParts(path)
        self._gathered = _Gathered()
        self._also = also

    def catch_up(self) -> None:
        """Read what has been added. Raises UnreadableRunError, OSError."""
        with collector_paused():
            for message in self._parts.messages():
                self._gathered.take(message.topic, message.wall_ns, message.data)
                if self._also is not None:
                    self._also(message)

    def data(self) -> RunData:
        """All there is. Raises UnreadableRunError, OSError."""
        self.catch_up()
        file = next(reader.path for reader in self._parts.readers.values())
        if not self._gathered.counts:
            raise UnreadableRunError(f"{file}: there is no message in it")
        data = self._gathered.run_data(file, self._parts)
        data.result = read_result(file.parent)
        data.provenance = _read_provenance(file.parent / PROVENANCE_FILE)
        data.robot_yaml = _text_of(file.parent / ROBOT_FILE)
        return data


@dataclass
class _Gathered:
    """What has been read so far."""

    counts: dict[str, int] = field(default_factory=dict)
    first_ns: int = 0
    last_ns: int = 0
    unreadable: int = 0
    states: list[tuple[int, str]] = field(default_factory=list)
    status: tuple[int, Status] | None = None
    """The last one."""
    events: list[tuple[int, Event]] = field(default_factory=list)
    internal_errors: list[tuple[int, InternalError]] = field(default_factory=list)
    plans: list[tuple[int, PathPlanned]] = field(default_factory=list)
    risk_sources: set[str] = field(default_factory=set)
    errors: ErrorTable = field(default_factory=ErrorTable)
    tables: dict[type[Message], MessageTable] = field(
        default_factory=lambda: {kind: MessageTable(columns) for kind, columns in _COLUMNS.items()}
    )

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
        self._keep(wall_ns, message)
        # In the order of writing: a Tip is dated by its measurement, before it was told.
        if isinstance(message, _WITH_STATE):
            self._enter(wall_ns, message.state)

    def _keep(self, wall_ns: int, message: Message) -> None:
        table = self.tables.get(type(message))
        if table is not None:
            table.add(wall_ns, message)
        if isinstance(message, Risk):
            self.risk_sources.add(message.source)
        elif isinstance(message, Tip):
            self.errors.add(message)
        elif isinstance(message, Event):
            self.events.append((wall_ns, message))
        elif isinstance(message, InternalError):
            self.internal_errors.append((wall_ns, message))
        elif isinstance(message, PathPlanned):
            self.plans.append((wall_ns, message))
        elif isinstance(message, Status) and (self.status is None or wall_ns >= self.status[0]):
            self.status = wall_ns, message

    def _enter(self, wall_ns: int, state: str) -> None:
        if not self.states or self.states[-1][1] != state:
            self.states.append((max([wall_ns, *(t_ns for t_ns, _ in self.states[-1:])]), state))

    def run_data(self, file: Path, parts: RunParts) -> RunData:
        return RunData(
            path=file,
            header=parts.metadata(HEADER),
            started_ns=self.first_ns,
            duration_s=self._s(self.last_ns),
            whole=parts.whole,
            dropped=parts.dropped,
            unreadable=self.unreadable + parts.unreadable,
            files=[reader.path.name for reader in parts.readers.values()],
            gaps=[
                Gap(self._s(one.last_ns), self._s(other.first_ns), one.path.name, other.path.name)
                for one, other in parts.gaps
            ],
            one_of_more=_one_of_more(parts.path),
            counts=dict(sorted(self.counts.items())),
            status=None if self.status is None else self.status[1],
            tip=self._series(Tip),
            axes=_as_wide_as(self._series(Axes), "actual"),
            risk=self._series(Risk),
            loop=self._series(Loop),
            states=[(self._s(wall_ns), state) for wall_ns, state in self.states],
            events=sorted(
                ((self._s(wall_ns), event) for wall_ns, event in self.events),
                key=lambda each: each[0],
            ),
            internal_errors=[(self._s(wall_ns), error) for wall_ns, error in self.internal_errors],
            cycles=self.errors.rows(),
            risk_sources=tuple(sorted(self.risk_sources)),
            plans=[
                PlannedInRun(self._s(wall_ns), told, _path_beside(file, told))
                for wall_ns, told in self.plans
            ],
        )

    def _s(self, wall_ns: int) -> float:
        """Since the start."""
        return (wall_ns - self.first_ns) * _NS

    def _series(self, kind: type[Message]) -> Series | None:
        table = self.tables[kind]
        if not len(table):
            return None
        times, columns = table.read()
        t_s = (times - self.first_ns).astype(np.float64) * _NS
        return Series(t_s, columns)


def _path_beside(recording: Path, told: PathPlanned) -> PlannedPath | None:
    """What the file holds that was kept with it; None: it is not there, or is no path."""
    try:
        return read_path(recording.parent / Path(told.file).name)
    except PlannedPathError:
        return None


def _one_of_more(path: Path) -> bool:
    if path.is_dir() or segment_number(path) is None:
        return False
    return len(run_files(path.parent)) > 1


def _as_wide_as(series: Series | None, name: str) -> Series | None:
    """All columns in the width of this one."""
    if series is None:
        return None
    width = series[name].shape[1]
    return Series(
        series.t_s, {each: fitted(column, width) for each, column in series.columns.items()}
    )


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
