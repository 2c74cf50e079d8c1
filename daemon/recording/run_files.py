"""The files of a run's folder: their names, and how they are written."""

import os
from pathlib import Path
from typing import Final

RUN_FILE: Final = "run.mcap"
RUN_FILES: Final = "run*.mcap"
"""Pattern of all recordings of a run."""
ROBOT_FILE: Final = "robot.yaml"
PROVENANCE_FILE: Final = "provenance.json"
RESULT_FILE: Final = "result.json"
REPORT_FILE: Final = "report.html"
_UNFINISHED: Final = ".part"


def segment_file(number: int) -> str:
    """Name of a run's first recording, or of the one that went on when the last one was lost."""
    return RUN_FILE if number == 1 else f"run-{number}.mcap"


def unfinished(path: Path) -> Path:
    """Where a recording stands until it is finished."""
    return path.with_name(path.name + _UNFINISHED)


def finished(part: Path) -> Path:
    """Where an unfinished recording shall stand: the reverse of `unfinished`."""
    return part.with_name(part.name.removesuffix(_UNFINISHED))


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that is either there with all of `data`, or not there. Raises OSError."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
