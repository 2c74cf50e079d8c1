"""Where a tip is and points, learnt: q numbers that shape a body to position and direction.

A locally weighted projection regression with six outputs (Fagogenis, Bergeles and Dupont, IROS
2016): the position in mm and a vector along the tip's axis, which is made a unit vector again.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from daemon.array_files import ArrayFile, read_as
from daemon.learning.lwpr.model import FloatArray, Lwpr
from daemon.learning.lwpr.settings import LwprSettings
from drivers.pose import Vector

KIND: Final = "tentacled pose model/1"
_OUTPUTS: Final = 6
_GENERATE_BELOW: Final = 0.06
_LEVER_MM: Final = 50.0
"""So much counts as one in the position, as a unit vector does in the direction."""
NO_DIRECTION: Final = 0.05
"""A blend of directions shorter than this points nowhere."""
_SEARCH_STEPS: Final = 12
_ASKED: Final = 2000
"""Places at which lattices are compared."""


class PoseOfTip(NamedTuple):
    """position_mm (3,), and direction (3,) of unit length; not a number where it is not known."""

    position_mm: Vector
    direction: Vector


@dataclass(frozen=True)
class PoseModel:
    """What has been learnt, and of what. metadata is for JSON."""

    lwpr: Lwpr
    metadata: Mapping[str, Any]

    def predict(self, configuration: Vector) -> PoseOfTip:
        """At (q,) numbers."""
        said = self.lwpr.predict(configuration)
        length = float(np.linalg.norm(said[3:]))
        if length < NO_DIRECTION:
            return PoseOfTip(np.full(3, np.nan), np.full(3, np.nan))
        return PoseOfTip(said[:3], said[3:] / length)

    def save(self, path: Path) -> None:
        """A reader sees the old file or the whole new one. Raises OSError."""
        about = {"kind": KIND, **self.metadata, "lwpr": self.lwpr.settings.to_dict()}
        ArrayFile(about, self.lwpr.to_arrays()).save(path)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Raises ModelError for a file that is none; OSError."""
        with read_as(path, "a pose model"):
            file = ArrayFile.load(path, KIND)
            about = dict(file.about)
            settings = LwprSettings.from_dict(about.pop("lwpr"))
            if settings.outputs != _OUTPUTS:
                raise ValueError(f"it has {settings.outputs} outputs, not {_OUTPUTS}")
            return cls(Lwpr.from_arrays(settings, file.arrays), about)


def pose_settings(
    scale: Vector, periods: tuple[float | None, ...], metric: FloatArray
) -> LwprSettings:
    """scale: (q,) what the numbers are divided by. metric: (q, q) of a field, once they are."""
    return LwprSettings(
        inputs=len(scale),
        outputs=_OUTPUTS,
        norm_in=tuple(scale),
        norm_out=(_LEVER_MM,) * 3 + (1.0,) * 3,
        periods=periods,
        init_metric=tuple(tuple(row) for row in metric.tolist()),
        diagonal_only=False,
        generate_below=_GENERATE_BELOW,
    )


def sized_metric(shape: FloatArray, places: FloatArray, periods: Vector, fields: int) -> FloatArray:
    """A multiple of `shape` (q, q) with which samples make `fields` fields, or a few less.

    places: (k, q) the samples in their order, once they are divided by their scale; periods: (q,)
    likewise, 0: none.
    """
    scale, best = 1.0, 0.0
    low, high = 0.0, np.inf
    for _ in range(_SEARCH_STEPS):
        made = _fields_made(places, periods, scale * shape, 4 * fields)
        if made <= fields:
            best, low = max(best, scale), max(low, scale)
        else:
            high = min(high, scale)
        guess = scale * (fields / made) ** (2.0 / len(shape))
        inside = low < guess < high
        scale = guess if inside else 0.5 * (low + (high if np.isfinite(high) else 4.0 * scale))
    return np.asarray((best or low or scale) * shape)


def lattice(counts: tuple[int, ...], lowest: Vector, highest: Vector) -> FloatArray:
    """(2 n₁ n₂ …, q) places of two grids, one in the middle of the other's cells.

    In three dimensions that is the body-centred lattice, with which as few spheres as can be cover
    a space: less than half as many as where they came by chance.
    """
    cells = np.indices(counts).reshape(len(counts), -1).T
    places = np.concatenate([cells + 0.25, cells + 0.75]) / np.array(counts)
    return np.asarray(lowest + places * (highest - lowest))


def lattice_counts(
    shape: FloatArray, lowest: Vector, highest: Vector, periods: Vector, fields: int
) -> tuple[int, ...]:
    """How many cells along each of q numbers make a `lattice` of at most `fields` places, by which
    everything is as near as it can be in the metric `shape` (q, q). periods: (q,), 0: none."""
    size = len(shape)
    ideal = (highest - lowest) * np.sqrt(np.diag(shape))
    ideal = ideal * (0.5 * fields / ideal.prod()) ** (1.0 / size)
    around = [range(max(1, int(n) - 1), int(n) + 3) for n in ideal]
    asked = np.random.default_rng(0).uniform(lowest, highest, size=(_ASKED, size))
    best, best_far = (1,) * size, np.inf
    for counts in product(*around):
        if 2 * int(np.prod(counts)) <= fields:
            far = _farthest(asked, lattice(counts, lowest, highest), periods, shape)
            if far < best_far:
                best, best_far = counts, far
    return best


@njit(cache=True)
def _farthest(
    asked: FloatArray, centres: FloatArray, periods: FloatArray, metric: FloatArray
) -> float:
    """Root mean square of the squared distance to the nearest centre: errors go by that."""
    size, total = asked.shape[1], 0.0
    away = np.empty(size)
    for place in asked:
        nearest = np.inf
        for centre in centres:
            distance = 0.0
            for a in range(size):
                away[a] = place[a] - centre[a]
                if periods[a] > 0.0:
                    away[a] -= periods[a] * np.round(away[a] / periods[a])
            for a in range(size):
                for b in range(size):
                    distance += away[a] * metric[a, b] * away[b]
            nearest = min(nearest, distance)
        total += nearest * nearest
    return float(np.sqrt(total / len(asked)))


@njit(cache=True)
def _fields_made(places: FloatArray, periods: FloatArray, metric: FloatArray, most: int) -> int:
    """How many fields come: one wherever no other weighs a sample enough. Up to `most`."""
    nearest, count, size = -2.0 * np.log(_GENERATE_BELOW), 0, places.shape[1]
    centres, away = np.empty((most, size)), np.empty(size)
    for place in places:
        near = False
        for c in range(count):
            for a in range(size):
                away[a] = place[a] - centres[c, a]
                if periods[a] > 0.0:
                    away[a] -= periods[a] * np.round(away[a] / periods[a])
            distance = 0.0
            for a in range(size):
                for b in range(size):
                    distance += away[a] * metric[a, b] * away[b]
            if distance < nearest:
                near = True
                break
        if not near:
            centres[count] = place
            count += 1
            if count == most:
                break
    return count


def as_rows(tip_mm: FloatArray, direction: FloatArray) -> NDArray[np.float64]:
    """(k, 6) as the regression learns them."""
    return np.hstack([tip_mm, direction])
