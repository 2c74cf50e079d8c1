"""contact_risk of ways, asked of as few draws as the place allows.

Far from everything it is proved of all draws at once that none touches; a tenth of them then say
how far it is, which nothing is decided by. Shapes of all draws are half of a processor's cache: not
to make them saves more than their arithmetic.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from safety.risk.contact import ContactModel
from safety.risk.contact_figures import PathContactRisk, upper_limit
from safety.risk.model.mixture import Mixture
from safety.risk.model.shape_basis import ShapeBasis
from safety.risk.moving_obstacles import Swept
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import InsertionPort

_EVERY: Final = 10
"""Of so many draws one says how far it is: a hundred of a thousand, of which five are the worst."""


class WayContact:
    """Of one body in one environment. Not for several threads.

    Raises ValueError where the grid is not made for so thick a body.
    """

    def __init__(
        self,
        basis: ShapeBasis,
        grid: DistanceGrid,
        port: InsertionPort | None,
        samples: int,
        seed: int,
    ) -> None:
        self.all_draws = ContactModel(basis, grid, port, samples, seed)
        self._few_draws = ContactModel(basis, grid, port, samples, seed, _EVERY)
        self._touching = np.zeros(samples, np.bool_)
        self._upper_limit = upper_limit(0, samples)

    def take_moving(self, swept: Swept) -> None:
        """Count with what moves, too, from now on."""
        self.all_draws.take_moving(swept)

    def warm_up(self, mixture: Mixture) -> None:
        """Compile what is needed far from everything and near to something, or load it from numba's
        cache."""
        self.along([mixture])
        self.all_draws.along([mixture, replace(mixture)])
        self.all_draws.warm_up()
        self._few_draws.risk(mixture)

    def along(self, mixtures: Sequence[Mixture]) -> PathContactRisk:
        """As `ContactModel.along` has it. Far from everything, distances are those that a tenth of
        the draws have at the end of the way."""
        if not self.all_draws.is_far(mixtures):
            return self.all_draws.along(mixtures)
        at_end, samples = self._few_draws.risk(mixtures[-1]), self._touching.size
        figures = replace(at_end, samples=samples, upper_limit=self._upper_limit)
        return PathContactRisk(figures, (0.0,) * len(mixtures), None, self._touching)
