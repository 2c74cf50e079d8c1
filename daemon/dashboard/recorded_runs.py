"""The recordings that a page may list, replay and fetch: folders of runs, read and never written.

Everything here looks at disks: it is to be called in a thread.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import msgspec

from daemon.recording.result import Result, read_result
from daemon.recording.run_folder import PROVENANCE_FILE, REPORT_FILE, SURROUNDINGS_FILES
from daemon.recording.run_parts import run_files
from daemon.recording.run_reader import UnreadableRunError

_MOST_LISTED: Final = 300
_UNFINISHED: Final = ".part"


class _Started(msgspec.Struct):
    """What is told of a run's provenance."""

    robot: str = ""
    started: str = ""


class RecordedRuns:
    """Runs by their names: the names of their folders, or of files that were named."""

    def __init__(self, roots: Iterable[Path] = (), named: Iterable[Path] = ()) -> None:
        """roots: folders whose folders are runs. named: runs wherever they are."""
        self._roots = list(roots)
        self._named = {path.resolve().name: path.resolve() for path in named}

    def add_root(self, root: Path) -> None:
        """Where another daemon's recordings go."""
        if root not in self._roots:
            self._roots.append(root)

    def offered(self) -> list[dict[str, Any]]:
        """The newest first, 300 at most."""
        found = dict(self._named)
        for root in list(self._roots):
            for path in _folders(root):
                found.setdefault(path.name, path)
        told = [row for name, path in found.items() if (row := _told(name, path)) is not None]
        return sorted(told, key=lambda row: (row["started"], row["name"]), reverse=True)[
            :_MOST_LISTED
        ]

    def find(self, name: str) -> Path | None:
        """The run of that name; None: there is none. A name never leads out of the roots."""
        if name in self._named:
            return self._named[name]
        for root in list(self._roots):
            for path in _folders(root):
                if path.name == name and _files(path):
                    return path
        return None

    def file(self, name: str, file: str) -> Path | None:
        """One of a run's recordings, its report or its surroundings; None: there is none."""
        run = self.find(name)
        if run is None:
            return None
        offered = {path.name: path for path in _files(run)}
        folder = run if run.is_dir() else run.parent
        for other in (folder / REPORT_FILE, *folder.glob(SURROUNDINGS_FILES)):
            if other.is_file() and not other.is_symlink():
                offered[other.name] = other
        return offered.get(file)


def _folders(root: Path) -> list[Path]:
    """Links are not followed: what they lead to is somewhere else."""
    try:
        return [path for path in root.iterdir() if path.is_dir() and not path.is_symlink()]
    except OSError:
        return []


def _files(run: Path) -> list[Path]:
    """Its recordings; empty: it is no run."""
    try:
        return [path for path in run_files(run) if not path.is_symlink() and path.is_file()]
    except (UnreadableRunError, OSError):
        return []


def _told(name: str, path: Path) -> dict[str, Any] | None:
    files = _files(path)
    if not files:
        return None
    folder = path if path.is_dir() else path.parent
    result, started = read_result(folder), _started(folder / PROVENANCE_FILE)
    return {
        "name": name,
        "robot": started.robot,
        "started": started.started,
        "files": [{"name": file.name, "bytes": _size(file)} for file in files],
        "finished": not any(file.name.endswith(_UNFINISHED) for file in files),
        "report": (folder / REPORT_FILE).is_file(),
        **_figures(result),
    }


def _figures(result: Result | None) -> dict[str, Any]:
    if result is None:
        return {}
    last = result.cycles[-1] if result.cycles else None
    return {
        "trajectory": result.trajectory,
        "controller": result.controller,
        "duration_s": result.duration_s,
        "cycles": len(result.cycles),
        "mean_mm": None if last is None else last.mean_mm,
        "final_state": result.final_state,
    }


def _started(path: Path) -> _Started:
    try:
        return msgspec.json.decode(path.read_bytes(), type=_Started)
    except (OSError, msgspec.MsgspecError):
        return _Started()


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
