"""Makes a data set of clouds that cameras have seen of a real body.

They come without centrelines: those are fitted to them, and where no body lies in a cloud, the
cloud is at fault. Nothing is taken over unless all of it is right; all that is wrong is said at
once. Clouds are in the base frame, as the model will be.
"""

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.array_files import whose
from daemon.host.progress import Progress
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.centreline_fit import (
    LEAST_POINTS,
    VisibleSurface,
    fit_centreline,
)
from daemon.workbench.body_model.clouds.cloud_dataset import BoolArray, CloudDataset
from daemon.workbench.body_model.clouds.cloud_file import CloudFileError, read_cloud
from daemon.workbench.body_model.clouds.cloud_table import CloudImportError, CloudTable, read_table
from daemon.workbench.body_model.clouds.collection import FITTED, block_of
from safety.risk.environment import Unit

SingleArray = NDArray[np.float32]

_NODES: Final = 21
_TEST_SHARE: Final = 0.1
_AWAY: Final = 1.6
"""Times the body's length, from the base: nothing of it is there, even if it has stretched."""
_STRAY: Final = 0.02
"""Of a cloud may be there, and is left out: pixels that were matched wrongly."""
_PART: Final = 16
"""Clouds in a task."""
_SPLIT, _SOME = range(2)
"""Of the seeds."""


@dataclass(frozen=True)
class ImportSettings:
    """What is to be known of clouds beside the clouds."""

    surface: VisibleSurface
    radius_mm: float
    """Of what may touch."""
    unit: Unit = "mm"
    points: int = 256
    """Kept of each cloud, by chance."""
    seed: int = 1
    tip_load_g: float = 0.0
    """What hung at the tip."""
    seen_on: str | None = None
    """The day, as 2026-11-21; None: not known."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.tip_load_g < np.inf:
            raise ValueError("a load at the tip is not below zero")
        if self.seen_on is not None and not _is_day(self.seen_on):
            raise ValueError(f"{self.seen_on!r} is no day, such as 2026-11-21")
        if not 0.0 < self.radius_mm < np.inf:
            raise ValueError("the radius of a body must be positive")
        if self.points < LEAST_POINTS:
            raise ValueError(f"of a cloud, {LEAST_POINTS} points are kept, or more")
        if self.seed < 0:
            raise ValueError("a seed is not below 0")


@dataclass(frozen=True, eq=False)
class ReadCloud:
    """cloud_mm: (p, 3); centreline_mm: (nodes, 3). digest: of all points that were in the file."""

    cloud_mm: SingleArray
    centreline_mm: SingleArray
    miss_mm: float
    digest: bytes


def surface_of(robot: Robot) -> tuple[VisibleSurface, float] | None:
    """What is seen of a robot's emulated body, and the radius of what may touch."""
    if robot.emulation is None:
        return None
    plant = robot.emulation.plant
    return VisibleSurface.of(plant), plant.body_radius_mm


def import_clouds(
    robot: Robot, folder: Path, settings: ImportSettings, workers: Executor, progress: Progress
) -> CloudDataset:
    """Raises CloudImportError with all that is wrong; CloudDatasetError."""
    table = read_table(folder, AxisRanges.of(robot))
    read = _all_read(table, folder, settings, workers, progress)
    n, s = len(table.files), len(table.files[0])
    m = table.configurations.shape[1]
    unknown = [name for name, column in (("starts", table.starts),) if column is None]
    arrays = {
        "configurations": table.configurations,
        "starts": np.repeat(table.configurations[:, None], s, axis=1)
        if table.starts is None
        else table.starts,
        "clouds_mm": np.reshape([one.cloud_mm for one in read], (n, s, settings.points, 3)),
        "centrelines_mm": np.reshape([one.centreline_mm for one in read], (n, s, _NODES, 3)),
        "forces": np.zeros((n, s, m), np.float32),
        "test": _tests(n, settings.seed) if table.test is None else table.test,
        "block": block_of(table.configurations),
        "radius_mm": np.array(settings.radius_mm),
    }
    how = asdict(settings)
    load_g, seen_on = how.pop("tip_load_g"), how.pop("seen_on")
    provenance = {
        **whose(robot),
        "centrelines": FITTED,
        "tip_load_g": load_g,
        **({} if seen_on is None else {"seen_on": seen_on}),
        "imported": {
            **how,
            "not_known": [*unknown, "forces"],
            "miss_mm": float(np.median([one.miss_mm for one in read])),
        },
    }
    return CloudDataset.checked(arrays, provenance)


def read_and_fit(path: Path, number: int, settings: ImportSettings) -> ReadCloud | str:
    """One cloud; or what is wrong with it.

    number: of its row: with the seed it decides which points are kept.
    """
    try:
        points = read_cloud(path, settings.unit)
    except CloudFileError as error:
        return str(error)
    digest = hashlib.sha256(points.tobytes()).digest()
    length_mm = settings.surface.length_mm
    away = np.linalg.norm(points, axis=1) > _AWAY * length_mm
    if (stray := np.count_nonzero(away)) > _STRAY * len(points):
        return (
            f"{stray} of {len(points)} points are more than {_AWAY * length_mm:.0f} mm from the "
            "base, where no body reaches: look at the unit, and whether it is in the base frame"
        )
    points = points[~away]
    if len(points) < settings.points:
        return f"{len(points)} points, and {settings.points} are wanted"
    random = np.random.default_rng([settings.seed, _SOME, number])
    some = points[random.choice(len(points), settings.points, replace=False)]
    fit = fit_centreline(some, settings.surface, _NODES)
    if fit.doubt:
        return (
            f"no body of {length_mm:g} mm lies in it: {fit.doubt}. Look at the unit, the frame, "
            "the body's length and radii"
        )
    return ReadCloud(some.astype(np.float32), fit.nodes_mm.astype(np.float32), fit.miss_mm, digest)


def read_and_fit_all(
    files: Sequence[tuple[Path, int]], settings: ImportSettings
) -> list[ReadCloud | str]:
    """Some of them, in one process."""
    return [read_and_fit(path, number, settings) for path, number in files]


def _all_read(
    table: CloudTable,
    folder: Path,
    settings: ImportSettings,
    workers: Executor,
    progress: Progress,
) -> list[ReadCloud]:
    """All clouds in the table's order. Raises CloudImportError."""
    paths = [path for visits in table.files for path in visits]
    numbers = [number for visits in table.rows for number in visits]
    files = list(zip(paths, numbers, strict=True))
    progress.begin("clouds", len(files), 0)
    parts = [files[begin : begin + _PART] for begin in range(0, len(files), _PART)]
    tasks = {workers.submit(read_and_fit_all, part, settings): i for i, part in enumerate(parts)}
    for task in as_completed(tasks):
        progress.advance(len(parts[tasks[task]]))
    found = [one for task in tasks for one in task.result()]
    faults, seen = [], dict[bytes, Path]()
    read = []
    for (path, number), one in zip(files, found, strict=True):
        if isinstance(one, str):
            faults.append((number, f"{path.name}: {one}"))
        elif one.digest in seen:
            faults.append((number, f"{path.name}: is the same cloud as {seen[one.digest].name}"))
        else:
            seen[one.digest] = path
            read.append(one)
    if faults:
        raise CloudImportError(folder, [f"line {n}: {what}" for n, what in sorted(faults)])
    return read


def _tests(n: int, seed: int) -> BoolArray:
    """(n,) a tenth by chance, one at least."""
    test = np.zeros(n, np.bool_)
    random = np.random.default_rng([seed, _SPLIT])
    test[random.permutation(n)[: max(1, round(_TEST_SHARE * n))]] = True
    return test


def _is_day(text: str) -> bool:
    try:
        return str(np.datetime64(text, "D")) == text
    except ValueError:
        return False
