"""How far from anything solid each place is: distances on a grid, built once for an environment."""

from dataclasses import dataclass
from math import ceil, prod, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.distance_grid_kernels import COARSER, fill
from safety.risk.environment import Environment, EnvironmentFaultError
from safety.risk.mixture import FloatArray

_IN_SOLID_MM: Final = 10.0
"""By which the grid of a cavity is larger than the mesh: what is there touches in any case."""
_MOST_PLACES: Final = 64_000_000
_NOTHING: Final = np.empty((0, 0, 0), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class DistanceGrid:
    """Distances from the surface at the corners of cubes. Between them they are interpolated."""

    origin_mm: FloatArray
    """(3,) where the first corner is."""
    spacing_mm: float
    values_mm: NDArray[np.float32]
    """(nx, ny, nz) negative in what is solid."""
    exact_to_mm: float
    """What is farther away than this may be wrong by a little more than `error_mm`."""
    margin_mm: float
    """By which the grid is larger than the mesh."""
    solid_around: bool
    """Whether what is far outside the grid is solid."""

    @property
    def error_mm(self) -> float:
        """An interpolated distance is never wrong by more: distances have a slope of one."""
        return _error_mm(self.spacing_mm)


def distance_grid(
    environment: Environment, spacing_mm: float = 1.5, exact_to_mm: float = 20.0
) -> DistanceGrid:
    """The grid of an environment: some microseconds for each place, of which there are millions.

    exact_to_mm: more than the body's radius. Raises EnvironmentFaultError where the grid would be
    too large.
    """
    if not (spacing_mm > 0.0 and exact_to_mm > 0.0):
        raise EnvironmentFaultError(f"a grid needs a positive spacing, not {spacing_mm} mm")
    margin_mm = _IN_SOLID_MM if environment.solid_around else exact_to_mm
    lowest = environment.vertices_mm.min(axis=0) - margin_mm
    size = environment.vertices_mm.max(axis=0) + margin_mm - lowest
    coarse_mm = COARSER * spacing_mm
    cubes = [max(1, ceil(length / coarse_mm)) for length in size]
    places = prod(COARSER * count + 1 for count in cubes)
    if places > _MOST_PLACES:
        raise EnvironmentFaultError(
            f"a grid of {spacing_mm} mm has {places} places here, more than {_MOST_PLACES}: "
            "take a coarser one"
        )
    coarse = np.empty([count + 1 for count in cubes], np.float32)
    fine = np.empty([COARSER * count + 1 for count in cubes], np.float32)
    around, far = int(environment.solid_around), exact_to_mm + _error_mm(coarse_mm)
    if not (
        fill(environment.tree, lowest, coarse_mm, around, _NOTHING, far, coarse)
        and fill(environment.tree, lowest, spacing_mm, around, coarse, far, fine)
    ):
        raise EnvironmentFaultError("the surface is folded up more than any body's")
    return DistanceGrid(lowest, spacing_mm, fine, exact_to_mm, margin_mm, environment.solid_around)


def _error_mm(spacing_mm: float) -> float:
    return spacing_mm * sqrt(3.0) / 2.0
