"""The clearance of parts of the body over sampled shapes, and what it changes with, compiled.

Every function that is cached on disk stands in this one file: numba notices a change only in the
file of the cached function itself.

S shapes, n nodes along each, d coefficients, K components, P parts. A part's clearance is the mean
over the `few` shapes that have the least, of the least over its nodes: a share of shapes that
moves as a whole, so that its derivative does not jump from one shape to the next.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from safety.risk.shape_kernels import SolidArrays

_FAR = np.inf

_kernel = njit(cache=True, error_model="numpy", nogil=True)
_inlined: Callable[..., Any] = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False
)
"""These make no arrays, and do not count who holds one."""

SingleArray = NDArray[np.float32]
FloatArray = NDArray[np.float64]


class Draws(NamedTuple):
    """Shapes as they were drawn from a mixture.

    positions: (S, 3n). component: (S,) of each. normal: (S, d) standard normal draws. factors:
    (K, d, d) upper triangular, of the components.
    """

    positions: SingleArray
    component: NDArray[np.int64]
    normal: FloatArray
    factors: FloatArray


class PartSlopes(NamedTuple):
    """What is found of P parts. clearance: (P,) mm, infinite where all of a part is in the port.
    node: (P,) where it is nearest. by_means: (P, K, d). by_factors: (P, K, d, d), its upper half:
    derivatives of the clearance by the mixture."""

    clearance: FloatArray
    node: NDArray[np.int64]
    by_means: FloatArray
    by_factors: FloatArray


def no_slopes(parts: int, components: int, dimensions: int) -> PartSlopes:
    """Room for so many."""
    shape = (parts, components, dimensions)
    return PartSlopes(
        np.empty(parts), np.zeros(parts, np.int64), np.zeros(shape), np.zeros((*shape, dimensions))
    )


@_kernel
def part_slopes(
    surroundings: SolidArrays,
    radius: SingleArray,
    modes: SingleArray,
    draws: Draws,
    ends: NDArray[np.int64],
    few: int,
    near_mm: float,
    found: PartSlopes,
) -> None:
    """Fill `found`. ends: (P + 1,) nodes; part p has those from ends[p] to before ends[p + 1].

    modes: (d, 3n). Derivatives are left at zero where a part has more clearance than near_mm.
    """
    least, shape, node = np.empty(few), np.empty(few, np.int64), np.empty(few, np.int64)
    place, room = np.empty(4), np.empty((3, modes.shape[0]))
    for p in range(ends.size - 1):
        least[:], count = _FAR, 0
        for s in range(draws.positions.shape[0]):
            best, where = _FAR, ends[p]
            for i in range(ends[p], ends[p + 1]):
                _look(surroundings, draws.positions, s, i, place)
                if place[0] - radius[i] < best:
                    best, where = place[0] - radius[i], i
            if best < _FAR:
                _insert(least, shape, node, best, s, where)
                count = min(count + 1, few)
        found.clearance[p] = least[:count].mean() if count else _FAR
        found.node[p] = node[count // 2] if count else ends[p]
        if found.clearance[p] <= near_mm:
            for j in range(count):
                _look(surroundings, draws.positions, shape[j], node[j], place)
                _add(modes, draws, shape[j], node[j], place, 1.0 / count, room, p, found)


@_inlined
def _insert(least, shape, node, value, s, where):  # type: ignore[no-untyped-def]
    """Into a list that is in order, if it is among the least."""
    j = least.size - 1
    if not value < least[j]:
        return
    while j > 0 and value < least[j - 1]:
        least[j], shape[j], node[j] = least[j - 1], shape[j - 1], node[j - 1]
        j -= 1
    least[j], shape[j], node[j] = value, s, where


@_inlined
def _add(modes, draws, s, i, place, share, room, p, found):  # type: ignore[no-untyped-def]
    """A share of what the distance of one shape's node changes with.

    c = μ + y with Ū y = z: by μ it is g, the slope by the coefficients, and by Ū −(Ū⁻ᵀg) yᵀ.
    """
    k, d = draws.component[s], modes.shape[0]
    factor = draws.factors[k]
    by_shape, offset, back = room[0], room[1], room[2]
    for a in range(d):
        by_shape[a] = share * (
            place[1] * modes[a, 3 * i]
            + place[2] * modes[a, 3 * i + 1]
            + place[3] * modes[a, 3 * i + 2]
        )
        found.by_means[p, k, a] += by_shape[a]
    for a in range(d):
        back[a] = by_shape[a]
        for b in range(a):
            back[a] -= factor[b, a] * back[b]
        back[a] /= factor[a, a]
    for a in range(d - 1, -1, -1):
        offset[a] = draws.normal[s, a]
        for b in range(a + 1, d):
            offset[a] -= factor[a, b] * offset[b]
        offset[a] /= factor[a, a]
    for a in range(d):
        for b in range(a, d):
            found.by_factors[p, k, a, b] -= back[a] * offset[b]


@_inlined
def _look(surroundings, positions, s, i, place):  # type: ignore[no-untyped-def]
    """Write distance and its slope at a node, between the eight corners; infinite in the port, and
    outside the grid as far from what is free or solid as the grid's end is."""
    frame, port = surroundings.frame, surroundings.port
    x, y, z = positions[s, 3 * i], positions[s, 3 * i + 1], positions[s, 3 * i + 2]
    place[1:] = 0.0
    if port[6] >= 0.0:
        px, py, pz = x - port[0], y - port[1], z - port[2]
        along = px * port[3] + py * port[4] + pz * port[5]
        if along <= port[7] and px * px + py * py + pz * pz - along * along <= port[6] * port[6]:
            place[0] = _FAR
            return
    values, per_mm = surroundings.values, frame[3]
    nx, ny, nz = surroundings.shape[0], surroundings.shape[1], surroundings.shape[2]
    u, v, w = (x - frame[0]) * per_mm, (y - frame[1]) * per_mm, (z - frame[2]) * per_mm
    if not (u >= 0.0 and v >= 0.0 and w >= 0.0 and u < nx - 1.0 and v < ny - 1.0 and w < nz - 1.0):
        place[0] = frame[4] * frame[5]
        return
    i, j, k = int(u), int(v), int(w)
    u, v, w = u - i, v - j, w - k
    row = int(nz)
    here = (i * int(ny) + j) * row + k
    above = here + int(ny) * row
    a0, a1 = values[here], values[here + 1]
    b0, b1 = values[here + row], values[here + row + 1]
    c0, c1 = values[above], values[above + 1]
    d0, d1 = values[above + row], values[above + row + 1]
    a, b, c, d = a0 + w * (a1 - a0), b0 + w * (b1 - b0), c0 + w * (c1 - c0), d0 + w * (d1 - d0)
    low, high = a + v * (b - a), c + v * (d - c)
    place[0] = low + u * (high - low)
    place[1] = (high - low) * per_mm
    place[2] = ((b - a) + u * ((d - c) - (b - a))) * per_mm
    lower = (a1 - a0) + v * ((b1 - b0) - (a1 - a0))
    upper = (c1 - c0) + v * ((d1 - d0) - (c1 - c0))
    place[3] = (lower + u * (upper - lower)) * per_mm
