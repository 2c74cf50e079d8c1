"""What is round a body, from what a robot file or a message says of it: meshes, regions, a grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import hypot
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from config.control import (
    BallRegion,
    BoxRegion,
    CapsuleRegion,
    CylinderRegion,
    HalfSpaceRegion,
    PlacedMesh,
    Surface,
)
from config.control import Region as RegionSettings
from config.paths import BUILTIN, shipped_or_beside
from daemon.risk.grid_cache import (
    USUAL_SPACING_MM,
    cached_grid,
    fitting_spacing_mm,
    is_too_large,
)
from daemon.risk.mesh_file import environment_sha256, read_mesh
from drivers.pose import turned
from safety.risk.model.mixture import FloatArray
from safety.risk.model.risk_model import RiskModel
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import (
    Environment,
    EnvironmentFaultError,
    InsertionPort,
    Mesh,
    environment,
)
from safety.risk.surroundings.regions import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Reach,
    Region,
    Shape,
    Three,
    covered,
    with_regions,
)

MARGIN_MM: Final = 10.0
"""Beyond the body's radius, to which the grid of distances is exact."""


class BodySize(NamedTuple):
    """What the surroundings have to know of a body."""

    thickest_mm: float
    thinnest_mm: float
    base_mm: tuple[float, ...]
    """(3,)."""
    farthest_mm: float
    """How far the centreline goes from there."""

    @classmethod
    def of(cls, model: RiskModel) -> "BodySize":
        """base_mm: as the basis has the first node."""
        basis = model.basis
        base = tuple(float(x) for x in basis.base_mm[0])
        return cls(basis.thickest_mm, float(basis.radius_mm.min()), base, _farthest_mm(model))

    @property
    def margin_mm(self) -> float:
        """To which distances have to be exact."""
        return self.thickest_mm + MARGIN_MM

    @property
    def reach(self) -> Reach:
        """Where any part of it may be."""
        return Reach(np.array(self.base_mm), self.farthest_mm + self.margin_mm)


@lru_cache(maxsize=4)
def _farthest_mm(model: RiskModel) -> float:
    """How far any part of the centreline is from the base, of the mean shapes where the model was
    trained; no less than the arc's length. That is a mean: tubes that are drawn out, and silicone
    that is blown up, are longer, by a fifth. Takes tenths of a second once for each model."""
    basis = model.basis
    mixtures = [mixture for u in model.known if (mixture := model.shapes.mixture(u)) is not None]
    means = np.array([mixture.weights @ mixture.means_mm for mixture in mixtures])
    away = np.tensordot(means.reshape(-1, basis.coefficients), basis.modes, axes=1)
    away += basis.base_mm - basis.base_mm[0]
    return float(np.linalg.norm(away, axis=2).max(initial=float(basis.arc_mm[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class RiskSurroundings:
    """Checked, and ready for questions."""

    surface: Surface
    """What they were made from."""
    environment: Environment
    """All meshes as one."""
    regions: tuple[Region, ...]
    grid: DistanceGrid
    """Of meshes and regions."""
    sha256: str
    """Of what counts: triangles, their free side, the port, and the regions."""

    @property
    def mesh(self) -> Mesh:
        """All meshes, normals out of what is solid."""
        return Mesh(self.environment.vertices_mm, self.environment.triangles)

    @property
    def name(self) -> str:
        """Of the first mesh, and how much there is besides."""
        more = [
            f"{len(what)} {word}{'' if len(what) == 1 else plural}"
            for what, word, plural in (
                (self.surface.bodies, "more mesh", "es"),
                (self.regions, "region", "s"),
            )
            if what
        ]
        return " and ".join([Path(self.surface.mesh.removeprefix(BUILTIN)).name, *more])


def read_surroundings(
    surface: Surface, robot_path: Path, size: BodySize, most_triangles: int | None = None
) -> RiskSurroundings:
    """Read, check and prepare: seconds, where the grid has to be made first.

    robot_path: from where relative paths are seen. most_triangles: of all meshes together; None:
    as many as there are. Raises EnvironmentFaultError.
    """
    regions = tuple(region_of(one) for one in surface.regions)
    meshes = [_placed(one, robot_path) for one in (surface, *surface.bodies)]
    count = sum(len(mesh.triangles) for mesh in meshes)
    if most_triangles is not None and count > most_triangles:
        raise EnvironmentFaultError(
            f"{count} triangles are more than {most_triangles}: take most of them out, say with "
            "Decimate in Blender",
            "too_many_triangles",
        )
    made = _checked(surface, meshes, robot_path)
    wanted = None if made.solid_around else covered(regions, size.reach)
    usual_mm = surface.grid_mm or USUAL_SPACING_MM
    reach = size.reach.bounds() if is_too_large(made, usual_mm, size.margin_mm, wanted) else None
    spacing_mm = surface.grid_mm or fitting_spacing_mm(
        made, size.thinnest_mm, size.margin_mm, wanted, reach
    )
    grid = cached_grid(made, spacing_mm, size.margin_mm, covering_mm=wanted, reach_mm=reach)
    sha256 = environment_sha256(made, regions)
    return RiskSurroundings(surface, made, regions, with_regions(grid, regions), sha256)


def region_of(settings: RegionSettings) -> Region:
    """Raises EnvironmentFaultError."""
    return Region(_shape(settings), settings.keep == "in", settings.name)


def _shape(settings: RegionSettings) -> Shape:
    match settings:
        case BallRegion():
            return Ball(settings.centre_mm, settings.radius_mm)
        case BoxRegion():
            return Box(settings.centre_mm, settings.size_mm, _axes(settings.turned))
        case CapsuleRegion():
            return Capsule(settings.from_mm, settings.to_mm, settings.radius_mm)
        case CylinderRegion():
            return Cylinder(settings.from_mm, settings.to_mm, settings.radius_mm)
        case HalfSpaceRegion():
            return HalfSpace(settings.point_mm, settings.normal)


def _axes(quaternion: Sequence[float]) -> tuple[Three, Three, Three]:
    """Where a rotation of any length has x, y and z."""
    length = hypot(*quaternion)
    unit = [part / length for part in quaternion]
    x, y, z = (turned(unit, edge) for edge in np.eye(3).tolist())
    return x, y, z


def _placed(one: PlacedMesh, robot_path: Path) -> Mesh:
    """In the base sensor's frame. Raises EnvironmentFaultError, which names the file."""
    read = read_mesh(shipped_or_beside(one.mesh, "surfaces", robot_path), one.unit)
    if one.turned == (1.0, 0.0, 0.0, 0.0) and not any(one.at_mm):
        return read
    return Mesh(
        read.vertices_mm @ np.array(_axes(one.turned)) + np.array(one.at_mm), read.triangles
    )


def _checked(surface: Surface, meshes: Sequence[Mesh], robot_path: Path) -> Environment:
    port, hole = surface.port, None
    before = np.cumsum([0, *(len(mesh.vertices_mm) for mesh in meshes)])
    try:
        if port is not None:
            hole = InsertionPort(port.centre_mm, port.inwards, port.radius_mm, port.depth_mm)
        return environment(
            np.concatenate([mesh.vertices_mm for mesh in meshes]),
            np.concatenate(
                [mesh.triangles + first for mesh, first in zip(meshes, before[:-1], strict=True)]
            ),
            free=surface.free,
            port=hole,
        )
    except EnvironmentFaultError as error:
        paths = [
            str(shipped_or_beside(one.mesh, "surfaces", robot_path))
            for one in (surface, *surface.bodies)
        ]
        raise error.of(", ".join(paths)) from None


def check_way_in(around: RiskSurroundings, size: BodySize) -> None:
    """Raises EnvironmentFaultError where the body's own base is in something solid, and no port
    leads there."""
    base, port = np.array(size.base_mm), around.environment.port
    if port is not None:
        inwards = np.array(port.inwards) / np.linalg.norm(port.inwards)
        off = base - np.array(port.centre_mm)
        along = float(off @ inwards)
        aside = float(np.linalg.norm(off - along * inwards))
        if along <= port.depth_mm and aside <= port.radius_mm:
            return
    clear_mm = _clear_mm(around.grid, base)
    if clear_mm < size.thinnest_mm:
        x, y, z = (round(number, 1) + 0.0 for number in size.base_mm)  # no −0
        room = f"{clear_mm:.1f} mm of room" if clear_mm > 0.0 else "no room"
        why = "and there is no port" if port is None else "outside the port"
        turned = ""
        if clear_mm < 0.0 and around.surface.free is None:
            side = "outside" if around.environment.solid_around else "inside"
            turned = f", or say that it is free {side}, if its normals point the wrong way"
        raise EnvironmentFaultError(
            f"no way in: the body's base at ({x:g}, {y:g}, {z:g}) mm has {room} and is "
            f"{size.thinnest_mm:.1f} mm thick, {why}: declare one where the body comes in{turned}",
            "sealed_port",
        )


def _clear_mm(grid: DistanceGrid, place_mm: FloatArray) -> float:
    """How far a (3,) place is from anything solid, as the nearest corner of the grid has it."""
    at = np.rint((place_mm - grid.origin_mm) / grid.spacing_mm).astype(np.int64)
    if (at < 0).any() or (at >= grid.values_mm.shape).any():
        return -np.inf if grid.solid_around else np.inf
    return float(grid.values_mm[tuple(at)])
