"""Reads surroundings from mesh files and writes them: STL, OBJ, PLY."""

import hashlib
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.array_files import in_a_line
from safety.risk.surroundings.environment import (
    MM_PER,
    Environment,
    EnvironmentFaultError,
    Free,
    InsertionPort,
    Mesh,
    Unit,
    environment,
)
from safety.risk.surroundings.regions import Region

SUFFIXES: Final = (".stl", ".obj", ".ply")
_STL_HEADER, _STL_TRIANGLE = 84, 50
"""Bytes of a binary STL file: before the triangles, the last four of them how many there are; and
of each."""
_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


def read_environment(
    path: Path, free: Free | None = None, port: InsertionPort | None = None, unit: Unit = "mm"
) -> Environment:
    """The surroundings in a file, checked.

    free: on which side of the outermost surface the free space is; None: normals point into it.
    unit: what the file's numbers are. Raises EnvironmentFaultError, which names the file.
    """
    mesh = read_mesh(path, unit)
    try:
        return environment(*mesh, free=free, port=port)
    except EnvironmentFaultError as error:
        raise error.of(path) from None


def read_mesh(path: Path, unit: Unit = "mm") -> Mesh:
    """The mesh in a file, in mm: finite, and nothing else is looked at yet.

    Raises EnvironmentFaultError, which names the file.
    """
    try:
        return _read(path, unit)
    except EnvironmentFaultError as error:
        raise error.of(path) from None


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write a mesh in mm; the name's end says how. Raises EnvironmentFaultError, OSError."""
    from trimesh import Trimesh  # slow to come

    _check_suffix(path)
    Trimesh(mesh.vertices_mm, mesh.triangles, process=False).export(path)


def binary_stl(mesh: Mesh) -> bytes:
    """The mesh as a binary STL file in mm."""
    corners = mesh.vertices_mm[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    table = np.zeros(len(corners), _TRIANGLE)
    table["corners"] = corners
    table["normal"] = normals / np.where(lengths > 0.0, lengths, 1.0)
    header = b"tentacled, mm".ljust(_STL_HEADER - 4)
    return header + len(corners).to_bytes(4, "little") + table.tobytes()


def environment_sha256(environment: Environment, regions: Sequence[Region] = ()) -> str:
    """Of what touches, wherever it was read from: triangles, their free side, the port, and the
    regions, but for their names."""
    port = environment.port
    hole = None if port is None else (port.centre_mm, port.inwards, port.radius_mm, port.depth_mm)
    digest = hashlib.sha256(f"{environment.solid_around} {hole}".encode())
    digest.update(environment.vertices_mm.tobytes())
    digest.update(environment.triangles.tobytes())
    for region in regions:
        digest.update(repr((region.shape, region.keep_in)).encode())
    return digest.hexdigest()


def _read(path: Path, unit: Unit) -> Mesh:
    """Triangles whose corners are one where they are in one place: STL has none in common."""
    try:
        _check_suffix(path)
        suffix = path.suffix[1:].lower()
        corners = MM_PER[unit] * _corners(_readable(path.read_bytes(), suffix), suffix)
    except OSError as error:
        raise EnvironmentFaultError(error.strerror or "cannot be read") from None
    except EnvironmentFaultError:
        raise
    except Exception as error:  # whatever a reader makes of bytes that are no mesh
        raise EnvironmentFaultError(f"is no mesh: {in_a_line(error)}") from None
    _check_finite(corners)
    places, which = np.unique(corners + 0.0, axis=0, return_inverse=True)  # no −0
    faces = which.reshape(-1, 3).astype(np.int64)
    a, b, c = faces.T
    return Mesh(places, faces[(a != b) & (b != c) & (c != a)])


def _corners(content: bytes, suffix: str) -> NDArray[np.float64]:
    """(3t, 3) of all triangles, one after the other, as the file has them."""
    if suffix == "stl" and _is_binary_stl(content):
        # As it is shipped. The other reader is slow to come, and brings 50 MB to stay.
        triangles = np.frombuffer(content, _TRIANGLE, offset=_STL_HEADER)
        return triangles["corners"].astype(np.float64).reshape(-1, 3)
    from trimesh import load_mesh

    loaded: Any = load_mesh(BytesIO(content), file_type=suffix, process=False)
    return np.asarray(loaded.triangles, np.float64).reshape(-1, 3)


def _is_binary_stl(content: bytes) -> bool:
    """Whether it is exactly as long as it says."""
    if len(content) < _STL_HEADER:
        return False
    said = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    return len(content) == _STL_HEADER + said * _STL_TRIANGLE


def _readable(content: bytes, suffix: str) -> bytes:
    """What a file of words says, whatever alphabet its names are in; bytes of another as they are.

    Raises EnvironmentFaultError where an STL file is not as long as it says.
    """
    if not content.strip():
        raise EnvironmentFaultError("is empty")
    if suffix == "obj":
        return content.decode("utf-8", "replace").encode()
    if suffix != "stl":
        return content
    if _is_binary_stl(content):
        return content
    if content.lstrip()[:5].lower() != b"solid" or b"\0" in content:
        raise EnvironmentFaultError(_cut_off(content), "cut_off")
    if b"endsolid" not in content.lower():
        raise EnvironmentFaultError("is cut off: there is no 'endsolid'", "cut_off")
    return content.decode("utf-8", "replace").encode()


def _cut_off(content: bytes) -> str:
    if len(content) < _STL_HEADER:
        return f"is no STL file, or is cut off: it has {len(content)} bytes"
    said = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    stored = (len(content) - _STL_HEADER) / _STL_TRIANGLE
    if stored < said:
        return f"is cut off, or no STL file: it says {said} triangles, and has {stored:.1f}"
    return f"is damaged, or no STL file: it says {said} triangles, and has room for {stored:.1f}"


def _check_finite(corners: NDArray[np.float64]) -> None:
    """corners: (3t, 3)."""
    finite = np.asarray(np.isfinite(corners).all(axis=1))
    if finite.all():
        return
    number = int(np.argmin(finite)) // 3
    others = corners[3 * number : 3 * number + 3][finite[3 * number : 3 * number + 3]]
    near = ""
    if len(others):
        near = ", near ({:.6g}, {:.6g}, {:.6g}) mm".format(*others[0])
    raise EnvironmentFaultError(
        f"triangle {number} has a corner that is not finite{near}", "not_finite"
    )


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise EnvironmentFaultError(f"must end with {', '.join(SUFFIXES)}")
