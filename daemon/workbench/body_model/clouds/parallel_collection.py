"""A collection in several processes, and again only what is not done yet.

What is done lies in a folder beside the file that it becomes, one file for some configurations
each; the folder goes when the file is there. Parts of another robot, of other settings or of
another version have other names: nothing of them is taken over.
"""

import hashlib
import json
import shutil
from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from config.loader import RobotFile
from config.robot import Robot
from daemon.array_files import load_npz, save_npz, whose
from daemon.host.progress import Progress
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
from daemon.workbench.body_model.clouds.collection import (
    FITTED,
    Arrays,
    CollectionError,
    CollectionSettings,
    planned,
    possible_ones,
    seen_at,
)
from safety.risk.mixture import FloatArray

_VERSION: Final = 2
_MOST_BYTES: Final = 1 << 32
"""Of what is collected, given the robot and the settings."""
_CANDIDATES: Final = 500
"""At most, in a task."""
_MOST_CANDIDATES: Final = 200
"""Times as many as configurations are wanted: then the body can hold next to nothing."""
_PART: Final = 23
"""Configurations: some seconds of work."""
_OF_PART: Final = (
    "clouds_mm",
    "centrelines_mm",
    "true_centrelines_mm",
    "forces",
    "radius_mm",
)


def collect(
    file: RobotFile, settings: CollectionSettings, out: Path, workers: Executor, progress: Progress
) -> CloudDataset:
    """The whole data set, also written to `out`.

    workers: such as `worker_processes` gives.
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
    parts = _collected(robot, settings, plan, workers, folder, key, progress)
    seen = {name: np.concatenate([part[name] for part in parts]) for name in _OF_PART[:-1]}
    provenance = {
        **whose(robot),
        "centrelines": FITTED,
        "settings": asdict(settings),
        "plant": robot.emulation.plant.model_dump(mode="json"),
        "tip_load_g": robot.emulation.tip_load_g,
    }
    radius = {"radius_mm": parts[0]["radius_mm"]}
    dataset = CloudDataset.checked({**plan, **seen, **radius}, provenance)
    dataset.save(out)
    shutil.rmtree(folder)
    return dataset


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


def _collected(
    robot: Robot,
    settings: CollectionSettings,
    plan: Arrays,
    workers: Executor,
    folder: Path,
    key: str,
    progress: Progress,
) -> list[Arrays]:
    """All parts in their order, those that were there already among them."""
    n = len(plan["configurations"])
    chosen = [np.arange(begin, min(begin + _PART, n)) for begin in range(0, n, _PART)]
    paths = [folder / f"{key}.{number:04d}.npz" for number in range(len(chosen))]
    read = _reader(settings)
    there = {i: part for i, path in enumerate(paths) if (part := read(path, len(chosen[i])))}
    progress.begin("clouds", n, sum(len(chosen[i]) for i in there))
    tasks = {
        workers.submit(
            seen_at, robot, settings, mine, plan["configurations"][mine], plan["starts"][mine]
        ): i
        for i, mine in enumerate(chosen)
        if i not in there
    }
    for task in as_completed(tasks):
        i = tasks[task]
        there[i] = task.result()
        save_npz(paths[i], there[i])
        progress.advance(len(chosen[i]))
    return [there[i] for i in range(len(chosen))]


def _reader(settings: CollectionSettings) -> Callable[[Path, int], Arrays | None]:
    def read(path: Path, configurations: int) -> Arrays | None:
        """What is in a part's file; None where it is not there or not whole."""
        try:
            there = load_npz(path, _MOST_BYTES)
            part = {name: there[name] for name in _OF_PART}
        except Exception:  # whatever a reader makes of bytes that are no part
            return None
        shape = (configurations, settings.starts, settings.points, 3)
        return part if part["clouds_mm"].shape == shape else None

    return read


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
