"""Fast local controllers: sums that are kept up to date while samples come and go.

What one sample costs depends on how many fields it touches, not on how many samples there are. A
field is solved when it is asked, or in idle time, if its sums have changed since.

Sums from which samples were taken keep what rounding left of them. So a field without samples is
set to zero, one whose mass has shrunk by a millionth is made anew, and with each sample one field
in turn is made anew anyway.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from daemon.learning.inverse.bank_kernels import (
    ESS,
    INVERSE_MEAN,
    PRINTED,
    Moments,
    Ring,
    Rule,
    evaluate,
    exchange,
    stale_fields,
)
from daemon.learning.inverse.engine_parts import Engine, SolvedFields
from daemon.learning.inverse.local_controller_kernels import IndexArray, Sums, log_weights
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import InverseAnswer
from daemon.learning.inverse.prior import Prior
from daemon.learning.inverse.reward import LEAST_MEAN_COST
from daemon.learning.inverse.window import PLACE
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

_KINDS = {"inverse_mean": INVERSE_MEAN, "ess": ESS, "printed": PRINTED}
_AT_ONCE = 128
"""Fields whose sums are put together before they are solved."""


@dataclass(frozen=True)
class BankPrecision:
    """What the bank leaves out. The exact engines leave out nothing."""

    sample_cut: float
    """Samples with a smaller weight in a field are left out of it."""
    field_cut: float
    """Fields with a smaller share of the largest weight are left out of an answer."""
    order: int
    """J: the last power of the series in σ²."""
    tolerance: float
    """Largest relative distance ε of σ² from the series' anchor. What the series leaves out of the
    reward of a sample that costs more than the mean is at most (ε / (1−ε))ᴶ⁺¹ / √(2π (J+1)) of the
    mean sample's, whatever it costs: at high costs the reward itself is small."""

    def __post_init__(self) -> None:
        for name in ("sample_cut", "field_cut", "tolerance"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"{name} must be between 0 and 1, not {getattr(self, name)}")
        if self.order < 1:
            raise ValueError(f"order must be at least 1, not {self.order}")

    @classmethod
    def fine(cls) -> Self:
        """Answers within a millionth of the exact ones, in the median."""
        return cls(sample_cut=1e-9, field_cut=1e-9, order=4, tolerance=0.08)

    @classmethod
    def fast(cls) -> Self:
        """Answers within a thousandth of the exact ones, in the median."""
        return cls(sample_cut=3e-7, field_cut=3e-7, order=2, tolerance=0.1)


class BankControllers(Engine):
    """See `LocalControllers`."""

    def __init__(
        self,
        fields: ReceptiveFields,
        settings: LocalControllerSettings,
        capacity: int,
        posture: Vector,
        prior: Prior | None = None,
        precision: BankPrecision | None = None,
    ) -> None:
        """precision: fine if None."""
        super().__init__(fields, settings, capacity, posture, prior)
        precision = BankPrecision.fine() if precision is None else precision
        self._least_mass = settings.minimum_mass
        self._log_field_cut = float(np.log(precision.field_cut))
        self._solved = SolvedFields(fields, self._regressors, settings, self._log_field_cut)
        self._rule = Rule(
            _KINDS[settings.sigma_rule],
            settings.sharpness,
            LEAST_MEAN_COST,
            settings.least_effective_samples,
            precision.tolerance,
            float(np.log(precision.sample_cut)),
        )
        size = self._regressors.products_count
        self._moments = _no_moments(fields.count, precision.order + 1, size)
        self._ring = Ring(
            np.zeros((len(fields.scale), capacity)),
            self._data.cost,
            self._data.products,
            np.zeros(1, np.int64),
        )
        self._sums = Sums(np.zeros((_AT_ONCE, size)), np.zeros(_AT_ONCE))
        self._places = np.zeros((2, len(fields.scale)))
        self._log_weights = np.zeros((2, fields.count))
        self._which = np.zeros(fields.count, np.int64)
        self._turn = 0
        self.made_anew = 0
        """How often a field's sums were made anew."""
        self.solve()

    @property
    def parameters(self) -> Vector:
        self.solve()
        return self._solved.parameters

    def add(self, sample: MotionSample) -> None:
        cost = self._data.prepare(sample)
        slot, leaves = self.window.slot, self.window.full
        self._places[0] = self._data.new_row[PLACE:]
        self._places[1] = self._ring.places[:, slot]
        log_weights(self._solved.geometry, self._places, self._log_weights)
        products = self._data.new_products
        exchange(
            self._moments, self._ring, slot, leaves, self._log_weights, products, cost, self._rule
        )
        self._ring.places[:, slot] = self._places[0]
        self._data.store(sample, cost)
        self._ring.filled[0] = self._data.count
        self._refresh_one()

    def refill(self, samples: Iterable[MotionSample]) -> None:
        self._data.refill(samples)
        self._ring.filled[0] = self._data.count
        self._ring.places[:] = self._data.rows[:, PLACE:].T
        self._turn = 0
        self._forget()
        self.solve()

    def solve(self, budget: int | None = None) -> None:
        self._solve(np.flatnonzero(self._moments.stale)[:budget])

    def command(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> InverseAnswer:
        if not self._solved.ask(delta_tip_mm, tip_mm, u):
            return self._solved.nothing()
        count = stale_fields(
            self._solved.log_weights[0],
            self._log_field_cut,
            self._moments,
            self._prior.mass,
            self._least_mass,
            self._which,
        )
        self._solve(self._which[:count])
        return self._solved.answer()

    def _solve(self, which: IndexArray) -> None:
        moments, geometry, sums = self._moments, self._solved.geometry, self._sums
        for start in range(0, len(which), _AT_ONCE):
            some = which[start : start + _AT_ONCE]
            self.made_anew += evaluate(some, moments, geometry, self._ring, self._rule, sums)
            self._solved.solve(some, sums, self._prior.sums)

    def _forget(self) -> None:
        self._moments.broken[:] = True
        self._moments.stale[:] = True

    def _refresh_one(self) -> None:
        if self.fields.count:
            self._moments.broken[self._turn] = True
            self._moments.stale[self._turn] = True
            self._turn = (self._turn + 1) % self.fields.count


def _no_moments(fields: int, terms: int, products: int) -> Moments:
    return Moments(
        terms=np.zeros((fields, terms, products)),
        squares=np.zeros((fields, terms)),
        mass=np.zeros(fields),
        square=np.zeros(fields),
        cost=np.zeros(fields),
        samples=np.zeros(fields, np.int64),
        peak=np.zeros(fields),
        anchor=np.zeros(fields),
        reference=np.zeros(fields),
        broken=np.ones(fields, np.bool_),
        stale=np.ones(fields, np.bool_),
    )
