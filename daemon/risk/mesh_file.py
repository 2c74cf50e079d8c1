"""Reads surroundings from mesh files and writes them: STL, OBJ, PLY."""

from pathlib import Path
from typing import Final

import numpy as np

from safety.risk.environment import (
    MM_PER,
    Environment,
    EnvironmentFaultError,
    Free,
    InsertionPort,
    Unit,
    environment,
)
from safety.risk.shapes import Mesh

SUFFIXES: Final = (".stl", ".obj", ".ply")


def read_environment(
    path: Path, free: Free | None = None, port: InsertionPort | None = None, unit: Unit = "mm"
) -> Environment:
    """The surroundings in a file, checked.

    free: on which side of the outermost surface the free space is; None: normals point into it.
    unit: what the file's numbers are. Raises EnvironmentFaultError, which names the file.
    """
    try:
        return environment(*_read(path, unit), free=free, port=port)
    except EnvironmentFaultError as error:
        raise EnvironmentFaultError(f"{path}: {error}") from None


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write a mesh in mm; the name's end says how. Raises EnvironmentFaultError, OSError."""
    from trimesh import Trimesh  # slow to come

    _check_suffix(path)
    Trimesh(mesh.vertices_mm, mesh.triangles, process=False).export(path)


def _read(path: Path, unit: Unit) -> Mesh:
    """Triangles whose corners are one where they are in one place: STL has none in common."""
    from trimesh import load_mesh  # slow to come

    try:
        _check_suffix(path)
        with path.open("rb") as file:
            loaded = load_mesh(file, file_type=path.suffix[1:].lower(), process=False)
        corners = MM_PER[unit] * np.asarray(loaded.triangles, np.float64).reshape(-1, 3)
    except OSError as error:
        raise EnvironmentFaultError(error.strerror or "cannot be read") from None
    except EnvironmentFaultError:
        raise
    except Exception as error:  # whatever a reader makes of bytes that are no mesh
        raise EnvironmentFaultError(f"is no mesh: {type(error).__name__}: {error}") from None
    if not np.isfinite(corners).all():
        number = int(np.argwhere(~np.isfinite(corners))[0, 0]) // 3
        raise EnvironmentFaultError(f"triangle {number} has a corner that is not finite")
    places, which = np.unique(corners + 0.0, axis=0, return_inverse=True)  # no −0
    faces = which.reshape(-1, 3).astype(np.int64)
    a, b, c = faces.T
    return Mesh(places, faces[(a != b) & (b != c) & (c != a)])


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise EnvironmentFaultError(f"must end with {', '.join(SUFFIXES)}")
