"""What shapes a body of concentric tubes: how they are turned and pushed against the first one.

Roll and insertion of all tubes together move the body as a rigid one, and are left out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from config.axis import AxisBase
from config.emulation.plants import ConcentricTubesPlant
from sim_backends.plants.concentric.concentric_tubes import (
    TOWARDS_X_RAD,
    length_mm,
    statics_of,
    turned_rad,
)
from sim_backends.plants.concentric.statics_kernels import FloatArray

MOST_POINTS = 4_000_000


class RelativeRangeError(ValueError):
    """There is no such body to be asked. The text says why."""


class Poses(NamedTuple):
    """configuration: (k, q) of a regular grid. tip_mm and direction: (k, 3) in front of the mouth,
    the first tube at zero; not a number where no stable shape was found."""

    configuration: FloatArray
    tip_mm: FloatArray
    direction: FloatArray


class RelativeTubes:
    """q numbers: the angle of each tube but the first against the first, rad, then for each
    carriage but the first how far its first tube stands out of the first tube's end, mm."""

    def __init__(
        self,
        plant: ConcentricTubesPlant,
        axes: Sequence[AxisBase],
        extension_mm: tuple[float, float] | None = None,
    ) -> None:
        """extension_mm: of all carriages; None: as far as the axes go.

        Raises RelativeRangeError."""
        if plant.mouth != "first_collar":
            raise RelativeRangeError("in front of a plate the first tube's length counts, too")
        if len(plant.tubes) == 1:
            raise RelativeRangeError("a single tube has one shape only")
        self._plant = plant
        self._statics = statics_of(plant, ideal=True)
        self._carriage = np.array([tube.carriage for tube in plant.tubes])
        self._collar_mm = np.array([tube.collar_mm for tube in plant.tubes])
        ends = self._collar_mm + np.array([length_mm(tube) for tube in plant.tubes])
        firsts = [int(np.argmax(self._carriage == c)) for c in range(plant.carriages)]
        self._flush_mm = np.array([ends[0] - ends[first] for first in firsts])
        """(c,) each carriage's place where its first tube's end is that of the first of all."""
        self.angles = len(plant.tubes) - 1
        ranges = [(-np.pi, np.pi)] * self.angles
        travels = [axis.travel for axis in axes[len(plant.tubes) :]]
        for c in range(1, plant.carriages):
            low = travels[c][0] - travels[0][1] - self._flush_mm[c]
            high = travels[c][1] - travels[0][0] - self._flush_mm[c]
            ranges.append(extension_mm or (float(low), float(high)))
        self.lowest, self.highest = np.array(ranges).T
        self._check()

    @property
    def count(self) -> int:
        """q."""
        return len(self.lowest)

    @property
    def periods(self) -> tuple[float | None, ...]:
        """After how much each comes round to itself."""
        turns: tuple[float | None, ...] = (2.0 * np.pi,) * self.angles
        return turns + (None,) * (self.count - self.angles)

    def axes_map(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """How m axes, rotations and then carriages, make the q numbers, and move the body whole.

        (q, m) and (q,) added to it: the numbers. (m,): the roll, rad. (m,): the insertion, mm.
        """
        tubes, carriages = self.angles + 1, self._plant.carriages
        shaping = np.zeros((self.count, tubes + carriages))
        shaping[: self.angles, 1:tubes] = np.eye(self.angles)
        shaping[: self.angles, 0] = -1.0
        shaping[self.angles :, tubes + 1 :] = np.eye(carriages - 1)
        shaping[self.angles :, tubes] = -1.0
        offset = np.concatenate([np.zeros(self.angles), -self._flush_mm[1:]])
        roll, insertion = np.zeros(tubes + carriages), np.zeros(tubes + carriages)
        roll[0] = insertion[tubes] = 1.0
        return shaping, offset, roll, insertion

    def _check(self) -> None:
        if not (self.lowest < self.highest).all():
            raise RelativeRangeError("an extension goes from lowest to highest")
        for ends in (self.lowest, self.highest):
            _, collar_mm = self.held(ends[None])
            if not ((np.diff(collar_mm[0]) < 0.0).all() and collar_mm[0, 0] <= 0.0):
                raise RelativeRangeError(
                    f"with extensions of {ends[self.angles :].tolist()} mm collars would have to "
                    "pass each other"
                )

    def held(self, configuration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (k, n) rad as the statics have them, and collars (k, n) mm from the mouth."""
        rows = len(configuration)
        rotation = np.zeros((rows, self.angles + 1))
        rotation[:, 1:] = configuration[:, : self.angles]
        places = np.zeros((rows, self._plant.carriages))
        places[:, 1:] = configuration[:, self.angles :] + self._flush_mm[1:]
        rotation += TOWARDS_X_RAD + turned_rad(self._plant)
        return rotation, self._collar_mm + places[:, self._carriage]

    def poses(self, points: int) -> Poses:
        """At a grid with so many points along each of the q numbers, ends included.

        Raises RelativeRangeError for more than MOST_POINTS.
        """
        if points < 2 or points**self.count > MOST_POINTS:
            raise RelativeRangeError(
                f"a grid of {points} points along {self.count} numbers has fewer than 2 along one, "
                f"or more than {MOST_POINTS} in all"
            )
        shares = _drawn_in(points, self.angles, self.count - self.angles)
        at = self.lowest + shares * (self.highest - self.lowest)
        return Poses(at, *self._statics.tips(*self.held(at)))


def _drawn_in(points: int, angles: int, extensions: int) -> FloatArray:
    """(points^q, q) from 0 to 1: a grid, at each combination of angles from the tubes drawn out to
    drawn in, where several shapes may be stable: so it is the one that they are drawn in with."""
    row = np.arange(points ** (angles + extensions))
    turns, rest = row // points**extensions, row % points**extensions
    columns = []
    for place in range(angles):  # neighbours in order are neighbours in place
        digit, blocks = turns // points**place % points, turns // points ** (place + 1)
        columns.append(np.where(blocks % 2 == 0, digit, points - 1 - digit))
    columns += [points - 1 - rest // points**place % points for place in range(extensions)]
    return np.stack(columns, axis=1) / (points - 1.0)
