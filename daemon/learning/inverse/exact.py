"""Exact local controllers, twice: every field from every sample whenever something has changed.

`OracleControllers` is as the equations are written down: one field after the other, solved when it
is asked for. To be read beside `local_controllers`, and to hold the fast engines to.

In `BatchControllers` the fields' weights of the samples, which do not change while a sample is in
the window, are kept. All weighted sums of all fields are then one matrix product of (f, n) weights
and (n, F) products.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from daemon.learning.inverse.engine_parts import Engine, SolvedFields
from daemon.learning.inverse.local_controller_kernels import SUPPORT_CUTOFF, Sums, log_weights
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import InverseAnswer
from daemon.learning.inverse.prior import Prior
from daemon.learning.inverse.reward import reward_scale, reward_scales, rewarded_products
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

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> InverseAnswer:
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


class SolvedField(NamedTuple):
    """β (P, m) for rows x, and the matrix A (P, P) it was solved from, with its ridge."""

    beta: Vector
    matrix: Vector


class OracleControllers(Engine):
    """See `LocalControllers`."""

    def add(self, sample: MotionSample) -> None:
        self._data.put(sample)

    def refill(self, samples: Iterable[MotionSample]) -> None:
        self._data.refill(samples)

    def solve(self, budget: int | None = None) -> None:
        """Nothing waits here."""

    @property
    def parameters(self) -> Vector:
        regressors = self._regressors
        result = np.zeros((self.fields.count, regressors.count, regressors.axes))
        for index in range(self.fields.count):
            solved = self.solve_field(index)
            if solved is not None:
                result[index] = regressors.centred(solved.beta, self.fields.centres[index])
        return result

    def solve_field(self, index: int) -> SolvedField | None:
        """Field `index` from the whole window; None where neither window nor prior say anything."""
        settings, data, count = self._settings, self._data, self._data.count
        x, y, cost = data.rows[:count], data.targets[:count], data.cost[:count]
        p = self._regressors.count
        matrix, cross = np.zeros((p, p)), np.zeros((p, self._regressors.axes))
        mass = 0.0
        if count:
            away = x[:, PLACE:] + self._regressors.middle - self.fields.centres[index]
            log_weight = -0.5 * np.einsum("ka,ab,kb->k", away, self.fields.metrics[index], away)
            weight = np.exp(log_weight)
            mass = float(weight.sum())
            log_rewarded = log_weight - 0.5 * reward_scale(settings, weight, cost) * cost
            rewarded = np.exp(log_rewarded - log_rewarded.max())
            rewarded *= mass / rewarded.sum()
            matrix += x.T @ (rewarded[:, None] * x)
            cross += x.T @ (rewarded[:, None] * y)
        known, known_cross = self._regressors.unpack(self._prior.products[index])
        prior_mass = self._prior.mass[index]
        matrix += prior_mass * known
        cross += prior_mass * known_cross
        mass += prior_mass
        if mass < settings.minimum_mass:
            return None
        matrix += np.diag(np.r_[0.0, np.full(p - 1, settings.ridge * mass)])
        beta = np.asarray(np.linalg.solve(matrix, cross), dtype=np.float64)
        return SolvedField(beta, matrix)

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> InverseAnswer:
        nothing = np.zeros(self._regressors.axes)
        row = np.zeros(self._regressors.count)
        self._regressors.query(delta_tip_mm, tip_mm, u, row)
        if not self._regressors.known(row):
            return InverseAnswer(nothing, 0.0, 0.0)
        log_weight = self.fields.log_weights(tip_mm, u)
        activation = float(np.exp(log_weight.max(initial=-np.inf)))
        solved = {i: s for i in range(self.fields.count) if (s := self.solve_field(i)) is not None}
        if not solved:
            return InverseAnswer(nothing, activation, 0.0)
        weight = np.exp(log_weight[list(solved)] - log_weight[list(solved)].max())
        weight /= weight.sum()
        answers = np.array([row @ field.beta for field in solved.values()])
        delta_u = self._regressors.axis_steps * (weight @ answers)
        leverage = np.array([row @ np.linalg.solve(s.matrix, row) for s in solved.values()])
        strong = weight >= SUPPORT_CUTOFF * weight.max()
        support = weight[strong].sum() / (weight[strong] @ leverage[strong])
        return InverseAnswer(delta_u, activation, float(support))
