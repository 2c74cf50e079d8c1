"""`result.json`: what came out of a run, in figures."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from daemon.files import write_whole
from daemon.messages import LoopStatus, Tip
from daemon.recording.run_folder import RESULT_FILE, formatted_json
from safety.states import OperatingState

# The tip's error, cycle by cycle, as the papers' tables give it.


_RUNNING: Final = OperatingState.RUNNING.value
_HEAD: Final = ("cycle", "samples", "mean mm", "std mm", "max mm")


class CycleError(msgspec.Struct, frozen=True, kw_only=True):
    """Distance between tip and reference over one cycle of the trajectory."""

    cycle: int
    """From 0."""
    samples: int
    mean_mm: float
    std_mm: float
    """Of the samples about their mean, divided by their number."""
    max_mm: float


class PoseError(msgspec.Struct, frozen=True, kw_only=True):
    """Root mean squares over one cycle of the trajectory, coordinate by coordinate."""

    cycle: int
    """From 0."""
    samples: int
    x_mm: float
    y_mm: float
    z_mm: float
    angle_rad: float | None = None
    """Between the tip's direction and the reference's. None: it may be any."""


class ErrorTable:
    """Accumulates errors while the robot follows its trajectory; what leads to it is left out."""

    def __init__(self) -> None:
        self._cycles: dict[int, _Accumulated] = {}

    def add(self, tip: Tip) -> None:
        """Count this step in if it belongs to a cycle and has an error."""
        error_mm = tip.error_mm
        if tip.state != _RUNNING or tip.cycle < 0 or error_mm is None:
            return
        self.count(tip.cycle, error_mm)

    def count(self, cycle: int, error_mm: float) -> None:
        """Count one error of a cycle in, unless it is not finite."""
        if math.isfinite(error_mm):
            accumulated = self._cycles.get(cycle)
            if accumulated is None:
                accumulated = self._cycles[cycle] = _Accumulated()
            accumulated.add(error_mm)

    def rows(self) -> list[CycleError]:
        """One row for each cycle that has samples, in order."""
        return [self._cycles[number].row(number) for number in sorted(self._cycles)]

    def __str__(self) -> str:
        return table_text(self.rows())


def table_text(rows: Sequence[CycleError]) -> str:
    """The table for a terminal."""
    if not rows:
        return "no cycle was followed"
    lines = ["  ".join(f"{name:>8}" for name in _HEAD)]
    for row in rows:
        figures = (row.mean_mm, row.std_mm, row.max_mm)
        cells = [f"{row.cycle + 1:>8}", f"{row.samples:>8}", *(f"{mm:>8.3f}" for mm in figures)]
        lines.append("  ".join(cells))
    return "\n".join(lines)


def pose_text(rows: Sequence[PoseError]) -> str:
    """Errors by coordinate for a terminal."""
    lines = ["  ".join(f"{name:>8}" for name in ("cycle", "x mm", "y mm", "z mm", "angle °"))]
    for row in rows:
        angle = "-" if row.angle_rad is None else f"{math.degrees(row.angle_rad):.3f}"
        lengths = (f"{mm:>8.3f}" for mm in (row.x_mm, row.y_mm, row.z_mm))
        lines.append("  ".join([f"{row.cycle + 1:>8}", *lengths, f"{angle:>8}"]))
    return "\n".join(lines)


class _Accumulated:
    """Mean and spread in one pass, without the cancellation of a sum of squares."""

    __slots__ = ("_mean_mm", "_samples", "_squares_mm2", "_worst_mm")

    def __init__(self) -> None:
        self._samples = 0
        self._mean_mm = 0.0
        self._squares_mm2 = 0.0
        self._worst_mm = 0.0

    def add(self, error_mm: float) -> None:
        self._samples += 1
        before = error_mm - self._mean_mm
        self._mean_mm += before / self._samples
        self._squares_mm2 += before * (error_mm - self._mean_mm)
        self._worst_mm = max(self._worst_mm, error_mm)

    def row(self, cycle: int) -> CycleError:
        return CycleError(
            cycle=cycle,
            samples=self._samples,
            mean_mm=self._mean_mm,
            std_mm=math.sqrt(self._squares_mm2 / self._samples),
            max_mm=self._worst_mm,
        )


class ComputingTime(msgspec.Struct, frozen=True, kw_only=True):
    """What the controller cost its thread, in real time. It is never the same twice."""

    steps: int
    """That followed the reference."""
    median_ms: float
    """Of observing and proposing, in one step."""
    p99_ms: float
    max_ms: float
    idle_mean_ms: float
    """Work that could wait, per step."""


class TrackerLimits(msgspec.Struct, frozen=True, kw_only=True):
    """What no controller can go below, because it sees the tip through this tracker."""

    noise_mm: float
    """Mean distance of the filtered tip from its own smooth course: the error as it is read, were
    it zero."""
    reading_noise_mm: float
    """The same of single readings."""
    distortion_mm: float | None = None
    """Mean distance of smoothed readings from the true tip: the true error, were the one that is
    read zero. None: the true tip is not known."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """Figures of one run. Fields are only added, and have a default."""

    robot: str
    simulated: bool
    """Whether the devices were emulated."""
    trajectory: str
    controller: str
    seed: int | None
    duration_s: float
    """From the start of the first cycle to the end of the last."""
    cycles: list[CycleError]
    """The tip's error, cycle by cycle."""
    steps: int
    """Control steps while RUNNING."""
    holds: int
    """How often the motion was interrupted."""
    refusals: int
    """Steps that the gate refused altogether."""
    recordings_dropped: int = 0
    """Messages that are missing in the recording."""
    final_state: str = ""
    faults: list[str] = []
    """Names of the causes that led to HOLD, FAULT or ESTOP, in order."""
    timing: LoopStatus | None = None
    """The loop's time keeping at the end. None: in virtual time, in which nothing takes time."""
    virtual_time: bool = False
    """Whether durations are those of a clock that jumped."""
    reading_cycles: list[CycleError] = []
    """As `cycles`, of single readings of the tracker instead of the filtered tip."""
    true_cycles: list[CycleError] = []
    """As `cycles`, of the true tip. Empty: nobody knows it."""
    tip_pose: list[PoseError] = []
    """As `cycles`, coordinate by coordinate and with the tip's direction."""
    reading_pose: list[PoseError] = []
    """The same of single readings."""
    true_pose: list[PoseError] = []
    """Of the true tip. Empty: nobody knows it."""
    sensor_angle_rad: list[float] = []
    """Angle between the axis of the tip's sensor itself and the reference's direction, root mean
    square of readings, cycle by cycle: as `reading_pose` has it for who does not know how the
    sensor is turned in the tip."""
    drifts: list[float] = []
    """Distance of the axes' places at a cycle's end from those at its beginning, each axis in
    shares of its travel, cycle by cycle: what has crept into the null space where the path is
    closed."""
    converged_s: float | None = None
    """When the error's mean over the last quarter of a cycle was below 1 mm for good, since the
    trajectory began; 0: the first such mean was. None: it never was."""
    limits: TrackerLimits | None = None
    computing: ComputingTime | None = None
    plant_failures: int = 0
    """How often the emulated body found no equilibrium, and stayed as it was."""
    control_sha256: str = ""
    """Fingerprint of the control channels: equal for equal runs in virtual time."""


def write_result(folder: Path, result: Result) -> None:
    """Raises OSError."""
    write_whole(folder / RESULT_FILE, formatted_json(result))


def read_result(folder: Path) -> Result | None:
    """None: the run has no result, or one that cannot be read."""
    try:
        return msgspec.json.decode((folder / RESULT_FILE).read_bytes(), type=Result)
    except (OSError, msgspec.MsgspecError):
        return None
