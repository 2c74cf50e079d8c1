"""Surroundings prepared in a process of their own: `python -m daemon.risk.preparation`.

To check a mesh and to work out its distances takes seconds in which Python itself is held, and so a
thread would hold the control loop. The process leaves what it has made in a folder, as arrays that
are mapped into memory and not read: to take them over costs the loop nothing.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from config.control import Surface
from daemon.host.processes import answer_apart, serve_apart
from daemon.risk.surroundings import (
    BodySize,
    RiskSurroundings,
    check_way_in,
    read_surroundings,
    region_of,
)
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import (
    Environment,
    EnvironmentFaultError,
    InsertionPort,
)
from safety.risk.surroundings.triangle_tree_kernels import TriangleTree

MOST_TRIANGLES: Final = 300_000
"""Of all meshes together. A segmented chest cavity has 50 000 to 200 000; of 300 000, checks and
distances take some ten seconds."""
_WITHIN_S: Final = 120.0
_TREE: Final = ("boxes", "links", "corners", "order")


class Request(msgspec.Struct, frozen=True):
    """What is to be prepared."""

    surface: dict[str, Any]
    size: BodySize
    robot_path: str
    folder: str
    """Where what is made is left."""


class Outcome(msgspec.Struct, frozen=True):
    """Numbers beside the arrays; or why there are none."""

    fault: str = ""
    """Name of what is wrong; empty: nothing."""
    text: str = ""
    sha256: str = ""
    cavity: bool = False
    """Whether what is far away from the meshes is solid."""
    spacing_mm: float = 0.0
    exact_to_mm: float = 0.0
    margin_mm: float = 0.0
    solid_around: bool = False
    """Whether what is far outside the grid is solid."""


def prepare_here(surface: Surface, size: BodySize, robot_path: Path) -> RiskSurroundings:
    """In this process, which stands still meanwhile. Raises EnvironmentFaultError."""
    around = read_surroundings(surface, robot_path, size, MOST_TRIANGLES)
    check_way_in(around, size)
    return around


def prepare_apart(
    surface: Surface, size: BodySize, robot_path: Path, folder: Path
) -> RiskSurroundings:
    """In another process. Blocks: call it in a thread. folder: of these surroundings alone, to be
    kept while they are used. Raises EnvironmentFaultError, ApartError, OSError."""
    request = Request(
        surface.model_dump(mode="json"), size, str(robot_path.absolute()), str(folder)
    )
    answer = answer_apart(__name__, msgspec.json.encode(request), _WITHIN_S)
    outcome = msgspec.json.decode(answer, type=Outcome)
    if outcome.fault:
        raise EnvironmentFaultError(outcome.text, outcome.fault)
    return _taken_over(surface, outcome, folder)


def _answer(content: bytes) -> bytes:
    request = msgspec.json.decode(content, type=Request)
    try:
        surface = Surface.model_validate_json(msgspec.json.encode(request.surface))
        around = prepare_here(surface, request.size, Path(request.robot_path))
    except EnvironmentFaultError as error:
        return msgspec.json.encode(Outcome(error.name, str(error)))
    return msgspec.json.encode(_left(around, Path(request.folder)))


def _left(around: RiskSurroundings, folder: Path) -> Outcome:
    made, grid = around.environment, around.grid
    arrays: Mapping[str, NDArray[Any]] = {
        "vertices_mm": made.vertices_mm,
        "triangles": made.triangles,
        **made.tree._asdict(),
        "origin_mm": grid.origin_mm,
        "values_mm": grid.values_mm,
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", np.ascontiguousarray(array), allow_pickle=False)
    return Outcome(
        sha256=around.sha256,
        cavity=made.solid_around,
        spacing_mm=grid.spacing_mm,
        exact_to_mm=grid.exact_to_mm,
        margin_mm=grid.margin_mm,
        solid_around=grid.solid_around,
    )


def _taken_over(surface: Surface, outcome: Outcome, folder: Path) -> RiskSurroundings:
    def array(name: str) -> NDArray[Any]:
        # Copied on being written to: compiled code is made for arrays that may be.
        mapped = np.load(folder / f"{name}.npy", mmap_mode="c", allow_pickle=False)
        return np.asarray(mapped)

    port = surface.port
    hole = None
    if port is not None:
        hole = InsertionPort(port.centre_mm, port.inwards, port.radius_mm, port.depth_mm)
    made = Environment(
        array("vertices_mm"),
        array("triangles"),
        TriangleTree(*(array(name) for name in _TREE)),
        outcome.cavity,
        hole,
    )
    grid = DistanceGrid(
        array("origin_mm"),
        outcome.spacing_mm,
        array("values_mm"),
        outcome.exact_to_mm,
        outcome.margin_mm,
        outcome.solid_around,
    )
    regions = tuple(region_of(one) for one in surface.regions)
    return RiskSurroundings(surface, made, regions, grid, outcome.sha256)


if __name__ == "__main__":
    serve_apart(_answer)
