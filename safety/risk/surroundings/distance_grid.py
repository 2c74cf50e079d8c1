"""How far from anything solid each place is: distances on a grid, built once for an environment."""

from dataclasses import dataclass
from math import ceil, prod, sqrt
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.environment import Environment, EnvironmentFaultError

# Signed distances on a grid, compiled.
#
# Every function that is cached on disk stands in this one file: numba notices a change only in
# the file of the cached function itself.


_DEEPEST = 96
"""Of any tree."""
COARSER = 4
_MOST_CROSSINGS = 4096
_BESIDE = (1.9e-6, 3.1e-6)
"""Share of the spacing by which lines are moved aside, so that they miss a mesh's own straight
lines."""

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_kernel
def fill(tree, origin, spacing, around, coarse, far, values):  # type: ignore[no-untyped-def]
    """Write (nx, ny, nz) distances in mm, negative in what is solid.

    around: 1 where what is far away is solid, else 0. coarse: the same grid with COARSER times the
    spacing, or nothing: where it says more than `far`, what it says is taken, because most of the
    time would go there. Returns False where a line crosses the surface more often than any mesh
    should.
    """
    nx, ny, nz = values.shape
    point = np.empty(3)
    nodes, keys = np.empty(_DEEPEST, np.int64), np.empty(_DEEPEST)
    heights, ways = np.empty(_MOST_CROSSINGS), np.empty(_MOST_CROSSINGS, np.int64)
    last = 0
    for i in range(nx):
        point[0] = origin[0] + i * spacing
        for step in range(ny):
            j = step if i % 2 == 0 else ny - 1 - step  # as a plough goes: each point by the last
            point[1] = origin[1] + j * spacing
            x, y = point[0] + _BESIDE[0] * spacing, point[1] + _BESIDE[1] * spacing
            count = _crossings(tree, x, y, nodes, heights, ways)
            if count < 0:
                return False
            for up in range(nz):
                k = up if step % 2 == 0 else nz - 1 - up
                if coarse.size > 0:
                    roughly = _between(coarse, i, j, k)
                    if abs(roughly) > far:
                        values[i, j, k] = roughly
                        continue
                point[2] = origin[2] + k * spacing
                square, last = _nearest(tree, point, last, nodes, keys)
                winding = around
                for c in range(count):
                    if heights[c] > point[2]:
                        winding += ways[c]
                values[i, j, k] = -sqrt(square) if winding > 0 else sqrt(square)
    return True


@_inlined
def _between(coarse, i, j, k):  # type: ignore[no-untyped-def]
    """The coarse grid's value at a place of the fine one."""
    a, b = min(i // COARSER, coarse.shape[0] - 2), min(j // COARSER, coarse.shape[1] - 2)
    c = min(k // COARSER, coarse.shape[2] - 2)
    u, v, w = i / COARSER - a, j / COARSER - b, k / COARSER - c
    total = 0.0
    for x in range(2):
        for y in range(2):
            share = (u if x else 1.0 - u) * (v if y else 1.0 - v)
            pair = (1.0 - w) * coarse[a + x, b + y, c] + w * coarse[a + x, b + y, c + 1]
            total += share * pair
    return total


@_kernel
def _crossings(tree, x, y, nodes, heights, ways):  # type: ignore[no-untyped-def]
    """Where the line along z through x, y meets the surface, and 1 where it goes out through it.

    Returns how often, or −1 where there is no room for so many.
    """
    boxes, links, corners = tree.boxes, tree.links, tree.corners
    nodes[0], waiting, count = 0, 1, 0
    while waiting > 0:
        waiting -= 1
        box = nodes[waiting]
        if abs(x - boxes[box, 0]) > boxes[box, 3] or abs(y - boxes[box, 1]) > boxes[box, 4]:
            continue
        first, triangles = links[box, 0], links[box, 1]
        if triangles == 0:
            nodes[waiting], nodes[waiting + 1] = first, first + 1
            waiting += 2
        for t in range(first, first + triangles):
            ax, ay = corners[t, 0] - x, corners[t, 1] - y
            bx, by = corners[t, 3] - x, corners[t, 4] - y
            cx, cy = corners[t, 6] - x, corners[t, 7] - y
            # Each is exactly the opposite for the triangle on the edge's other side.
            ab, bc, ca = ax * by - ay * bx, bx * cy - by * cx, cx * ay - cy * ax
            out = ab > 0.0 and bc > 0.0 and ca > 0.0
            if out or (ab < 0.0 and bc < 0.0 and ca < 0.0):
                if count == heights.size:
                    return -1
                z = bc * corners[t, 2] + ca * corners[t, 5] + ab * corners[t, 8]
                heights[count], ways[count] = z / (ab + bc + ca), 1 if out else -1
                count += 1
    return count


@_kernel
def _nearest(tree, point, guess, nodes, keys):  # type: ignore[no-untyped-def]
    """Square of the distance from the surface, and the nearest triangle.

    guess: a triangle to begin with; that of a place nearby saves most of the search.
    """
    boxes, links = tree.boxes, tree.links
    best = _to_triangle(tree.corners, guess, point)
    nodes[0], keys[0], waiting = 0, 0.0, 1
    while waiting > 0:
        waiting -= 1
        if keys[waiting] >= best:
            continue
        first, triangles = links[nodes[waiting], 0], links[nodes[waiting], 1]
        if triangles == 0:
            near, far = _to_box(boxes, first, point), _to_box(boxes, first + 1, point)
            nearer = first if near <= far else first + 1
            nodes[waiting], keys[waiting] = 2 * first + 1 - nearer, max(near, far)
            nodes[waiting + 1], keys[waiting + 1] = nearer, min(near, far)
            waiting += 2
        for t in range(first, first + triangles):
            square = _to_triangle(tree.corners, t, point)
            if square < best:
                best, guess = square, t
    return best, guess


@_inlined
def _to_box(boxes, box, point):  # type: ignore[no-untyped-def]
    """Square of the distance."""
    x = max(abs(point[0] - boxes[box, 0]) - boxes[box, 3], 0.0)
    y = max(abs(point[1] - boxes[box, 1]) - boxes[box, 4], 0.0)
    z = max(abs(point[2] - boxes[box, 2]) - boxes[box, 5], 0.0)
    return x * x + y * y + z * z


@_inlined
def _to_triangle(corners, t, point):  # type: ignore[no-untyped-def]
    """Square of the distance. From the projections on two edges follow the corners', the edges'
    and the inside's own regions."""
    a0, a1, a2 = corners[t, 0] - point[0], corners[t, 1] - point[1], corners[t, 2] - point[2]
    p0, p1 = corners[t, 3] - corners[t, 0], corners[t, 4] - corners[t, 1]
    p2, q0 = corners[t, 5] - corners[t, 2], corners[t, 6] - corners[t, 0]
    q1, q2 = corners[t, 7] - corners[t, 1], corners[t, 8] - corners[t, 2]
    d1, d2 = -(p0 * a0 + p1 * a1 + p2 * a2), -(q0 * a0 + q1 * a1 + q2 * a2)
    pp, pq = p0 * p0 + p1 * p1 + p2 * p2, p0 * q0 + p1 * q1 + p2 * q2
    qq = q0 * q0 + q1 * q1 + q2 * q2
    d3, d4, d5, d6 = d1 - pp, d2 - pq, d1 - pq, d2 - qq
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0  # the point is a + v·p + w·q
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    x0, x1, x2 = a0 + v * p0 + w * q0, a1 + v * p1 + w * q1, a2 + v * p2 + w * q2
    return x0 * x0 + x1 * x1 + x2 * x2


_IN_SOLID_MM: Final = 10.0
"""By which the grid of a cavity is larger than the mesh: what is there touches in any case."""
MOST_PLACES: Final = 64_000_000
"""Of any grid: 256 MB."""
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
    environment: Environment,
    spacing_mm: float = 1.5,
    exact_to_mm: float = 20.0,
    covering_mm: FloatArray | None = None,
    reach_mm: FloatArray | None = None,
) -> DistanceGrid:
    """The grid of an environment: some microseconds for each place, of which there are millions.

    exact_to_mm: more than the body's radius. covering_mm: (2, 3) lowest and highest coordinates
    that the grid has to reach over besides the mesh. reach_mm: (2, 3) beyond which no part of the
    body comes, and all counts as solid; None: the grid is of the whole mesh. Raises
    EnvironmentFaultError where the grid would be too large.
    """
    if not (spacing_mm > 0.0 and exact_to_mm > 0.0):
        raise EnvironmentFaultError(f"a grid needs a positive spacing, not {spacing_mm} mm")
    margin_mm = _IN_SOLID_MM if environment.solid_around else exact_to_mm
    within = np.concatenate(
        [environment.vertices_mm, np.empty((0, 3)) if covering_mm is None else covering_mm]
    )
    lowest, highest = within.min(axis=0) - margin_mm, within.max(axis=0) + margin_mm
    if reach_mm is not None:
        lowest, highest = reach_mm
    coarse_mm = COARSER * spacing_mm
    cubes = [max(1, ceil(length / coarse_mm)) for length in highest - lowest]
    places = prod(COARSER * count + 1 for count in cubes)
    if places > MOST_PLACES:
        raise EnvironmentFaultError(
            f"a grid of {spacing_mm:.3g} mm has {places} places here, more than {MOST_PLACES}: "
            "take a coarser one (grid_mm)"
        )
    coarse = np.empty([count + 1 for count in cubes], np.float32)
    fine = np.empty([COARSER * count + 1 for count in cubes], np.float32)
    around, far = int(environment.solid_around), exact_to_mm + _error_mm(coarse_mm)
    if not (
        fill(environment.tree, lowest, coarse_mm, around, _NOTHING, far, coarse)
        and fill(environment.tree, lowest, spacing_mm, around, coarse, far, fine)
    ):
        raise EnvironmentFaultError("the surface is folded up more than any body's")
    solid_around = environment.solid_around or reach_mm is not None
    return DistanceGrid(lowest, spacing_mm, fine, exact_to_mm, margin_mm, solid_around)


def _error_mm(spacing_mm: float) -> float:
    return spacing_mm * sqrt(3.0) / 2.0
