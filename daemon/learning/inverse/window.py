"""What local controllers are regressed on: a fixed number of samples, the oldest leaves first.

Row x = [1, Δp, p, u], target y = Δu, in numbers of order one. Places count in the fields' scale
from the middle of all fields, steps in typical steps. All fields share these rows, so that one
matrix product gives all weighted sums; each field's own centre is taken off the sums (see
`solve_fields`).
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from daemon.learning.inverse.local_controller_kernels import products_of
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.reward import costs
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


class Window:
    """FIFO of motion samples in ring buffers: nothing is allocated after the start.

    Slot k holds tip_mm[k] (3,), u[k] (m,), delta_u[k] (m,) and delta_tip_mm[k] (3,). Slots do not
    move while their sample is in the window, so that others may keep arrays beside them.
    """

    def __init__(self, capacity: int, axes: int) -> None:
        if capacity < 1 or axes < 1:
            raise ValueError(f"no window of {capacity} samples of {axes} axes")
        self.capacity = capacity
        self.axes = axes
        self._shapes = (3,), (axes,), (axes,), (3,)
        self.tip_mm = np.zeros((capacity, 3))
        self.u = np.zeros((capacity, axes))
        self.delta_u = np.zeros((capacity, axes))
        self.delta_tip_mm = np.zeros((capacity, 3))
        self.count = 0
        self.slot = 0
        """Where the next sample goes. When the window is full, the oldest is there."""

    @property
    def full(self) -> bool:
        """Whether the next sample pushes the oldest one out."""
        return self.count == self.capacity

    def check_shapes(self, sample: MotionSample) -> None:
        """Raise ValueError for a sample that is not of this robot."""
        for name, value, expected in zip(sample._fields, sample, self._shapes, strict=True):
            if value.shape != expected:
                raise ValueError(f"sample's {name}: shape {value.shape}, expected {expected}")

    def check(self, sample: MotionSample) -> None:
        """Raise ValueError for a sample that is not finite, or not of this robot."""
        self.check_shapes(sample)
        for name, value in zip(sample._fields, sample, strict=True):
            if not np.isfinite(value).all():
                raise ValueError(f"sample's {name} is not finite: {value}")

    def add(self, sample: MotionSample) -> MotionSample | None:
        """Take `sample` in; give what fell out. Raises ValueError, and nothing changes then."""
        self.check(sample)
        fallen = self._at(self.slot) if self.full else None
        self.store(sample)
        return fallen

    def store(self, sample: MotionSample) -> None:
        """Take in a sample that was checked."""
        slot = self.slot
        self.tip_mm[slot] = sample.tip_mm
        self.u[slot] = sample.u
        self.delta_u[slot] = sample.delta_u
        self.delta_tip_mm[slot] = sample.delta_tip_mm
        self.slot = (slot + 1) % self.capacity
        self.count = min(self.count + 1, self.capacity)

    def clear(self) -> None:
        """Forget all samples."""
        self.count = 0
        self.slot = 0

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[MotionSample]:
        """Copies of the samples, oldest first."""
        oldest = self.slot - self.count
        for index in range(self.count):
            yield self._at((oldest + index) % self.capacity)

    def _at(self, slot: int) -> MotionSample:
        rows: tuple[Vector, ...] = (self.tip_mm, self.u, self.delta_u, self.delta_tip_mm)
        return MotionSample(*(row[slot].copy() for row in rows))


# The window as the engines see it: rows, targets and costs beside the samples they come from.


class RegressionWindow:
    """Slot k holds rows[k] (P,), targets[k] (m,), cost[k] and products[k] (F,) of sample k."""

    def __init__(
        self,
        capacity: int,
        regressors: Regressors,
        settings: LocalControllerSettings,
        posture: Vector,
    ) -> None:
        """posture: (m,) u₀, which costs are counted against."""
        self.samples = Window(capacity, regressors.axes)
        self._regressors = regressors
        self._settings = settings
        self.posture = checked_posture(posture, regressors.axes)
        self.rows = np.zeros((capacity, regressors.count))
        self.targets = np.zeros((capacity, regressors.axes))
        self.cost = np.zeros(capacity)
        self.products = np.zeros((capacity, regressors.products_count))
        self.new_row = np.zeros(regressors.count)
        self.new_target = np.zeros(regressors.axes)
        self.new_products = np.zeros(regressors.products_count)

    @property
    def count(self) -> int:
        return self.samples.count

    def prepare(self, sample: MotionSample) -> float:
        """Fill the three of the next sample, and give its cost. Raises ValueError.

        The window stays as it is until `store`.
        """
        self.samples.check_shapes(sample)
        self._regressors.sample(sample, self.new_row, self.new_target)
        products_of(self.new_row, self.new_target, self.new_products)
        return float(costs(self._settings, sample.u, sample.delta_u, self.posture))

    def store(self, sample: MotionSample, cost: float) -> None:
        """Take in the sample that was prepared."""
        slot = self.samples.slot
        self.rows[slot] = self.new_row
        self.targets[slot] = self.new_target
        self.products[slot] = self.new_products
        self.cost[slot] = cost
        self.samples.store(sample)

    def put(self, sample: MotionSample) -> int:
        """Both; give the slot."""
        slot = self.samples.slot
        self.store(sample, self.prepare(sample))
        return slot

    def refill(self, samples: Iterable[MotionSample]) -> None:
        """Forget all and take `samples`, oldest first. Raises ValueError; nothing changes then."""
        kept = list(samples)[-self.samples.capacity :]
        for sample in kept:
            self.samples.check(sample)
        rows, targets = self._regressors.samples(kept)
        self.samples.clear()
        for sample in kept:
            self.samples.store(sample)
        here = slice(len(kept))
        self.rows[here] = rows
        self.targets[here] = targets
        self.products[here] = self._regressors.products(rows, targets)
        self._count_costs()

    def set_posture(self, posture: Vector) -> bool:
        """Count the costs of all samples against another posture. Raises ValueError.

        False: it is the one they are counted against already.
        """
        checked = checked_posture(posture, self._regressors.axes)
        if np.array_equal(checked, self.posture):
            return False
        self.posture = checked
        self._count_costs()
        return True

    def _count_costs(self) -> None:
        window = self.samples
        self.cost[:] = costs(self._settings, window.u, window.delta_u, self.posture)


def checked_posture(posture: Vector, axes: int) -> Vector:
    """A copy of (m,) u₀. Raises ValueError."""
    checked = np.array(posture, dtype=np.float64)
    if checked.shape != (axes,) or not np.isfinite(checked).all():
        raise ValueError(f"a posture is {axes} finite numbers, not {posture}")
    return checked
