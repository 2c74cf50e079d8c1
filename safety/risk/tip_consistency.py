"""Whether the measured tip is where the model of the body has it: a sequential test.

Every frame is asked for the probability p that the tip lies further out in the model's distribution
than it was measured. Of a body as the model knows it, p falls below x with a probability of at most
x. A cumulative sum (CUSUM) of ln(1/p) over time, less a reference value, is compared with a limit:

    S ← max(0, S + (ln(1/p) − REFERENCE) · dt),   alarm at S ≥ LIMIT_S.

Frames do not bear independent witness: what friction, creep and the way there have made of a body
stays with it until it has moved on, and what the model misses of a configuration stays for good. So
the sum is over time and not over frames, and what one in three hundred bodies does adds nothing to
it, for however long. A body that is RENEWED_S long as it is, and then another, raises the alarm
where p < exp(−REFERENCE − LIMIT_S / RENEWED_S): as often as `false_alarms_per_hour` says. Emulated
arms keep what they are off by for 5 (tendons) to 10 s (silicone) on random ways.
"""

from collections.abc import Sequence
from math import exp, isfinite, log
from typing import Final, NamedTuple

import numpy as np

from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.risk_model import RiskModel
from safety.risk.tip_kernels import likeliest_shift, tail

REFERENCE: Final = log(300.0)
LIMIT_S: Final = 2.0
"""With REFERENCE, chosen for less than one false alarm in an hour: `false_alarms_per_hour`."""
RENEWED_S: Final = 10.0
"""The longest for which emulated arms keep what they are off by, on random ways."""
_STEEPEST: Final = 12.0
"""One frame says no more: the alarm takes seven in a row, and no outlier of the tracker lasts so
long without being taken for what it is, or for the tip itself."""
_RECOVERS: Final = -1.0
"""While the alarm lasts, so much of the sum goes in a second, and no more."""
_MOST: Final = 2.0
"""Times the limit: the sum grows no further."""
_LONGEST_S: Final = 0.1
"""A gap between frames says nothing of what was in it."""
_LEAST: Final = 1e-30
_KEPT: Final = 64
"""Mixtures: those of a second and a half at 40 frames a second."""


def false_alarms_per_hour(renewed_s: float = RENEWED_S) -> float:
    """At most so many, of a body that the model describes."""
    return 3600.0 / renewed_s * exp(-REFERENCE - LIMIT_S / renewed_s)


class TipConsistency:
    """The test. A frame without a believed tip is not told to it, and counts neither way."""

    def __init__(self) -> None:
        self._sum_s = 0.0
        self._last_ns: int | None = None
        self.consistent = True
        """False from the alarm on, until the tip has been where it should be for long enough."""

    @property
    def statistic(self) -> float:
        """The sum over its limit: 1 raises the alarm, 0 takes it back."""
        return self._sum_s / LIMIT_S

    def add(self, probability: float, t_ns: int) -> bool:
        """One frame. Returns whether the tip is consistent with the model.

        probability: of a tip further out. What is not finite is evidence of nothing.
        """
        last_ns, self._last_ns = self._last_ns, t_ns
        if last_ns is None or not isfinite(probability):
            return self.consistent
        dt_s = min(max(0.0, (t_ns - last_ns) * 1e-9), _LONGEST_S)
        evidence = min(-log(max(probability, _LEAST)) - REFERENCE, _STEEPEST)
        if not self.consistent:
            evidence = max(evidence, _RECOVERS)
        self._sum_s = min(max(0.0, self._sum_s + evidence * dt_s), _MOST * LIMIT_S)
        if self._sum_s >= LIMIT_S:
            self.consistent = False
        elif self._sum_s <= 0.0:
            self.consistent = True
        return self.consistent


class TipPlace(NamedTuple):
    """A measured tip in the model's distribution."""

    probability: float
    """Of a tip further out than this one."""
    off_mm: float
    """How far it is from the mean."""
    shift: FloatArray
    """(d,) by which the shape's coefficients are likeliest to be off, as the tip is."""
    mixture: Mixture
    """Of the likeliest place of the axes."""


class TipModel:
    """The model's distribution of the tip, where its last node is."""

    def __init__(self, model: RiskModel, accuracy_mm: float) -> None:
        """accuracy_mm: standard deviation, per coordinate, of what is measured from what the model
        means by the tip: of the tracker, and of where its sensor sits."""
        self._model = model
        self._base = model.basis.base_mm[-1].astype(np.float64)
        self._modes = np.ascontiguousarray(model.basis.modes[:, -1], np.float64)
        self._variance = np.full(3, accuracy_mm**2)
        self._kept: dict[bytes, Mixture | None] = {}
        """Of the last places of the axes: each is asked for again some frames later."""

    def place(self, lately: Sequence[FloatArray], tip_mm: FloatArray) -> TipPlace | None:
        """Of a (3,) tip, with the axes lately at several (m,); None where the model cannot tell.

        A body follows its axes late. Where it is on its way from one of these to the next does not
        count against it: the likeliest of them is taken.
        """
        likeliest, at = -1.0, None
        place = np.asarray(tip_mm, np.float64)
        for u in lately:
            mixture = self._mixture(u)
            if mixture is None:
                return None
            beyond = self.beyond(mixture, place)
            if beyond > likeliest:
                likeliest, at = beyond, mixture
        return None if at is None else self._place(at, likeliest, place)

    def probability(self, u: FloatArray, tip_mm: FloatArray) -> float | None:
        """Of a tip further out than a (3,) one, with the axes at (m,) u; None: it cannot tell."""
        mixture = self._mixture(u)
        return None if mixture is None else self.beyond(mixture, np.asarray(tip_mm, np.float64))

    def _mixture(self, u: FloatArray) -> Mixture | None:
        key = u.tobytes()
        if key not in self._kept:
            if len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            known = self._model.knows(u)
            self._kept[key] = self._model.shapes.mixture(u) if known else None
        return self._kept[key]

    def beyond(self, mixture: Mixture, place: FloatArray) -> float:
        """The same in a mixture over the shape's coefficients."""
        parts = mixture.weights, mixture.means_mm, mixture.factors_per_mm
        return float(tail(*parts, self._base, self._modes, self._variance, place))

    def _place(self, mixture: Mixture, probability: float, place: FloatArray) -> TipPlace:
        """As of one normal distribution over the coefficients, with the mixture's moments."""
        shift = np.empty(mixture.dimensions)
        parts = mixture.weights, mixture.means_mm, mixture.factors_per_mm
        tip = self._base, self._modes, self._variance, place
        off_mm = float(likeliest_shift(*parts, *tip, shift))
        return TipPlace(probability, off_mm, shift, mixture)
