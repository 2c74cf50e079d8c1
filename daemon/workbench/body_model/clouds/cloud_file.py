"""Reads what a camera has seen: points in a PLY file, or one array of an NPZ file."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.array_files import in_a_line
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
