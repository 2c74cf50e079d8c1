"""A collection in several processes, and again only what is not done yet.

What is done lies in a folder beside the file that it becomes, one file for some configurations
each; the folder goes when the file is there. Parts of another robot, of other settings or of
another version have other names: nothing of them is taken over.
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from config.loader import RobotFile
from config.robot import Robot
from daemon.array_files import load_npz, save_npz
from daemon.host.processes import WHOLE, Share
from daemon.host.progress import Progress
from daemon.workbench.body_model.clouds.camera_alignment import CameraAlignment, alignment_of
from daemon.workbench.body_model.clouds.centreline_fit import VisibleSurface
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset, origin
from daemon.workbench.body_model.clouds.collection import (
    FITTED,
    Arrays,
    CollectionError,
    CollectionSettings,
    fitted_at,
    planned,
    possible_ones,
    seen_at,
)
from safety.risk.model.mixture import FloatArray

_MOST_BYTES: Final = 1 << 32
_VERSION: Final = 3
"""Of what is collected, given the robot and the settings."""
_CANDIDATES: Final = 500
"""At most, in a task."""
_MOST_CANDIDATES: Final = 200
"""Times as many as configurations are wanted: then the body can hold next to nothing."""
_PART: Final = 23
"""Configurations: some seconds of work."""
_SEEN: Final = ("clouds_mm", "true_centrelines_mm", "forces", "radius_mm")
_FITTED: Final = ("clouds_mm", "centrelines_mm")
"""Arrays of a part's file, before and after the fit."""


def collect(
    file: RobotFile, settings: CollectionSettings, out: Path, workers: Executor, progress: Progress
) -> CloudDataset:
    """The whole data set, also written to `out`. As `collect_share`, of all."""
    dataset = collect_share(file, settings, out, workers, progress, WHOLE)
    assert dataset is not None  # of all, nothing is missing
    return dataset


def collect_share(
    file: RobotFile,
    settings: CollectionSettings,
    out: Path,
    workers: Executor,
    progress: Progress,
    share: Share,
) -> CloudDataset | None:
    """The data set, also written to `out`, or None where other shares' parts are missing yet.

    Parts are in the folder that is called as `out` with `.parts` behind it. Clouds come first; only
    when those of all shares are there can bodies be fitted to them. workers: such as
    `worker_processes` gives.
    Raises CollectionError, UnreachableError, CloudDatasetError, LabError, OSError. Interrupted, it
    goes on from where it was when it is called again.
    """
    robot = file.robot
    if robot.emulation is None:
        raise CollectionError(f"{file.path}: there is no 'emulation' in this robot file")
    key = _key(robot, settings)
    folder = out.with_name(f"{out.name}.parts")
    folder.mkdir(parents=True, exist_ok=True)
    parameters = _configurations(robot, settings, workers, folder / f"{key}.plan.npz", progress)
    plan = planned(robot, settings, parameters)
    work = _Work(robot, settings, plan, workers, folder / key, progress, share)
    seen = work.clouds()
    if seen is None:
        return None
    alignment = _alignment(robot, plan["configurations"], seen)
    fitted = work.fitted(seen, alignment)
    if fitted is None:
        return None
    provenance = {
        **origin(robot),
        "centrelines": FITTED,
        "clouds_moved_by_mm": alignment.shift_mm.round(4).tolist(),
        "settings": asdict(settings),
        "plant": robot.emulation.plant.model_dump(mode="json"),
        "tip_load_g": robot.emulation.tip_load_g,
    }
    arrays = {
        **plan,
        **{name: np.concatenate([part[name] for part in fitted]) for name in _FITTED},
        **{name: np.concatenate([part[name] for part in seen]) for name in _SEEN[1:-1]},
        "fit_error_mm": alignment.fit_error_mm,
        "radius_mm": seen[0]["radius_mm"],
    }
    dataset = CloudDataset.checked(arrays, provenance)
    dataset.save(out)
    shutil.rmtree(folder)
    return dataset


def _alignment(robot: Robot, u: FloatArray, seen: list[Arrays]) -> CameraAlignment:
    """Of all clouds at (n, m) u. Raises CollectionError."""
    assert robot.emulation is not None
    plant = robot.emulation.plant
    clouds = np.concatenate([part["clouds_mm"] for part in seen])
    nodes = seen[0]["true_centrelines_mm"].shape[2]
    each = clouds.reshape(-1, *clouds.shape[2:])
    surfaces = [VisibleSurface.of(plant, at) for at in u for _ in range(clouds.shape[1])]
    found = alignment_of(each, surfaces, nodes)
    if found is None:
        raise CollectionError("no body lies in any of the clouds: keep more points of each")
    if found.doubt:
        raise CollectionError(found.doubt)
    return found


def _configurations(
    robot: Robot,
    settings: CollectionSettings,
    workers: Executor,
    path: Path,
    progress: Progress,
) -> FloatArray:
    if path.exists():
        return np.asarray(load_npz(path)["parameters"])
    parameters = first_possible(robot, settings.configurations, settings.seed, workers, progress)
    save_npz(path, {"parameters": parameters})
    return parameters


def first_possible(
    robot: Robot, wanted: int, seed: int, workers: Executor, progress: Progress
) -> FloatArray:
    """(wanted, q) parameters of the first configurations of the sequence that the body can hold.

    Raises CollectionError, LabError.
    """
    progress.begin("what it can hold", wanted, 0)
    found: list[FloatArray] = []
    count, begin, each, at_once = 0, 0, min(_CANDIDATES, 2 * wanted), 4
    while count < wanted:
        if begin > _MOST_CANDIDATES * wanted:
            raise CollectionError(
                f"of {begin} configurations the body can hold {count}, and {wanted} are wanted: "
                "look at the axes' limits and at the workspace"
            )
        tasks = [
            workers.submit(possible_ones, robot, seed, begin + k * each, each)
            for k in range(at_once)
        ]
        for task in tasks:  # in their order: it decides which are the first
            found.append(task.result())
            progress.advance(min(len(found[-1]), max(0, wanted - count)))
            count += len(found[-1])
        begin += at_once * each
    return np.concatenate([part for part in found if len(part)])[:wanted]


class _Work:
    """All parts in their order, those that were there already among them."""

    def __init__(
        self,
        robot: Robot,
        settings: CollectionSettings,
        plan: Arrays,
        workers: Executor,
        prefix: Path,
        progress: Progress,
        share: Share,
    ) -> None:
        self._share = share
        self._robot, self._settings, self._plan = robot, settings, plan
        self._workers, self._prefix, self._progress = workers, prefix, progress
        n = len(plan["configurations"])
        self._parts = [np.arange(begin, min(begin + _PART, n)) for begin in range(0, n, _PART)]

    def clouds(self) -> list[Arrays] | None:
        """What is seen; None: not all of it is there."""

        def begun(number: int) -> Future[Arrays]:
            mine = self._parts[number]
            u, starts = self._plan["configurations"][mine], self._plan["starts"][mine]
            return self._workers.submit(seen_at, self._robot, self._settings, mine, u, starts)

        return self._each("clouds", "", _SEEN, begun)

    def fitted(self, seen: list[Arrays], alignment: CameraAlignment) -> list[Arrays] | None:
        """What is fitted to that; None: not all of it is there."""
        nodes = seen[0]["true_centrelines_mm"].shape[2]

        def begun(number: int) -> Future[Arrays]:
            u = self._plan["configurations"][self._parts[number]]
            clouds, shift = seen[number]["clouds_mm"], alignment.shift_mm
            return self._workers.submit(fitted_at, self._robot, u, clouds, nodes, shift)

        return self._each("centrelines", ".fit", _FITTED, begun)

    def _each(
        self, what: str, kind: str, names: Sequence[str], begun: Callable[[int], Future[Arrays]]
    ) -> list[Arrays] | None:
        paths = [
            self._prefix.with_name(f"{self._prefix.name}.{number:04d}{kind}.npz")
            for number in range(len(self._parts))
        ]
        there = {
            number: part
            for number, path in enumerate(paths)
            if (part := self._read(path, names, len(self._parts[number])))
        }
        mine = [number for number in range(len(paths)) if self._share.has(number)]
        done = sum(len(self._parts[number]) for number in mine if number in there)
        self._progress.begin(what, sum(len(self._parts[number]) for number in mine), done)
        tasks = {begun(i): i for i in mine if i not in there}
        for task in as_completed(tasks):
            number = tasks[task]
            there[number] = task.result()
            save_npz(paths[number], there[number])
            self._progress.advance(len(self._parts[number]))
        return [there[number] for number in range(len(paths))] if len(there) == len(paths) else None

    def _read(self, path: Path, names: Sequence[str], configurations: int) -> Arrays | None:
        """What is in a part's file; None where it is not there or not whole."""
        try:
            there = load_npz(path, _MOST_BYTES)
            part = {name: there[name] for name in names}
        except Exception:  # whatever a reader makes of bytes that are no part
            return None
        shape = (configurations, self._settings.starts, self._settings.points, 3)
        return part if part["clouds_mm"].shape == shape else None


def _key(robot: Robot, settings: CollectionSettings) -> str:
    """Of all that decides what is seen."""
    assert robot.emulation is not None
    provenance: dict[str, Any] = {
        "version": _VERSION,
        "axes": [axis.model_dump(mode="json", exclude={"drive"}) for axis in robot.axes],
        "workspace": robot.workspace and robot.workspace.model_dump(mode="json"),
        "plant": robot.emulation.plant.model_dump(mode="json"),
        "tip_load_g": robot.emulation.tip_load_g,
        "settings": asdict(settings),
    }
    return hashlib.sha256(json.dumps(provenance, sort_keys=True).encode()).hexdigest()[:16]
