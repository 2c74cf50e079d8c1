"""How far one set of tubes is from another, and sets that are off by as much as is asked for.

A robot that was recorded, of the same design and calibrated, was off from its model by 3.0 mm in
the mean and 11 mm at the most. Sets of tubes that differ by what made tubes differ by are off by
one half to nearly all of that. What lacks is put where it is with robots that were taken apart and
put together: in the angles that homing leaves, of which 2 degrees move the tip by some 2 mm.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from config.axis import AxisBase
from config.emulation.plants import ConcentricTubesPlant
from sim_backends.plants.concentric.concentric_tubes import variation
from sim_backends.plants.concentric.relative import RelativeTubes
from sim_backends.plants.concentric.statics_kernels import FloatArray

_POINTS: Final = 8
"""Along each of the numbers that shape the body."""
_MOST_RAD: Final = 0.35
"""Twenty degrees: nobody homes as badly."""
_HALVINGS: Final = 14


class BodyError(NamedTuple):
    """Over a grid of configurations: distances of the tips."""

    mean_mm: float
    rms_mm: float
    highest_mm: float


def body_error(
    one: ConcentricTubesPlant, other: ConcentricTubesPlant, axes: Sequence[AxisBase]
) -> BodyError:
    """Without loads and friction. Raises RelativeRangeError for what has no such body."""
    off_mm = _off_mm(one, other, axes)
    return BodyError(
        float(off_mm.mean()),
        float(np.sqrt((off_mm**2).mean())),
        float(off_mm.max()),
    )


def matched_variation(
    plant: ConcentricTubesPlant, axes: Sequence[AxisBase], seed: int, mean_mm: float
) -> ConcentricTubesPlant:
    """`variation`, with angles left by homing that bring its mean error to `mean_mm`.

    One that is further off without them stays as it is. Raises RelativeRangeError.
    """
    other = variation(plant, seed)
    shares = np.random.default_rng([seed, 1]).normal(size=len(plant.tubes))
    shares /= np.abs(shares).max()
    low, high = 0.0, _MOST_RAD
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        far = body_error(plant, _turned(other, middle * shares), axes).mean_mm
        low, high = (middle, high) if far < mean_mm else (low, middle)
    return _turned(other, low * shares)


def _turned(plant: ConcentricTubesPlant, angles_rad: FloatArray) -> ConcentricTubesPlant:
    tubes = zip(plant.tubes, angles_rad.tolist(), strict=True)
    turned = tuple(tube.model_copy(update={"turned_rad": angle}) for tube, angle in tubes)
    return plant.model_copy(update={"tubes": turned})


def _off_mm(
    one: ConcentricTubesPlant, other: ConcentricTubesPlant, axes: Sequence[AxisBase]
) -> FloatArray:
    """Between the tips, wherever both bodies have an equilibrium."""
    mine, theirs = (RelativeTubes(plant, axes).poses(_POINTS) for plant in (one, other))
    mm: FloatArray = np.linalg.norm(theirs.tip_mm - mine.tip_mm, axis=1)
    return mm[np.isfinite(mm)]
