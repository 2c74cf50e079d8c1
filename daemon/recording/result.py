"""`result.json`: what came out of a run, in figures."""

from pathlib import Path

import msgspec

from daemon.recording.error_table import CycleError
from daemon.recording.run_files import RESULT_FILE, write_whole
from daemon.recording.run_folder import formatted_json
from daemon.remote.messages import LoopStatus


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
