"""What pre-training knows in each field, as mean sums that count like a few samples.

A field that the window has nothing to say about keeps the controller that pre-training gave it;
where the robot is, new samples soon outweigh it.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np

from daemon.learning.inverse.local_controller_kernels import Sums, geometry_of, log_weights_of
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.reward import costs, reward_scales, rewarded_products
from daemon.learning.inverse.window import PLACE, RegressionWindow, Regressors
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

_FIELDS_AT_ONCE = 256


class _Source(NamedTuple):
    """What pre-training saw: products (n, F), places (n, d) from `middle`, u and delta_u (n, m)."""

    products: Vector
    places: Vector
    middle: Vector
    u: Vector
    delta_u: Vector
    fields: ReceptiveFields
    settings: LocalControllerSettings


class Prior:
    """products: (f, F) Σ W φ / Σ W. mass: (f,) as how many samples they count; 0 where unknown."""

    def __init__(
        self, products: Vector, mass: Vector, posture: Vector, source: _Source | None = None
    ) -> None:
        self.products = products
        self.mass = mass
        self.posture = posture
        """(m,) u₀ that the samples were rewarded for."""
        self._source = source

    @classmethod
    def of(
        cls,
        samples: Iterable[MotionSample],
        fields: ReceptiveFields,
        settings: LocalControllerSettings,
        posture: Vector,
    ) -> Self:
        """From samples, which are kept to be weighed anew for other postures.

        Raises ValueError.
        """
        kept = list(samples)
        regressors = Regressors(fields, settings)
        window = RegressionWindow(max(1, len(kept)), regressors, settings, posture)
        window.refill(kept)
        seen = slice(len(kept))
        source = _Source(
            window.products[seen],
            np.ascontiguousarray(window.rows[seen, PLACE:]),
            regressors.middle,
            window.samples.u[seen],
            window.samples.delta_u[seen],
            fields,
            settings,
        )
        return cls(*_weighed(source, window.posture), window.posture, source)

    @property
    def sums(self) -> Sums:
        """For the kernels."""
        return Sums(self.products, self.mass)

    @classmethod
    def nothing(cls, fields: ReceptiveFields, settings: LocalControllerSettings) -> Self:
        """No pre-training."""
        count = Regressors(fields, settings).products_count
        return cls(np.zeros((fields.count, count)), np.zeros(fields.count), np.zeros(settings.axes))

    def towards(self, posture: Vector) -> "Prior":
        """The same samples, rewarded for another posture. Without samples it stays as it is."""
        if self._source is None or np.array_equal(posture, self.posture):
            return self
        return Prior(*_weighed(self._source, posture), posture, self._source)

    def to_arrays(self) -> dict[str, Vector]:
        """For a file; the samples are not among them."""
        return {"products": self.products, "mass": self.mass, "posture": self.posture}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, Vector],
        fields: ReceptiveFields,
        settings: LocalControllerSettings,
    ) -> Self:
        """What `to_arrays` gave. Raises ValueError if it does not fit the fields."""
        fitting = cls.nothing(fields, settings)
        found = {}
        for name, expected in fitting.to_arrays().items():
            if name not in arrays:
                raise ValueError(f"the prior has no {name}")
            found[name] = np.array(arrays[name], dtype=np.float64)
            if found[name].shape != expected.shape or not np.isfinite(found[name]).all():
                raise ValueError(f"the prior's {name} do not fit {fields.count} fields")
        return cls(found["products"], found["mass"], found["posture"])


def prior_for(
    prior: Prior | None,
    fields: ReceptiveFields,
    settings: LocalControllerSettings,
    posture: Vector,
) -> Prior:
    """`prior` as an engine needs it. Raises ValueError if it was made for other fields."""
    nothing = Prior.nothing(fields, settings)
    if prior is None:
        return nothing
    if prior.products.shape != nothing.products.shape:
        raise ValueError(
            f"the prior is for {prior.products.shape} fields and products, "
            f"not for {nothing.products.shape}"
        )
    return prior.towards(posture)


def _weighed(source: _Source, posture: Vector) -> tuple[Vector, Vector]:
    """(f, F) mean products and (f,) mass of the samples, rewarded for `posture`."""
    settings, fields = source.settings, source.fields
    means = np.zeros((fields.count, source.products.shape[1]))
    mass = np.zeros(fields.count)
    if len(source.u):
        cost = costs(settings, source.u, source.delta_u, posture)
        for start in range(0, fields.count, _FIELDS_AT_ONCE):
            part = slice(start, start + _FIELDS_AT_ONCE)
            geometry = geometry_of(fields, source.middle, part)
            log_weights = log_weights_of(geometry, source.places)
            scales, mass[part] = reward_scales(settings, np.exp(log_weights), cost)
            work = np.empty_like(log_weights)
            rewarded_products(log_weights, cost, scales, source.products, work, means[part])
        means /= means[:, :1]
    mass[mass < settings.minimum_mass] = 0.0
    return means, np.minimum(mass, settings.prior_mass)
