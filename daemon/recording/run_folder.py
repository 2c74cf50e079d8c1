"""A run's folder: made under a name that tells robot and date, with all that explains the run."""

import hashlib
import platform
import shutil
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
import yaml

from config.paths import values_with_absolute_paths
from config.robot import Robot
from daemon.files import write_whole

# The files of a run's folder: their names, and how they are written.


RUN_FILE: Final = "run.mcap"
RUN_FILES: Final = "run*.mcap"
"""Pattern of all recordings of a run."""
ROBOT_FILE: Final = "robot.yaml"
PROVENANCE_FILE: Final = "provenance.json"
RESULT_FILE: Final = "result.json"
REPORT_FILE: Final = "report.html"
SURROUNDINGS_FILE: Final = "surroundings.stl"
"""What was round the body, in the base sensor's frame, in mm."""
SURROUNDINGS_FILES: Final = "surroundings*.stl"
"""Pattern of that, and of what has taken its place."""
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


# How much room there is for recordings.


_BYTES_PER_MB: Final = 1_000_000


def free_mb(folder: Path) -> float | None:
    """Room on the disk under a folder, which need not exist yet. None: cannot be told."""
    for place in (folder, *folder.absolute().parents):
        try:
            return shutil.disk_usage(place).free / _BYTES_PER_MB
        except FileNotFoundError:
            continue
        except OSError:
            return None
    return None


_CHECKOUT: Final = Path(__file__).parents[2]
_GIT_WITHIN_S: Final = 5.0
_PACKAGES: Final = ("numpy", "scipy", "numba", "mcap", "eclipse-zenoh")


VIRTUAL_TIME: Final = "virtual time"
"""Instead of a date: of a run whose clock jumped from one deadline to the next."""


class Provenance(msgspec.Struct, frozen=True, kw_only=True):
    """`provenance.json`: what made the run, as far as it can be told."""

    robot: str
    started: str
    """Date and time, UTC; or that it was in virtual time."""
    version: str
    commit: str | None
    """Of the checkout that the code ran from; None: it was installed."""
    modified: bool | None
    """Whether the checkout differed from its commit."""
    python: str
    system: str
    packages: dict[str, str]
    seed: int | None
    config_sha256: str
    """Of `robot.yaml`."""
    models_sha256: dict[str, str]
    """Of the files of learned models, by name."""


def new_run(root: Path, robot: str, wall_ns: int) -> Path:
    """Make an empty folder `<robot>-<UTC date and time>[-n]` under `root`. Raises OSError."""
    name = f"{robot}-{utc_text(wall_ns).replace(':', '-')}"
    root.mkdir(parents=True, exist_ok=True)
    for number in count(1):
        folder = root / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            continue
        return folder
    raise AssertionError("there are more numbers than folders")


def describe_run(
    folder: Path,
    robot: Robot,
    robot_path: Path,
    wall_ns: int | None,
    seed: int | None = None,
    models: Mapping[str, Path] | None = None,
    surroundings: bytes = b"",
) -> Provenance:
    """Write `robot.yaml`, `provenance.json`, and `surroundings.stl` where any are known.

    Raises OSError.

    robot_path: of the file that `robot` was read from. wall_ns: None in virtual time, which has no
    date. models: files by name. surroundings: a binary STL file, mm.
    """
    text = robot_yaml(robot, robot_path).encode()
    write_whole(folder / ROBOT_FILE, text)
    if surroundings:
        write_whole(folder / SURROUNDINGS_FILE, surroundings)
    commit, modified = _checkout()
    provenance = Provenance(
        robot=robot.robot,
        started=VIRTUAL_TIME if wall_ns is None else utc_text(wall_ns),
        version=version("tentacled"),
        commit=commit,
        modified=modified,
        python=platform.python_version(),
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        packages={name: output for name in _PACKAGES if (output := _version(name))},
        seed=seed,
        config_sha256=hashlib.sha256(text).hexdigest(),
        models_sha256={
            name: hashlib.sha256(path.read_bytes()).hexdigest()
            for name, path in sorted((models or {}).items())
        },
    )
    write_whole(folder / PROVENANCE_FILE, formatted_json(provenance))
    return provenance


def robot_yaml(robot: Robot, robot_path: Path) -> str:
    """The robot as one file that stands alone: all defaults written out, all paths absolute."""
    values = values_with_absolute_paths(robot, robot_path)
    return yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=100)


def utc_text(wall_ns: int) -> str:
    """A date as in `2020-01-01T00:00:00Z`."""
    return f"{np.datetime64(wall_ns // 1_000_000_000, 's')}Z"


def formatted_json(value: msgspec.Struct) -> bytes:
    """JSON that people read too."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _checkout() -> tuple[str | None, bool | None]:
    """Commit of the checkout that this file is in, and whether files differ from it."""
    if not (_CHECKOUT / ".git").exists():
        return None, None
    command = ["git", "-C", str(_CHECKOUT), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        output = subprocess.run(
            [*command, "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=_GIT_WITHIN_S,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None, None
    return output.removesuffix("-dirty"), output.endswith("-dirty")
