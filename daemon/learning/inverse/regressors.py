"""What local controllers regress on, in numbers of order one, and products of them to sum up.

Row x = [1, Δp, p, u], target y = Δu. Places count in the fields' scale from the middle of all
fields, steps in typical steps. All fields share these rows, so that one matrix product gives all
weighted sums; each field's own centre is taken off the sums (see `solve_fields`).
"""

from collections.abc import Sequence

import numpy as np

from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

PLACE = 4
"""Where the place [p, u] begins in a row x."""

_LARGEST = 1e3
"""A regressor or target beyond it is nothing of this robot's, and would drown what is summed."""


class Regressors:
    """P = 7 + m regressors, m targets, F = P (P+1)/2 + P m products: xxᵀ's upper half and xyᵀ."""

    def __init__(self, fields: ReceptiveFields, settings: LocalControllerSettings) -> None:
        if fields.axes != settings.axes:
            raise ValueError(
                f"the receptive fields are for {fields.axes} axes, the settings for {settings.axes}"
            )
        self.scale = fields.scale
        self.middle = fields.centres.mean(axis=0) if fields.count else np.zeros(len(fields.scale))
        """(3+m,) origin of places, counted in `scale`."""
        self.tip_step_mm = settings.tip_step_mm
        self.axis_steps = settings.axis_steps
        self.axes = settings.axes
        self.count = PLACE + 3 + self.axes
        self._first, self._second = np.triu_indices(self.count)
        self.products_count = len(self._first) + self.count * self.axes

    def query(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector, out: Vector) -> None:
        """Write the row x of a wanted Δp at a place into `out`, (P,)."""
        out[0] = 1.0
        out[1:4] = delta_tip_mm
        out[1:4] /= self.tip_step_mm
        out[4:7] = tip_mm
        out[7:] = u
        place = out[PLACE:]
        place /= self.scale
        place -= self.middle

    def known(self, row: Vector) -> bool:
        """Whether a row is finite and not absurdly far away."""
        return bool(np.abs(row).max() <= _LARGEST)

    def sample(self, sample: MotionSample, row: Vector, target: Vector) -> None:
        """Write x and y of `sample`. Raises ValueError for one that is far beyond all scales."""
        self.query(sample.delta_tip_mm, sample.tip_mm, sample.u, row)
        np.divide(sample.delta_u, self.axis_steps, out=target)
        if not (self.known(row) and self.known(target)):
            raise _unknown(np.r_[row, target])

    def samples(self, samples: Sequence[MotionSample]) -> tuple[Vector, Vector]:
        """(n, P) x and (n, m) y of many samples. Raises ValueError as `sample` does."""
        rows = np.ones((len(samples), self.count))
        targets = np.zeros((len(samples), self.axes))
        for row, target, sample in zip(rows, targets, samples, strict=True):
            row[1:PLACE] = sample.delta_tip_mm
            row[PLACE : PLACE + 3] = sample.tip_mm
            row[PLACE + 3 :] = sample.u
            target[:] = sample.delta_u
        rows[:, 1:PLACE] /= self.tip_step_mm
        rows[:, PLACE:] = rows[:, PLACE:] / self.scale - self.middle
        targets /= self.axis_steps
        largest = max(np.abs(rows).max(initial=0.0), np.abs(targets).max(initial=0.0))
        if not largest <= _LARGEST:
            raise _unknown(np.array([largest]))
        return rows, targets

    def products(self, rows: Vector, targets: Vector) -> Vector:
        """(n, F) φ of (n, P) x and (n, m) y."""
        cross = rows[:, :, None] * targets[:, None, :]
        grams = rows[:, self._first] * rows[:, self._second]
        return np.hstack([grams, cross.reshape(len(rows), self.count * self.axes)])

    def centred(self, beta: Vector, centres: Vector) -> Vector:
        """β for [Δp, p − c, u − c, 1], (…, P, m), from β for rows x and (…, d) centres c."""
        slopes = beta[..., 1:, :]
        bias = beta[..., 0, :] + np.einsum(
            "...d,...dm->...m", centres - self.middle, slopes[..., PLACE - 1 :, :]
        )
        return np.concatenate([slopes, bias[..., None, :]], axis=-2)

    def unpack(self, products: Vector) -> tuple[Vector, Vector]:
        """(P, P) xxᵀ and (P, m) xyᵀ of one (F,) row of products."""
        gram = np.zeros((self.count, self.count))
        gram[self._first, self._second] = products[: len(self._first)]
        gram[self._second, self._first] = products[: len(self._first)]
        return gram, products[len(self._first) :].reshape(self.count, self.axes)


def _unknown(numbers: Vector) -> ValueError:
    if not np.isfinite(numbers).all():
        return ValueError("a sample is not finite")
    return ValueError(
        f"a sample is {np.abs(numbers).max():g} times the scale of the fields or steps: "
        "not a motion of this robot, or the scales are wrong"
    )
