"""Local inverse controllers as `reward_weighted` uses them: settings, making, and keeping."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from config.tasks.controllers import RewardWeighted
from daemon.control.redundancy import Redundancy, damped_solution
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.inverse.engines import make_local_controllers
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import LocalControllers
from daemon.learning.inverse.prior import Prior
from daemon.learning.inverse.reward import attractor_step
from daemon.learning.inverse.window import Regressors, Window
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

# What a field's controller is before any sample has come: the inverse of the forward model there.
#
# Regression over pre-training's samples is a poor start. Within a field the Jacobian changes, and
# so the same Δp has come from different Δu: regression takes that for noise and asks for too
# little, most of all along the directions in which the tip hardly moves. The forward model knows
# better. So motions are imagined in each field, and what the axes would do for them by its
# inverse: of all steps that make the motion the one nearest to the attractor's, which is what
# reward-weighted regression comes to with sharp rewards and very many samples.


class LocalInverses(NamedTuple):
    """What is known of f fields."""

    jacobians: Vector
    """(f, 3, m) mm per mm or rad, at the fields' centres."""
    inverses: Vector
    """(f, m, 3)"""

    @classmethod
    def of(cls, jacobians: Vector, redundancy: Redundancy) -> "LocalInverses":
        """By damped least squares."""
        inverses = np.zeros(jacobians.transpose(0, 2, 1).shape)
        unit = redundancy.unit
        for jacobian, inverse in zip(jacobians, inverses, strict=True):
            damping_mm = redundancy.damping_mm(jacobian)
            for column, direction in zip(inverse.T, np.eye(3), strict=True):
                column[:] = unit * damped_solution(jacobian * unit, direction, damping_mm)
        return cls(jacobians, inverses)

    def steps(self, tip_steps: Vector, attracted: Vector) -> Vector:
        """(f, n, m) steps of the axes for (f, n, 3) of the tip, near (f, n, m) the attractor's."""
        missing = tip_steps - attracted @ self.jacobians.transpose(0, 2, 1)
        result: Vector = attracted + missing @ self.inverses.transpose(0, 2, 1)
        return result


class ImaginedPrior(Prior):
    """A `Prior` made of motions that a forward model makes up."""

    def __init__(
        self,
        fields: ReceptiveFields,
        settings: LocalControllerSettings,
        local: LocalInverses,
        posture: Vector,
    ) -> None:
        self._parts = fields, settings, local
        products = _mean_products(fields, settings, local, posture)
        mass = np.full(fields.count, settings.prior_mass)
        super().__init__(products, mass, np.array(posture, dtype=np.float64))

    def towards(self, posture: Vector) -> Prior:
        """The same motions, made near another posture."""
        if np.array_equal(posture, self.posture):
            return self
        return ImaginedPrior(*self._parts, posture)


def _mean_products(
    fields: ReceptiveFields,
    settings: LocalControllerSettings,
    local: LocalInverses,
    posture: Vector,
) -> Vector:
    """(f, F) mean of φ over the motions imagined in each field.

    All of Δp, p and u are varied at once, up or down by a standard deviation, in a pattern that
    leaves them uncorrelated. p and u are spread as the field's kernel is.
    """
    regressors = Regressors(fields, settings)
    axes, places = settings.axes, len(fields.scale)
    pattern = _hadamard(1 << (3 + places).bit_length())[:, 1 : 4 + places]
    tip_steps = np.broadcast_to(
        settings.tip_step_mm / np.sqrt(3.0) * pattern[:, :3], (fields.count, len(pattern), 3)
    )
    wide = np.broadcast_to(pattern[:, 3:].T, (fields.count, places, len(pattern)))
    spread = np.linalg.solve(fields.roots, wide)
    at = fields.centres[:, None, :] + spread.transpose(0, 2, 1)
    us = at[..., 3:] * fields.scale[3:]
    attracted = attractor_step(settings, us, posture) * settings.axis_steps
    targets = local.steps(tip_steps, attracted) / settings.axis_steps
    rows = np.concatenate(
        [np.ones((*at.shape[:2], 1)), tip_steps / settings.tip_step_mm, at - regressors.middle],
        axis=2,
    )
    products = regressors.products(
        rows.reshape(-1, regressors.count), targets.reshape(-1, axes)
    ).reshape(fields.count, len(pattern), -1)
    mean: Vector = products.mean(axis=1)
    return mean


def _hadamard(order: int) -> Vector:
    """(n, n) of ±1 whose columns are orthogonal (Sylvester). order: n, a power of two."""
    pattern = np.ones((1, 1))
    while len(pattern) < order:
        pattern = np.block([[pattern, pattern], [pattern, -pattern]])
    return pattern


_TYPICAL_STEP_SHARE = 0.01
"""Of an axis' travel, in a sample."""
_WINDOW = ("tip_mm", "u", "delta_u", "delta_tip_mm")


class LocalLaw:
    """Makes local controllers with one controller's options for one robot."""

    def __init__(self, options: RewardWeighted, axes: AxisRanges, redundancy: Redundancy) -> None:
        self._options = options
        self._redundancy = redundancy
        self.settings = _settings(options, axes, redundancy.posture_gain_per_s)

    def on_model(self, model: PretrainedModel, posture: Vector) -> LocalControllers:
        """On the fields of a forward model, before any sample. Raises ValueError."""
        fields = model.fields
        if self._options.unvisited == "forward_model":
            places = fields.centres * fields.scale
            jacobians = [model.jacobian(place[:3], place[3:]) for place in places]
            return self.on_fields(fields, np.array(jacobians), posture)
        prior = None
        if self._options.unvisited == "samples":
            prior = Prior.of(model.motions.samples(), fields, self.settings, posture)
        return self._made(fields, posture, prior)

    def on_fields(
        self, fields: ReceptiveFields, jacobians: Vector, posture: Vector
    ) -> LocalControllers:
        """On fields in which (f, 3, m) Jacobians are known. Raises ValueError."""
        local = LocalInverses.of(jacobians, self._redundancy)
        return self._made(fields, posture, ImaginedPrior(fields, self.settings, local, posture))

    def _made(
        self, fields: ReceptiveFields, posture: Vector, prior: Prior | None
    ) -> LocalControllers:
        options = self._options
        return make_local_controllers(
            options.engine, fields, self.settings, options.window, posture, prior
        )


def window_arrays(window: Window) -> dict[str, NDArray[np.float64]]:
    """The samples, oldest first, for a file."""
    samples = list(window)
    return {
        f"window_{name}": np.array([getattr(sample, name) for sample in samples]).reshape(
            len(samples), getattr(window, name).shape[1]
        )
        for name in _WINDOW
    }


def window_samples(arrays: Mapping[str, Vector]) -> list[MotionSample]:
    """What `window_arrays` gave. Raises KeyError, ValueError."""
    columns = [arrays[f"window_{name}"] for name in _WINDOW]
    return [MotionSample(*row) for row in zip(*columns, strict=True)]


def _settings(
    options: RewardWeighted, axes: AxisRanges, posture_gain_per_s: float
) -> LocalControllerSettings:
    """Steps count in the controller's own samples, axes in shares of their travel."""
    weights = np.ones(axes.count) if options.axis_weights is None else options.axis_weights
    return LocalControllerSettings(
        tip_step_mm=options.sample_tip_mm,
        axis_steps=_TYPICAL_STEP_SHARE * axes.scale,
        weighting=np.array(weights) / np.sum(weights),
        attractor_gain=min(posture_gain_per_s * options.motion_s, 0.9),
        attractor_steps=options.attractor_steps,
        sigma_rule=options.sigma_rule,
        kappa=options.kappa,
        ridge=options.ridge,
        prior_mass=options.prior_mass,
    )
