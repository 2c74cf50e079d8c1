"""Which fields of a robot file name other files, and where these are.

`builtin:` and a name is a file that is shipped with us; all others are seen from the robot file.
"""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, NamedTuple

from config.documents.yaml_document import Location
from config.robot import Robot

BUILTIN: Final = "builtin:"


class NamedPath(NamedTuple):
    """A file, or a folder, that a robot file names."""

    location: Location
    """Of the field."""
    reference: str
    """What stands there."""
    path: Path
    is_file: bool
    """Must be there for the robot to be sound; otherwise whoever uses it looks."""


def eds_path(reference: str, robot_path: Path) -> Path:
    """The EDS file that a robot file names."""
    return shipped_or_beside(reference, "eds", robot_path)


def risk_paths(robot: Robot, robot_path: Path) -> tuple[Path, Path] | None:
    """The model of the body and the mesh that a robot file names; None: it names none."""
    settings = robot.risk
    if settings.model is None or settings.surface is None:
        return None
    return (
        shipped_or_beside(settings.model, "models", robot_path),
        shipped_or_beside(settings.surface.mesh, "surfaces", robot_path),
    )


def certificates_path(certificates: str, robot_folder: Path) -> Path:
    """The folder of the certificates for `remote.tls`. robot_folder: of the robot file."""
    return (robot_folder / certificates).absolute()


def named_paths(robot: Robot, robot_path: Path) -> Iterator[NamedPath]:
    """Everything that a robot file names and that is not in it, in the order of the file."""
    for index, axis in enumerate(robot.axes):
        eds = axis.drive.eds
        yield NamedPath(("axes", index, "drive", "eds"), eds, eds_path(eds, robot_path), True)
    settings, paths = robot.risk, risk_paths(robot, robot_path)
    if paths is not None and settings.model is not None and settings.surface is not None:
        model, mesh = paths
        yield NamedPath(("risk", "model"), settings.model, model, True)
        yield NamedPath(("risk", "surface", "mesh"), settings.surface.mesh, mesh, True)
        for index, body in enumerate(settings.surface.bodies):
            location = ("risk", "surface", "bodies", index, "mesh")
            path = shipped_or_beside(body.mesh, "surfaces", robot_path)
            yield NamedPath(location, body.mesh, path, True)
    tls = robot.remote.tls
    if tls is not None:
        folder = certificates_path(tls.certificates, robot_path.parent)
        yield NamedPath(("remote", "tls", "certificates"), tls.certificates, folder, False)


def values_with_absolute_paths(robot: Robot, robot_path: Path) -> dict[str, Any]:
    """The robot as plain values that mean the same wherever they are written."""
    values: dict[str, Any] = robot.model_dump(mode="json")
    for named in named_paths(robot, robot_path):
        if not named.reference.startswith(BUILTIN):
            place: Any = values
            for part in named.location[:-1]:
                place = place[part]
            place[named.location[-1]] = str(named.path.absolute())
    return values


def shipped_or_beside(reference: str, folder: str, robot_path: Path) -> Path:
    """A file that is shipped in one of our folders, or one beside the robot file."""
    if reference.startswith(BUILTIN):
        return Path(str(files("config") / folder / reference.removeprefix(BUILTIN)))
    return robot_path.parent / reference


def named_model(reference: str) -> Path:
    """The file of that model: a shipped one, with or without its suffix as robots are named, or one
    of whoever runs it."""
    if reference.startswith(BUILTIN):
        path = shipped_or_beside(reference, "models", Path())
        return path if path.suffix else path.with_suffix(".npz")
    return Path(reference).expanduser()


def is_shipped_model(reference: str) -> bool:
    """Whether this names one of the models that are shipped, and no way out of their folder."""
    name = reference.removeprefix(BUILTIN)
    plain = (
        reference.startswith(BUILTIN) and name not in {"", ".", ".."} and Path(name).name == name
    )
    return plain and is_file(named_model(reference))


def is_file(path: Path) -> bool:
    """Whether there is such a file. A name that is too long for one is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether there is such a folder. A name that is too long for one is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False
