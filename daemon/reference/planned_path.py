"""Path files as `tentacled plan` writes them: read, written, and whether they are this robot's."""

import json
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from config.documents.schema_errors import schema_problems
from config.documents.yaml_document import YamlDocument
from config.robot import Robot
from config.tasks.planned_path import PlannedPath
from daemon.files import read_regular, write_whole

_MOST_BYTES: Final = 1 << 25
_PROBLEMS_TOLD: Final = 5


class PlannedPathError(ValueError):
    """A file that is no path. Names it, and what is wrong."""


def read_path(path: Path) -> PlannedPath:
    """What a path file holds. Raises PlannedPathError."""
    try:
        value: Any = json.loads(read_regular(path, _MOST_BYTES))
    except OSError as error:
        raise PlannedPathError(f"{path}: {error.strerror or error}") from None
    except (ValueError, RecursionError):
        raise PlannedPathError(f"{path}: is no JSON: plan it with `tentacled plan`") from None
    if not isinstance(value, dict):
        raise PlannedPathError(f"{path}: is no path: plan it with `tentacled plan`")
    try:
        return PlannedPath.model_validate(value)
    except ValidationError as error:
        found = schema_problems(YamlDocument(str(path), value), PlannedPath, error)
        told = [f"{path}: {one.key_path}: {one.message}" for one in found[:_PROBLEMS_TOLD]]
        more = len(found) - len(told)
        raise PlannedPathError(
            "\n".join([*told, *([f"... and {more} more"] if more else [])])
        ) from None


def write_path(path: Path, planned: PlannedPath) -> None:
    """Write it whole, or not at all. Raises OSError."""
    text = json.dumps(planned.model_dump(mode="json"), separators=(",", ":"))
    write_whole(path, (text + "\n").encode())


def misfit(
    planned: PlannedPath, robot: Robot, model_sha256: str | None, surroundings_sha256: str | None
) -> tuple[str, str] | None:
    """Why a path is not for this robot: a name for it, and words. None: it is.

    model_sha256, surroundings_sha256: of what the robot's gate asks with; None: it asks nobody.
    """
    axes = tuple(axis.name for axis in robot.axes)
    if planned.robot != robot.robot or planned.axes != axes:
        return "wrong_robot", f"the path is of the robot {planned.robot}, and this is {robot.robot}"
    again = "plan it anew with this robot's file (`tentacled plan`)"
    if model_sha256 is None:
        return (
            "other_model",
            f"the path was planned with a model of the body, and none is in use; {again}",
        )
    if planned.model_sha256 != model_sha256:
        return (
            "other_model",
            f"the path was planned with another model of the body ({planned.model_sha256[:12]}, "
            f"and this robot's is {model_sha256[:12]}): it would lead the body elsewhere; {again}",
        )
    if planned.surroundings_sha256 != surroundings_sha256:
        return (
            "other_surroundings",
            f"the path was planned among other surroundings ({planned.surroundings_sha256[:12]}, "
            f"and these are {(surroundings_sha256 or '')[:12]}); {again}",
        )
    return None
