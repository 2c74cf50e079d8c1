"""What was round the body in a recording, and what has taken its place while it went on."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import yaml
from pydantic import TypeAdapter, ValidationError

from config.control import Region
from daemon.messages import SurroundingsChanged
from daemon.recording.run_folder import ROBOT_FILE, SURROUNDINGS_FILE, SURROUNDINGS_FILES

_REGION: Final[TypeAdapter[Region]] = TypeAdapter(Region)
_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Ten times as quick where libyaml is there."""


class RecordedSurroundings(NamedTuple):
    """Of one moment of a recording until others take their place."""

    mesh: str
    """For people: which it was; empty: nobody has told."""
    file: str
    """In the run's folder, a binary STL file in the base's frame; empty: there is none."""
    lost: bool
    """Whether the recording tells of a file that is not there."""
    regions: list[Region]


def surroundings_at_first(folder: Path) -> RecordedSurroundings:
    """Of a recording that tells of none itself: what its robot file and its folder have."""
    there = (folder / SURROUNDINGS_FILE).is_file()
    risk = robot_values(folder).get("risk")
    surface = risk.get("surface") if isinstance(risk, dict) else None
    regions = surface.get("regions") if isinstance(surface, dict) else None
    file = SURROUNDINGS_FILE if there else ""
    return RecordedSurroundings("", file, False, known_regions(regions))


def surroundings_told(folder: Path, told: SurroundingsChanged) -> RecordedSurroundings:
    """What a recording says that there is from now on. A file's name never leads out of it."""
    name = Path(told.file).name
    there = Path(name).match(SURROUNDINGS_FILES) and (folder / name).is_file()
    try:
        surface = msgspec.json.decode(told.surface)
    except msgspec.DecodeError:
        surface = None
    regions = surface.get("regions") if isinstance(surface, dict) else None
    lost = told.triangles > 0 and not there
    return RecordedSurroundings(told.mesh, name if there else "", lost, known_regions(regions))


def known_regions(told: object) -> list[Region]:
    """Those of them that are regions: others cannot be drawn."""
    known = []
    for one in told if isinstance(told, Iterable) else ():
        try:
            known.append(_REGION.validate_python(one))
        except ValidationError:
            continue
    return known


def robot_values(folder: Path) -> dict[str, Any]:
    """Of a run's own robot file; empty where there is none, or it cannot be read."""
    try:
        values = yaml.load((folder / ROBOT_FILE).read_text(encoding="utf-8"), _LOADER)
    except (OSError, ValueError, yaml.YAMLError):
        return {}
    return values if isinstance(values, dict) else {}
