"""Exact local controllers: every field from every sample whenever something has changed.

The fields' weights of the samples do not change while a sample is in the window, so they are kept.
All weighted sums of all fields are then one matrix product of (f, n) weights and (n, F) products.
"""

from collections.abc import Iterable

import numpy as np

from daemon.learning.inverse.engine_parts import Engine, SolvedFields
from daemon.learning.inverse.local_controller_kernels import Sums, log_weights
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import Command
from daemon.learning.inverse.prior import Prior
from daemon.learning.inverse.reward import reward_scales, rewarded_products
from daemon.learning.inverse.window import PLACE
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector


class BatchControllers(Engine):
    """See `LocalControllers`. `solve` always solves all fields: that is one product."""

    def __init__(
        self,
        fields: ReceptiveFields,
        settings: LocalControllerSettings,
        capacity: int,
        posture: Vector,
        prior: Prior | None = None,
    ) -> None:
        super().__init__(fields, settings, capacity, posture, prior)
        self._solved = SolvedFields(fields, self._regressors, settings)
        self._log_weights = np.zeros((fields.count, capacity))
        self._weights = np.zeros((fields.count, capacity))
        self._work = np.zeros((fields.count, capacity))
        self._sums = np.zeros((fields.count, self._regressors.products_count))
        self._column = np.zeros((1, fields.count))
        self._all = np.arange(fields.count)
        self._stale = True

    @property
    def parameters(self) -> Vector:
        self.solve()
        return self._solved.parameters

    def add(self, sample: MotionSample) -> None:
        self._weigh(self._data.put(sample))
        self._stale = True

    def refill(self, samples: Iterable[MotionSample]) -> None:
        self._data.refill(samples)
        for slot in range(self._data.count):
            self._weigh(slot)
        self._stale = True

    def _forget(self) -> None:
        self._stale = True

    def solve(self, budget: int | None = None) -> None:
        if self._stale and budget != 0:
            self._solve()
            self._stale = False

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> Command:
        self.solve()
        asked = self._solved.ask(delta_tip_mm, tip_mm, u)
        return self._solved.answer() if asked else self._solved.nothing()

    def _weigh(self, slot: int) -> None:
        place = self._data.rows[slot : slot + 1, PLACE:]
        log_weights(self._solved.geometry, place, self._column)
        self._log_weights[:, slot] = self._column[0]
        self._weights[:, slot] = np.exp(self._column[0])

    def _solve(self) -> None:
        count = self._data.count
        mass = np.zeros(self.fields.count)
        if count:
            cost = self._data.cost[:count]
            scales, mass = reward_scales(self._settings, self._weights[:, :count], cost)
            products = self._data.products
            rewarded_products(self._log_weights, cost, scales, products, self._work, self._sums)
        self._solved.solve(self._all, Sums(self._sums, mass), self._prior.sums)
