"""Finds how the cameras really stand to the body's base, and how well centrelines are known.

Cameras are calibrated to some tenths of a millimetre, and all centrelines of a collection are off
by that, the same way every time: no spread shows it. But every body begins where it is clamped. How
far from there the bodies in many clouds seem to begin, is how far all clouds are to be moved. Along
the base's axis that is known least, and counts least: there the body is round and alike.

What is wrong then shows where either side of a cloud is fitted by itself: what one camera sees, and
what the other does, noise, and a surface that is not quite what it is taken for. Nobody has to know
where the body truly was. Both sides together are off by half of what they differ by, in the mean.
With a single camera there is nothing to compare, and less is stated than is wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.workbench.body_model.clouds.centreline_fit import (
    ALIGNED,
    AS_SEEN,
    LEAST_POINTS,
    Clamp,
    FittedCentreline,
    VisibleSurface,
    fit_centreline,
    refined,
)
from safety.risk.model.mixture import FloatArray

_CLOUDS: Final = 120
"""Of a collection: with so many, where they begin is known to a fiftieth of a millimetre."""
_ROUNDS: Final = 4
"""In each it is found but for a fifth: `AS_SEEN` draws a little towards the origin."""
_AZIMUTHS: Final = 4
"""Ways to split a cloud in two, about the base's axis."""
MOST_SHIFT_MM: Final = 5.0
"""Cameras that stand farther off are not calibrated."""


@dataclass(frozen=True, eq=False)
class CameraAlignment:
    """Of all clouds of one collection."""

    shift_mm: FloatArray
    """(3,) to be added to every point."""
    fit_error_mm: FloatArray
    """(nodes,) root mean square of how far centrelines fitted to clouds so moved are off, across
    the body."""
    clouds: int
    """That it was found from."""

    @property
    def doubt(self) -> str:
        """Why the clouds are not to be moved by so much; empty: they are."""
        away_mm = float(np.linalg.norm(self.shift_mm))
        if away_mm <= MOST_SHIFT_MM:
            return ""
        x, y, z = (-self.shift_mm).tolist()
        return (
            f"the bodies in the clouds begin at ({x:.1f}, {y:.1f}, {z:.1f}) mm and not at the "
            "origin: look at the frame, and calibrate the cameras"
        )


class _Seen(NamedTuple):
    """A cloud, what is known of the body in it, and what was fitted to it."""

    cloud_mm: FloatArray
    surface: VisibleSurface
    fit: FittedCentreline

    def again(self, shift_mm: FloatArray, clamp: Clamp) -> "_Seen":
        """With the cloud moved; the one that is kept is not."""
        moved = self.cloud_mm + shift_mm
        return self._replace(fit=refined(moved, self.surface, self.fit, clamp))


def alignment_of(
    clouds_mm: NDArray[Any], surfaces: Sequence[VisibleSurface], nodes: int
) -> CameraAlignment | None:
    """From some of (k, p, 3) clouds, spread over all. None: a body lies in none of them.

    surfaces: (k,) of the body in each.
    """
    which = np.unique(np.linspace(0, len(clouds_mm) - 1, min(_CLOUDS, len(clouds_mm))).astype(int))
    found = []
    for number in which.tolist():
        cloud, surface = clouds_mm[number].astype(np.float64), surfaces[number]
        found.append(_Seen(cloud, surface, fit_centreline(cloud, surface, nodes, AS_SEEN)))
    sure = [one for one in found if not one.fit.doubt]
    if not sure:
        return None
    shift = np.zeros(3)
    for _ in range(_ROUNDS):
        shift = shift - np.median([one.fit.begin_mm for one in sure], axis=0)
        sure = [one.again(shift, AS_SEEN) for one in sure]
    aligned = [one.again(shift, ALIGNED)._replace(cloud_mm=one.cloud_mm + shift) for one in sure]
    return CameraAlignment(shift, _errors(aligned), len(aligned))


def _errors(seen: list[_Seen]) -> FloatArray:
    """(nodes,) by where both sides differ most: that is how the cameras look at the body."""
    nodes = len(seen[0].fit.nodes_mm)
    largest = np.zeros(nodes)
    for azimuth in np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS:
        towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        squares = [square for one in seen if (square := _between_sides(one, towards)) is not None]
        if squares:
            largest = np.maximum(largest, np.mean(squares, axis=0))
    return np.asarray(0.5 * np.sqrt(largest))


def _between_sides(seen: _Seen, towards: FloatArray) -> FloatArray | None:
    """(nodes,) squares of how far both sides' centrelines are apart, across the body.

    None: one side is not seen.
    """
    cloud, surface, fit = seen
    nodes = fit.nodes_mm
    nearest = np.square(cloud[:, None] - nodes).sum(axis=2).argmin(axis=1)
    beyond = (cloud - nodes[nearest]) @ towards > 0.0
    if min(beyond.sum(), (~beyond).sum()) < LEAST_POINTS:
        return None
    one, other = (refined(cloud[side], surface, fit).nodes_mm for side in (beyond, ~beyond))
    apart, along = one - other, np.gradient(nodes, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = apart - (apart * along).sum(axis=1, keepdims=True) * along
    return np.asarray(np.square(across).sum(axis=1))
