"""Regions that are drawn and not scanned: balls, boxes, capsules, cylinders, half-spaces.

Each is kept out of, or kept in. A region counts as a solid does: of the body, nothing may be where
it is kept out of, nor outside of what it is kept in. Where the nearest surface is of a region, the
distance is known in closed form; beside the mesh's it is put on the same grid, since the free space
of several is where each leaves it free, and the distance there is the least of theirs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import EnvironmentFaultError

_FARTHEST_MM: Final = 1e4
_THINNEST_MM: Final = 1e-3
_A_ROTATION: Final = 1e-6
"""By which the columns of a turned box may be off from being of length one and at right angles."""

Three = tuple[float, float, float]


class Shape(Protocol):
    """What a region has inside."""

    def distance(self, points_mm: FloatArray) -> FloatArray:
        """(…,) from its surface to each of (…, 3) points, mm; negative inside."""
        ...

    def bounds(self) -> FloatArray | None:
        """(2, 3) its lowest and highest coordinates; None: it has no end."""
        ...


@dataclass(frozen=True, slots=True)
class Ball:
    """Of a radius round a centre."""

    centre_mm: Three
    radius_mm: float

    def __post_init__(self) -> None:
        _check("ball", [self.centre_mm], self.radius_mm)

    def distance(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray(_norm(points_mm - np.array(self.centre_mm)) - self.radius_mm)

    def bounds(self) -> FloatArray:
        return np.array(self.centre_mm) + np.array([[-1.0], [1.0]]) * self.radius_mm


@dataclass(frozen=True, slots=True)
class Box:
    """With right angles; its axes are those of the base sensor's frame, or turned."""

    centre_mm: Three
    size_mm: Three
    axes: tuple[Three, Three, Three] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """Unit vectors along its edges."""

    def __post_init__(self) -> None:
        _check("box", [self.centre_mm, *self.axes], *self.size_mm)
        axes = np.array(self.axes)
        if np.abs(axes @ axes.T - np.eye(3)).max() > _A_ROTATION:
            raise EnvironmentFaultError("region: a box has three axes at right angles")

    def distance(self, points_mm: FloatArray) -> FloatArray:
        there = (points_mm - np.array(self.centre_mm)) @ np.array(self.axes).T
        beyond = np.abs(there) - 0.5 * np.array(self.size_mm)
        return np.asarray(_norm(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=-1), 0.0))

    def bounds(self) -> FloatArray:
        half = 0.5 * np.array(self.size_mm) @ np.abs(np.array(self.axes))
        return np.asarray(np.array(self.centre_mm) + np.array([[-1.0], [1.0]]) * half)


@dataclass(frozen=True, slots=True)
class Capsule:
    """All that is within a radius of a straight line from one place to another."""

    from_mm: Three
    to_mm: Three
    radius_mm: float

    def __post_init__(self) -> None:
        _check("capsule", [self.from_mm, self.to_mm], self.radius_mm)

    def distance(self, points_mm: FloatArray) -> FloatArray:
        start = np.array(self.from_mm)
        along = np.array(self.to_mm) - start
        square = float(along @ along)
        share = (points_mm - start) @ along / square if square > 0.0 else np.zeros(())
        nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
        return np.asarray(_norm(points_mm - nearest) - self.radius_mm)

    def bounds(self) -> FloatArray:
        ends = np.array([self.from_mm, self.to_mm])
        return np.array([ends.min(axis=0) - self.radius_mm, ends.max(axis=0) + self.radius_mm])


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Round a straight line from one place to another, flat at both ends."""

    from_mm: Three
    to_mm: Three
    radius_mm: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(np.subtract(self.to_mm, self.from_mm)))
        _check("cylinder", [self.from_mm, self.to_mm], self.radius_mm, length)

    def distance(self, points_mm: FloatArray) -> FloatArray:
        start = np.array(self.from_mm)
        axis = np.array(self.to_mm) - start
        length = float(np.linalg.norm(axis))
        axis = axis / length
        there = points_mm - start
        along = there @ axis
        aside = _norm(there - along[..., None] * axis) - self.radius_mm
        ends = np.abs(along - 0.5 * length) - 0.5 * length
        outside = np.hypot(np.maximum(aside, 0.0), np.maximum(ends, 0.0))
        return np.asarray(outside + np.minimum(np.maximum(aside, ends), 0.0))

    def bounds(self) -> FloatArray:
        return Capsule(self.from_mm, self.to_mm, self.radius_mm).bounds()


@dataclass(frozen=True, slots=True)
class HalfSpace:
    """All that is behind a plane."""

    point_mm: Three
    """On the plane."""
    normal: Three
    """Out of the half-space; of any length."""

    def __post_init__(self) -> None:
        _check("half-space", [self.point_mm, self.normal], float(np.linalg.norm(self.normal)))

    def distance(self, points_mm: FloatArray) -> FloatArray:
        normal = np.array(self.normal) / np.linalg.norm(self.normal)
        return np.asarray((points_mm - np.array(self.point_mm)) @ normal)

    def bounds(self) -> None:
        return None


@dataclass(frozen=True, slots=True)
class Region:
    """A shape, and which side of its surface the body keeps to."""

    shape: Shape
    keep_in: bool = False
    """Whether the body is to stay inside. Otherwise it is to stay outside."""
    name: str = ""
    """For people."""

    def clearance(self, points_mm: FloatArray) -> FloatArray:
        """(…,) from where the body must not be to each of (…, 3) points, mm; negative in it."""
        distance = self.shape.distance(points_mm)
        return -distance if self.keep_in else distance

    @property
    def has_an_end(self) -> bool:
        """Whether far away the body may be everywhere, as far as this region is concerned."""
        return not self.keep_in and self.shape.bounds() is not None


class Reach(NamedTuple):
    """Where any part of a body may be: a ball round its base."""

    base_mm: FloatArray
    """(3,)."""
    radius_mm: float
    """How far its centreline goes, its thickness, and what is left free beyond."""

    def bounds(self) -> FloatArray:
        """(2, 3) mm."""
        return self.base_mm + np.array([[-1.0], [1.0]]) * self.radius_mm


def covered(regions: Sequence[Region], reach: Reach) -> FloatArray | None:
    """(2, 3) where a grid has to know distances for these regions; None: there are none in reach.

    What has no end counts as far as the body reaches.
    """
    within = reach.bounds()
    boxes = []
    for region in regions:
        bounds = region.shape.bounds() if region.has_an_end else None
        if bounds is None:
            boxes.append(within)
            continue
        low, high = np.maximum(bounds[0], within[0]), np.minimum(bounds[1], within[1])
        if (low < high).all():
            boxes.append(np.array([low, high]))
    if not boxes:
        return None
    lows, highs = zip(*boxes, strict=True)
    return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])


def with_regions(grid: DistanceGrid, regions: Sequence[Region]) -> DistanceGrid:
    """The grid with these regions in it. It has to reach over what is `covered`.

    What is interpolated is wrong by no more than before: each of the distances has a slope of one.
    """
    if not regions:
        return grid
    values = grid.values_mm.copy()
    _, ny, nz = values.shape
    y, z = np.meshgrid(np.arange(ny), np.arange(nz), indexing="ij")
    for i, slab in enumerate(values):
        places = grid.origin_mm + grid.spacing_mm * np.stack([np.full_like(y, i), y, z], axis=-1)
        for region in regions:
            np.minimum(slab, _single(region.clearance(places)), out=slab)
    endless = not all(region.has_an_end for region in regions)
    return replace(grid, values_mm=values, solid_around=grid.solid_around or endless)


def _single(distances: FloatArray) -> NDArray[np.float32]:
    return distances.astype(np.float32)


def _norm(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def _check(kind: str, places: Sequence[Sequence[float]], *lengths: float) -> None:
    """Raises EnvironmentFaultError."""
    numbers = np.array([*(x for place in places for x in place), *lengths], np.float64)
    if any(len(place) != 3 for place in places):
        raise EnvironmentFaultError(f"region: a {kind}'s places have three numbers")
    if not np.isfinite(numbers).all() or np.abs(numbers).max() > _FARTHEST_MM:
        raise EnvironmentFaultError(
            f"region: a {kind}'s numbers must be finite, and below {_FARTHEST_MM:g} mm"
        )
    if min(lengths) < _THINNEST_MM:
        raise EnvironmentFaultError(f"region: a {kind}'s lengths must be positive")
