"""`result.json`: what came out of a run, in figures."""

from pathlib import Path

import msgspec

from daemon.messages import LoopStatus
from daemon.recording.error_table import CycleError
from daemon.recording.run_files import RESULT_FILE, write_whole
from daemon.recording.run_folder import formatted_json


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
    """The loop's time keeping at the end."""
    reading_cycles: list[CycleError] = []
    """As `cycles`, of single readings of the tracker instead of the filtered tip."""
    true_cycles: list[CycleError] = []
    """As `cycles`, of the true tip. Empty: nobody knows it."""
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
