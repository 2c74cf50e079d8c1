"""Makes a data set of clouds that cameras have seen of a real body.

They come without centrelines: those are fitted to them, and where no body lies in a cloud, the
cloud is at fault. A cloud is a PLY file, or one array of an NPZ file. Nothing is taken over unless
all of it is right; all that is wrong is said at once. Clouds are in the base frame, as the model
will be, but for what the cameras are off: see `camera_alignment`.
"""

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.array_files import in_a_line
from daemon.host.progress import Progress
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.camera_alignment import CameraAlignment, alignment_of
from daemon.workbench.body_model.clouds.centreline_fit import (
    LEAST_POINTS,
    VisibleSurface,
    fit_centreline,
)
from daemon.workbench.body_model.clouds.cloud_dataset import BoolArray, CloudDataset, origin
from daemon.workbench.body_model.clouds.cloud_table import CloudImportError, CloudTable, read_table
from daemon.workbench.body_model.clouds.collection import FITTED, block_of
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.environment import MM_PER, Unit

_ARRAY: Final = "points"


class CloudFileError(ValueError):
    """No cloud. Says what is wrong with the file."""


def read_cloud(path: Path, unit: Unit) -> FloatArray:
    """(n, 3) points in mm. An NPZ file holds one array, or one of the name `points`.

    Raises CloudFileError, which does not name the file.
    """
    try:
        read = _from_ply if path.suffix.lower() == ".ply" else _from_npz
        points = read(path)
    except OSError as error:
        raise CloudFileError(error.strerror or "cannot be read") from None
    except CloudFileError:
        raise
    except Exception as error:  # whatever a reader makes of bytes that are no cloud
        raise CloudFileError(f"is no cloud: {in_a_line(error)}") from None
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise CloudFileError(f"must be (n, 3) numbers; it is {points.shape} of {points.dtype}")
    bad = np.count_nonzero(~np.isfinite(points).all(axis=1))
    if bad:
        raise CloudFileError(f"{bad} of {len(points)} points are not finite")
    return np.asarray(points, np.float64) * MM_PER[unit]


def _from_ply(path: Path) -> NDArray[Any]:
    from trimesh import load  # slow to come

    with path.open("rb") as file:
        loaded: Any = load(file, file_type="ply", process=False)
    return np.asarray(loaded.vertices)


def _from_npz(path: Path) -> NDArray[Any]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
        if _ARRAY in content.files:
            return np.asarray(content[_ARRAY])
        if len(content.files) == 1:
            return np.asarray(content[content.files[0]])
        names = ", ".join(content.files) or "none"
        raise CloudFileError(f"which of its arrays? Name one {_ARRAY!r}; there are: {names}")


SingleArray = NDArray[np.float32]
T = TypeVar("T")

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
    """cloud_mm: (p, 3). digest: of all points that were in the file."""

    cloud_mm: SingleArray
    digest: bytes


@dataclass(frozen=True, eq=False)
class Fitted:
    """nodes_mm: (nodes, 3)."""

    nodes_mm: SingleArray
    miss_mm: float


def surface_of(robot: Robot) -> tuple[VisibleSurface, float] | None:
    """What is seen of a robot's emulated body, and the radius of what may touch."""
    if robot.emulation is None:
        return None
    plant = robot.emulation.plant
    return VisibleSurface.of(plant, np.zeros(len(robot.axes))), plant.body_radius_mm


def import_clouds(
    robot: Robot, folder: Path, settings: ImportSettings, workers: Executor, progress: Progress
) -> CloudDataset:
    """Raises CloudImportError with all that is wrong; CloudDatasetError."""
    table = read_table(folder, AxisRanges.of(robot))
    files = _files(table)
    clouds = _all_read(files, folder, settings, workers, progress)
    n, s = len(table.files), len(table.files[0])
    surfaces = [
        surface for u in table.configurations for surface in [_surface_at(robot, settings, u)] * s
    ]
    alignment = _alignment(clouds, folder, surfaces)
    clouds = (clouds + alignment.shift_mm).astype(np.float32)
    fitted = _all_fitted(clouds, files, folder, surfaces, workers, progress)
    m = table.configurations.shape[1]
    unknown = [name for name, column in (("starts", table.starts),) if column is None]
    arrays: dict[str, NDArray[Any]] = {
        "configurations": table.configurations,
        "starts": np.repeat(table.configurations[:, None], s, axis=1)
        if table.starts is None
        else table.starts,
        "clouds_mm": clouds.reshape(n, s, settings.points, 3),
        "centrelines_mm": np.reshape([one.nodes_mm for one in fitted], (n, s, _NODES, 3)),
        "fit_error_mm": alignment.fit_error_mm,
        "forces": np.zeros((n, s, m), np.float32),
        "test": _tests(n, settings.seed) if table.test is None else table.test,
        "block": block_of(table.configurations),
        "radius_mm": np.array(settings.radius_mm),
    }
    how = asdict(settings)
    load_g, seen_on = how.pop("tip_load_g"), how.pop("seen_on")
    provenance = {
        **origin(robot),
        "centrelines": FITTED,
        "clouds_moved_by_mm": alignment.shift_mm.round(4).tolist(),
        "tip_load_g": load_g,
        **({} if seen_on is None else {"seen_on": seen_on}),
        "imported": {
            **how,
            "not_known": [*unknown, "forces"],
            "miss_mm": float(np.median([one.miss_mm for one in fitted])),
        },
    }
    return CloudDataset.checked(arrays, provenance)


def _surface_at(robot: Robot, settings: ImportSettings, u: FloatArray) -> VisibleSurface:
    """With the axes at (m,) u. The settings' is that with all axes at zero: how much longer or
    shorter a body is that its axes push out, and where it begins, its emulation says."""
    surface = settings.surface
    if robot.emulation is None:
        return surface
    plant = robot.emulation.plant
    rest, there = plant.extent([0.0] * len(u)), plant.extent(u.tolist())
    return replace(
        surface,
        length_mm=surface.length_mm + there.length_mm - rest.length_mm,
        begin_mm=there.begin_mm,
        stretch=there.stretch,
    )


def read_all(files: Sequence[tuple[Path, int]], settings: ImportSettings) -> list[ReadCloud | str]:
    """Some of them, in one process. Each, or what is wrong with it."""
    return [_read(path, number, settings) for path, number in files]


def _read(path: Path, number: int, settings: ImportSettings) -> ReadCloud | str:
    """number: of its row: with the seed it decides which points are kept."""
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
    return ReadCloud(some.astype(np.float32), digest)


def fit_all(clouds_mm: SingleArray, surfaces: Sequence[VisibleSurface]) -> list[Fitted | str]:
    """(k, p, 3) of them, in one process. Each, or what is wrong with it."""
    return [_fit(cloud, surface) for cloud, surface in zip(clouds_mm, surfaces, strict=True)]


def _fit(cloud_mm: SingleArray, surface: VisibleSurface) -> Fitted | str:
    fit = fit_centreline(cloud_mm, surface, _NODES)
    if fit.doubt:
        return (
            f"no body of {surface.length_mm:g} mm lies in it: {fit.doubt}. Look at the unit, the "
            "frame, the body's length and radii"
        )
    return Fitted(fit.nodes_mm.astype(np.float32), fit.miss_mm)


def _files(table: CloudTable) -> list[tuple[Path, int]]:
    """Their paths and the numbers of their rows, in the table's order."""
    paths = [path for visits in table.files for path in visits]
    numbers = [number for visits in table.rows for number in visits]
    return list(zip(paths, numbers, strict=True))


def _all_read(
    files: list[tuple[Path, int]],
    folder: Path,
    settings: ImportSettings,
    workers: Executor,
    progress: Progress,
) -> SingleArray:
    """(k, p, 3) clouds in the table's order. Raises CloudImportError."""
    progress.begin("clouds", len(files), 0)
    parts = [files[begin : begin + _PART] for begin in range(0, len(files), _PART)]
    found = _in_order([workers.submit(read_all, part, settings) for part in parts], progress)
    faults, seen = [], dict[bytes, Path]()
    read = []
    for (path, number), one in zip(files, found, strict=True):
        if isinstance(one, str):
            faults.append((number, f"{path.name}: {one}"))
        elif one.digest in seen:
            faults.append((number, f"{path.name}: is the same cloud as {seen[one.digest].name}"))
        else:
            seen[one.digest] = path
            read.append(one.cloud_mm)
    _refuse(faults, folder)
    return np.array(read)


def _all_fitted(
    clouds_mm: SingleArray,
    files: list[tuple[Path, int]],
    folder: Path,
    surfaces: Sequence[VisibleSurface],
    workers: Executor,
    progress: Progress,
) -> list[Fitted]:
    """Raises CloudImportError."""
    progress.begin("centrelines", len(files), 0)
    parts = [slice(begin, begin + _PART) for begin in range(0, len(files), _PART)]
    tasks = [workers.submit(fit_all, clouds_mm[part], surfaces[part]) for part in parts]
    found = _in_order(tasks, progress)
    told = zip(files, found, strict=True)
    _refuse([(n, f"{path.name}: {one}") for (path, n), one in told if isinstance(one, str)], folder)
    return [one for one in found if not isinstance(one, str)]


def _in_order(tasks: list[Future[list[T]]], progress: Progress) -> list[T]:
    for task in as_completed(tasks):
        progress.advance(len(task.result()))
    return [one for task in tasks for one in task.result()]


def _refuse(faults: list[tuple[int, str]], folder: Path) -> None:
    if faults:
        raise CloudImportError(folder, [f"line {n}: {what}" for n, what in sorted(faults)])


def _alignment(
    clouds_mm: SingleArray, folder: Path, surfaces: Sequence[VisibleSurface]
) -> CameraAlignment:
    """Raises CloudImportError."""
    found = alignment_of(clouds_mm, surfaces, _NODES)
    if found is None:
        # Every one will be told by its own row.
        return CameraAlignment(np.zeros(3), np.zeros(_NODES), 0)
    if found.doubt:
        raise CloudImportError(folder, [found.doubt])
    return found


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
