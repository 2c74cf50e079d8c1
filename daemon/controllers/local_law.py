"""Local inverse controllers as `reward_weighted` uses them: settings, making, and keeping."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from config.controllers import RewardWeighted
from daemon.controllers.imagined_prior import ImaginedPrior, LocalInverses
from daemon.learning.forward.forward_model import slopes_by_step
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.inverse.engines import make_local_controllers
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import LocalControllers
from daemon.learning.inverse.prior import Prior
from daemon.learning.inverse.window import Window
from daemon.learning.samples.motion_sample import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_TYPICAL_STEP_SHARE = 0.01
"""Of an axis' travel, in a sample."""
_WINDOW = ("tip_mm", "u", "delta_u", "delta_tip_mm")


class LocalLaw:
    """Makes local controllers with one controller's options for one robot."""

    def __init__(
        self, options: RewardWeighted, axes: AxisRanges, unit: Vector, damping_mm: float
    ) -> None:
        """unit: (m,) how far each axis goes for the price of 1."""
        self._options = options
        self._unit = unit
        self._damping_mm = damping_mm
        self.settings = _settings(options, axes)

    def on_model(self, model: PretrainedModel, posture: Vector) -> LocalControllers:
        """On the fields of a forward model, before any sample. Raises ValueError."""
        fields = model.fields
        if self._options.unvisited == "forward_model":
            places = fields.centres * fields.scale
            jacobians = [slopes_by_step(model.lwpr, place[:3], place[3:]) for place in places]
            return self.on_fields(fields, np.array(jacobians), posture)
        prior = None
        if self._options.unvisited == "samples":
            prior = Prior.of(model.motions.samples(), fields, self.settings, posture)
        return self._made(fields, posture, prior)

    def on_fields(
        self, fields: ReceptiveFields, jacobians: Vector, posture: Vector
    ) -> LocalControllers:
        """On fields in which (f, 3, m) Jacobians are known. Raises ValueError."""
        local = LocalInverses.of(jacobians, self._unit, self._damping_mm)
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


def _settings(options: RewardWeighted, axes: AxisRanges) -> LocalControllerSettings:
    """Steps count in the controller's own samples, axes in shares of their travel."""
    weights = np.ones(axes.count) if options.axis_weights is None else options.axis_weights
    return LocalControllerSettings(
        tip_step_mm=options.sample_tip_mm,
        axis_steps=_TYPICAL_STEP_SHARE * axes.travel,
        weighting=np.array(weights) / np.sum(weights),
        attractor_gain=min(options.posture_gain_per_s * options.motion_s, 0.9),
        attractor_steps=options.attractor_steps,
        sigma_rule=options.sigma_rule,
        kappa=options.kappa,
        ridge=options.ridge,
        prior_mass=options.prior_mass,
    )
