"""The controllers after they were solved, and what they answer together."""

import numpy as np

from daemon.learning.inverse.local_controller_kernels import (
    Geometry,
    IndexArray,
    Solutions,
    Sums,
    blend,
    log_weights,
    solve_fields,
)
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import Command
from daemon.learning.inverse.regressors import PLACE, Regressors
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

# Receptive fields as the kernels want them: coordinate by coordinate, all fields side by side.


def geometry_of(fields: ReceptiveFields, middle: Vector, part: slice = slice(None)) -> Geometry:
    """Of some of the fields; centres count from (d,) `middle`."""
    centres, roots = fields.centres[part], fields.roots[part]
    used = np.abs(roots).max(axis=0, initial=0.0) > 0.0
    reach = np.array([1 + np.flatnonzero(row).max(initial=a) for a, row in enumerate(used)])
    return Geometry(
        np.ascontiguousarray((centres - middle).T),
        np.ascontiguousarray(roots.transpose(1, 2, 0)),
        reach.astype(np.int64),
    )


def log_weights_of(geometry: Geometry, places: Vector) -> Vector:
    """(f, n) ln w of (n, d) places, counted from the geometry's middle."""
    weights = np.empty((len(places), geometry.centres.shape[1]))
    log_weights(geometry, places, weights)
    return np.ascontiguousarray(weights.T)


class SolvedFields:
    """What the engines that keep sums have in common."""

    def __init__(
        self,
        fields: ReceptiveFields,
        regressors: Regressors,
        settings: LocalControllerSettings,
        cutoff: float = -np.inf,
    ) -> None:
        """cutoff: fields with a smaller log weight against the largest are left out of answers."""
        p, m = regressors.count, regressors.axes
        self._fields = fields
        self._regressors = regressors
        self._settings = settings
        self._cutoff = cutoff
        self.geometry = geometry_of(fields, regressors.middle)
        packed = np.zeros((fields.count, regressors.products_count))
        self._solutions = Solutions(packed, np.zeros(fields.count))
        self._beta = packed[:, -p * m :].reshape(fields.count, p, m)
        self._row = np.zeros(p)
        self._place = self._row[None, PLACE:]
        self.log_weights = np.zeros((1, fields.count))
        self._answer = np.zeros(m)

    @property
    def parameters(self) -> Vector:
        """(f, P, m), see `LocalControllers.parameters`."""
        beta = self._beta * (self._solutions.mass > 0.0)[:, None, None]
        return self._regressors.centred(beta, self._fields.centres)

    def solve(self, which: IndexArray, window: Sums, prior: Sums) -> None:
        """Solve the fields `which` from their sums."""
        asked = self._settings
        solutions = self._solutions
        solve_fields(which, asked.axes, window, prior, asked.ridge, asked.minimum_mass, solutions)

    def ask(self, delta_tip_mm: Vector, tip_mm: Vector, u: Vector) -> bool:
        """Take a query, and fill log_weights for it. False: it is not finite, or far off."""
        self._regressors.query(delta_tip_mm, tip_mm, u, self._row)
        if not self._regressors.known(self._row):
            return False
        log_weights(self.geometry, self._place, self.log_weights)
        return True

    def answer(self) -> Command:
        """The command for the query that `ask` took."""
        here = self.log_weights[0]
        support = blend(self._row, here, self._cutoff, self._solutions, self._answer)
        activation = float(np.exp(here.max(initial=-np.inf)))
        return Command(self._answer * self._regressors.axis_steps, activation, support)

    def nothing(self) -> Command:
        """The answer to a query that cannot be answered."""
        return Command(np.zeros(self._regressors.axes), 0.0, 0.0)
