"""What is in the files that a robot and an experiment name: where it changes, so do results.

Files that are shipped with us are part of the program, and not looked at.
"""

import hashlib
from functools import lru_cache
from pathlib import Path

from config.loader import RobotFile
from config.paths import BUILTIN, named_model, named_paths
from daemon.workbench.experiments.experiment_file import ExperimentFile


def robot_contents(file: RobotFile) -> dict[str, str]:
    """Hashes of what the robot's drives, its model and its surroundings are read from, by field."""
    return {
        ".".join(map(str, named.location)): _sha256(named.path)
        for named in named_paths(file.robot, file.path)
        if named.is_file and not named.reference.startswith(BUILTIN)
    }


def experiment_contents(file: ExperimentFile) -> dict[str, str]:
    """The same of an experiment: what its path and its controller begin with is read from."""
    found = {}
    way = getattr(file.experiment.trajectory, "file", None)
    if way is not None:
        found["trajectory.file"] = _sha256(file.path.parent / way)
    model = getattr(file.experiment.controller, "model", None)
    if model is not None and not model.startswith(BUILTIN):
        found["controller.model"] = _sha256(named_model(model))
    return found


def _sha256(path: Path) -> str:
    """Empty: it cannot be read, which whoever uses it tells."""
    try:
        stat = path.stat()
        return _sha256_of(path, stat.st_mtime_ns, stat.st_size)
    except OSError:
        return ""


@lru_cache
def _sha256_of(path: Path, written_ns: int, size: int) -> str:
    """All runs of a study name the same few files. Raises OSError."""
    del written_ns, size
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
