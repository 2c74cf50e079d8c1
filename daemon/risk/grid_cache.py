"""Distance grids are made once and kept: making one takes seconds, reading it does not."""

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Final

import numpy as np

from daemon.array_files import load_npz, save_npz
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import (
    COARSER,
    MOST_PLACES,
    DistanceGrid,
    distance_grid,
)
from safety.risk.surroundings.environment import Environment

USUAL_SPACING_MM: Final = 1.5
"""For a body that is as thick as a finger."""
_OF_RADIUS: Final = 0.5
_MOST_UNASKED: Final = 8_000_000
"""That are made without being asked for: within half a minute, in 32 MB."""
_COARSER: Final = 1.1

_VERSION: Final = 1
"""Of what the numbers mean: what was kept by another version is made again."""
_MOST_BYTES: Final = 1 << 33
_NUMBERS: Final = ("spacing_mm", "exact_to_mm", "margin_mm", "solid_around")


def default_cache_directory() -> Path:
    """Where grids are kept."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "tentacled" / "distance_grids"


def fitting_spacing_mm(
    environment: Environment,
    radius_mm: float,
    exact_to_mm: float,
    covering_mm: FloatArray | None = None,
    reach_mm: FloatArray | None = None,
) -> float:
    """The spacing where none is asked for: fine enough for the body, and not too many places.

    Beside an edge, surfaces of equal distance are round, and what is interpolated between corners
    is too large: for a centreline at radius r from it by h²/8r in each of two directions. With
    h = r/2 that is a sixteenth of the radius; with more, a thin body seems to touch too seldom.
    """
    spacing_mm = min(USUAL_SPACING_MM, _OF_RADIUS * radius_mm)
    size = _size_mm(environment, exact_to_mm, covering_mm)
    if reach_mm is not None:
        size = reach_mm[1] - reach_mm[0]
    while spacing_mm < USUAL_SPACING_MM and prod(size / spacing_mm) > _MOST_UNASKED:
        spacing_mm = min(USUAL_SPACING_MM, _COARSER * spacing_mm)
    return float(spacing_mm)


def is_too_large(
    environment: Environment,
    spacing_mm: float,
    exact_to_mm: float,
    covering_mm: FloatArray | None = None,
) -> bool:
    """Whether a grid of the whole mesh would have more places than any may have."""
    size = _size_mm(environment, exact_to_mm, covering_mm)
    return float(prod(size / spacing_mm + COARSER + 1.0)) > MOST_PLACES


def _size_mm(
    environment: Environment, exact_to_mm: float, covering_mm: FloatArray | None
) -> FloatArray:
    """(3,) of the whole mesh, of what is to be covered, and of a margin."""
    within = environment.vertices_mm
    if covering_mm is not None:
        within = np.concatenate([within, covering_mm])
    return np.asarray(np.ptp(within, axis=0) + 2.0 * exact_to_mm)


def cached_grid(
    environment: Environment,
    spacing_mm: float = USUAL_SPACING_MM,
    exact_to_mm: float = 20.0,
    directory: Path | None = None,
    covering_mm: FloatArray | None = None,
    reach_mm: FloatArray | None = None,
) -> DistanceGrid:
    """The grid of these surroundings, from the directory if it is there. covering_mm, reach_mm: as
    of `distance_grid`.

    A file that cannot be read is made again; a directory that cannot be written to costs only time.
    Raises EnvironmentFaultError as `distance_grid` does.
    """
    boxes = covering_mm, reach_mm
    name = f"{_key(environment, spacing_mm, exact_to_mm, boxes)}.npz"
    path = (directory or default_cache_directory()) / name
    kept = _read(path)
    if kept is not None:
        return kept
    grid = distance_grid(environment, spacing_mm, exact_to_mm, *boxes)
    _write(path, grid)
    return grid


def _key(
    environment: Environment,
    spacing_mm: float,
    exact_to_mm: float,
    boxes: Sequence[FloatArray | None],
) -> str:
    identity = f"{_VERSION} {spacing_mm!r} {exact_to_mm!r} {environment.solid_around}"
    digest = hashlib.sha256(identity.encode())
    for name, box in zip((b"", b"reach"), boxes, strict=True):
        if box is not None:
            digest.update(name + np.ascontiguousarray(box, np.float64).tobytes())
    digest.update(environment.vertices_mm.tobytes())
    digest.update(environment.triangles.tobytes())
    return digest.hexdigest()


def _read(path: Path) -> DistanceGrid | None:
    try:
        arrays = load_npz(path, _MOST_BYTES)
        spacing, exact_to, margin, around = (arrays[name].item() for name in _NUMBERS)
        values = np.ascontiguousarray(arrays["values_mm"], np.float32)
        origin = np.asarray(arrays["origin_mm"], np.float64)
    except Exception:  # whatever a reader makes of bytes that are no grid
        return None
    if values.ndim != 3 or min(values.shape) < 2 or origin.shape != (3,):
        return None
    return DistanceGrid(origin, spacing, values, exact_to, margin, bool(around))


def _write(path: Path, grid: DistanceGrid) -> None:
    """Another process may read or write the same at the same time: it is put there whole."""
    arrays = {name: getattr(grid, name) for name in (*_NUMBERS, "origin_mm", "values_mm")}
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        save_npz(path, arrays, compressed=False)
