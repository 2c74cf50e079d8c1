"""What a measured tip says of the whole body, now and where the body goes next, and of its risk.

The shapes that the model has are conditioned on the tip, see `model.conditioning`. Two things are
taken for possible that the model has not seen. The body may be another than those of its training,
or bear a load: it is bent by as much again as the model's own spread, and by a share of what the
tip is off. And what is seen here says less of the body elsewhere: friction and hysteresis turn, so
the tip counts as less accurately known by a share of the way that the model has it go from here.
"""

from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Final

import numpy as np

from safety.risk.contact import ContactModel
from safety.risk.contact_figures import PathContactRisk
from safety.risk.model.conditioning import (
    LinearObservation,
    bending_covariance,
    conditioned,
    tip_direction,
    tip_place,
)
from safety.risk.model.conditioning_kernels import spread, write_moved_tip
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis
from safety.risk.moving_obstacles import Swept
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import InsertionPort
from safety.risk.way_contact import WayContact

OTHER_BODY: Final = 0.5
"""Variance of the tip by what the model has not seen, over the variance that it has."""
OFF_SHARE: Final = 0.3
"""... and its standard deviation, over how far the tip is from the model's mean."""
FORGETS: Final = 0.3
"""mm of standard deviation that the tip's place gets for each mm that it goes on."""
LEFT_OUT_SHARE: Final = 0.25
"""Of what the basis leaves out of the body, in the body's thickness. It is a bound on errors of fit
and of shape, which OTHER_BODY has among the shapes already: added as variances they come to 0.2 to
0.4 of the sum of both, at a risk of 5 % and with shapes 0.3 to 1.2 mm apart."""
FEWER: Final = 5
"""Times fewer shapes tell the room: it is asked for many times, and decides nothing."""
_ASKEW: Final = 4.0
"""Standard deviations: a direction further from the model's is that of a sensor that lies askew."""


_PLACE: Final = 3
"""Coordinates of a place; a direction has as many."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenTip:
    """A measured tip, and what the model has for the axes at its time."""

    mean: FloatArray
    """(d,) of the model's coefficients."""
    beside: float
    """mm², of one coordinate of the tip: the variance of what the model has not seen."""
    value: FloatArray
    """(3,) place in mm; or (6,) that and the direction, where it is measured and to be believed: as
    long as the model's slope of the centreline there."""
    agrees: bool
    """Whether the model has nothing against the tip: then what it says given the tip decides by
    itself. Else it may only make the risk higher."""


class TipConditioning:
    """Of one body's model."""

    def __init__(self, basis: ShapeBasis, accuracy_mm: float, accuracy_rad: float | None) -> None:
        """accuracy_mm, accuracy_rad: standard deviation per coordinate of the tip's place and of
        its direction, of what is measured from what the model means by them. accuracy_rad: None:
        the direction is not asked for."""
        place, direction = tip_place(basis), tip_direction(basis)
        self._matrix = np.concatenate([place[0], direction[0]])
        self._offset = np.concatenate([place[1], direction[1]])
        self._place, self._direction = self._matrix[:_PLACE], self._matrix[_PLACE:]
        self._bends = bending_covariance(basis)
        self._direction_variance = None if accuracy_rad is None else accuracy_rad**2
        unsure = 0.0 if self._direction_variance is None else self._direction_variance
        self._variances = np.array([accuracy_mm**2, unsure])
        self._length_mm = float(basis.arc_mm[-1] - basis.arc_mm[0])

    def seen(
        self,
        mixture: Mixture,
        place_mm: FloatArray,
        direction: FloatArray | None,
        agrees: bool = True,
    ) -> SeenTip:
        """A tip with the model's mixture for the axes at its time.

        direction: a unit vector. One that is far from where the model has it, given the place, is
        left out.
        """
        mean = _mean(mixture)
        off = place_mm - self._offset[:_PLACE] - self._place @ mean
        beside = OTHER_BODY * _spread(mixture, self._place) / 3.0 + OFF_SHARE**2 * float(off @ off)
        seen = SeenTip(mean, beside, place_mm, agrees)
        if direction is None or self._direction_variance is None:
            return seen
        given = self.there(seen, mixture)
        if given is None:
            return seen
        along = self._offset[_PLACE:] + self._direction @ _mean(given)
        # Longer than one where the body is longer than usual: that is no turn.
        as_long = sqrt(along @ along) * direction
        turned = as_long - along
        variance = 3.0 * self._direction_variance + _spread(given, self._direction)
        near = float(turned @ turned) <= _ASKEW**2 * variance  # never of no number
        if not near:
            return seen
        return SeenTip(mean, beside, np.concatenate([place_mm, as_long]), agrees)

    def there(self, seen: SeenTip, mixture: Mixture) -> Mixture | None:
        """The model's mixture at another place of the axes, or at the same, given the tip.

        The tip is taken to go as the mean of the model goes. None: there is no finite answer.
        """
        value, variance = np.empty(seen.value.size), np.empty(seen.value.size)
        write_moved_tip(
            *(mixture.weights, mixture.means_mm, seen.mean, self._matrix, self._offset, seen.value),
            *(self._variances, self._length_mm, FORGETS, value, variance),
        )
        if not (isfinite(seen.beside) and isfinite(variance[0])):
            return None
        observation = LinearObservation(self._matrix[: value.size], value, variance)
        found = conditioned(mixture, observation, seen.beside * self._bends)
        return None if found is None else found.mixture


class GivenTip:
    """The risk of the shapes that agree with a tip. One body in one environment; not for several
    threads.

    Raises ValueError where the grid is not made for so thick a body.
    """

    def __init__(
        self,
        conditioning: TipConditioning,
        basis: ShapeBasis,
        grid: DistanceGrid,
        port: InsertionPort | None,
        samples: int,
        seed: int,
    ) -> None:
        self.conditioning = conditioning
        thinner = basis.leaving_out(LEFT_OUT_SHARE)
        self._contact = WayContact(thinner, grid, port, samples, seed)
        self.fewer = ContactModel(thinner.on_the_safe_side(), grid, port, samples // FEWER, seed)
        """As thick as those that decide."""
        self.seen: SeenTip | None = None
        self._begin: tuple[Mixture, Mixture | None] | None = None
        """Where the last way began, and the same given the tip."""

    @property
    def decides(self) -> bool:
        """Whether the model has nothing against the tip that is seen."""
        return self.seen is not None and self.seen.agrees

    def see(
        self, mixture: Mixture, place_mm: FloatArray, direction: FloatArray | None, agrees: bool
    ) -> None:
        """A (3,) tip, pointing along (3,), where the model has this mixture."""
        self.take(self.conditioning.seen(mixture, place_mm, direction, agrees))

    def take(self, seen: SeenTip | None) -> None:
        """What was seen; None: nothing is."""
        self.seen, self._begin = seen, None

    def take_moving(self, swept: Swept) -> None:
        """Count with what moves, too, from now on."""
        self._contact.take_moving(swept)
        self.fewer.take_moving(swept)

    def at(self, mixture: Mixture) -> Mixture | None:
        """Given the tip; None: none is seen, or there is no finite answer."""
        return None if self.seen is None else self.conditioning.there(self.seen, mixture)

    def along(self, mixtures: list[Mixture]) -> PathContactRisk | None:
        """Of the way through the model's mixtures; None: no tip is seen, or there is no finite
        answer."""
        if self._begin is None or self._begin[0] is not mixtures[0]:
            self._begin = mixtures[0], self.at(mixtures[0])
        along = [self._begin[1], *(self.at(mixture) for mixture in mixtures[1:])]
        found = [mixture for mixture in along if mixture is not None]
        return self._contact.along(found) if len(found) == len(mixtures) else None


def _spread(mixture: Mixture, matrix: FloatArray) -> float:
    """Sum of the variances of matrix · coefficients, of the whole mixture."""
    return float(spread(mixture.weights, mixture.means_mm, mixture.factors_per_mm, matrix))


def _mean(mixture: Mixture) -> FloatArray:
    return np.asarray(mixture.weights @ mixture.means_mm)
