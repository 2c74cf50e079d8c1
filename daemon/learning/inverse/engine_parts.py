"""What engines have in common: window and prior, and the controllers after they were solved."""

import numpy as np

from daemon.learning.inverse.local_controller_kernels import (
    IndexArray,
    Solutions,
    Sums,
    blend,
    geometry_of,
    log_weights,
    solve_fields,
)
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import InverseAnswer
from daemon.learning.inverse.prior import Prior, prior_for
from daemon.learning.inverse.window import PLACE, RegressionWindow, Regressors, Window
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector


class Engine:
    """The part of `LocalControllers` that is the same in all of them."""

    def __init__(
        self,
        fields: ReceptiveFields,
        settings: LocalControllerSettings,
        capacity: int,
        posture: Vector,
        prior: Prior | None = None,
    ) -> None:
        self.fields = fields
        self._settings = settings
        self._regressors = Regressors(fields, settings)
        self._data = RegressionWindow(capacity, self._regressors, settings, posture)
        self._prior = prior_for(prior, fields, settings, self._data.posture)

    @property
    def window(self) -> Window:
        return self._data.samples

    @property
    def posture(self) -> Vector:
        return self._data.posture.copy()

    def set_posture(self, posture: Vector) -> None:
        if self._data.set_posture(posture):
            self._prior = self._prior.towards(self._data.posture)
            self._forget()

    def _forget(self) -> None:
        """What was worked out for another posture."""


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

    def answer(self) -> InverseAnswer:
        """The command for the query that `ask` took."""
        here = self.log_weights[0]
        support = blend(self._row, here, self._cutoff, self._solutions, self._answer)
        activation = float(np.exp(here.max(initial=-np.inf)))
        return InverseAnswer(self._answer * self._regressors.axis_steps, activation, support)

    def nothing(self) -> InverseAnswer:
        """The answer to a query that cannot be answered."""
        return InverseAnswer(np.zeros(self._regressors.axes), 0.0, 0.0)
