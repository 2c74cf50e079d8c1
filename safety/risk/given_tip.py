"""The risk of a body whose tip is seen: of the shapes that agree with it."""

from typing import Final

from safety.risk.contact import ContactModel, PathContactRisk
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis
from safety.risk.moving_obstacles import Swept
from safety.risk.seen_tip import LEFT_OUT_SHARE, SeenTip, TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import InsertionPort

FEWER: Final = 5
"""Times fewer shapes tell the room: it is asked for many times, and decides nothing."""


class GivenTip:
    """One body in one environment. Not for several threads.

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
        self._contact = ContactModel(thinner, grid, port, samples, seed)
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
