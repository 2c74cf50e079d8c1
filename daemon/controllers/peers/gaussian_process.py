"""Gaussian processes of what the axes do to the tip, inverted at every step, which go on learning.

One process is of the exploration and stays as it is; its settings are those that make the
exploration most likely. A second one is of what the first leaves unexplained in the motions of
late, and forgets: what it forgets falls back to the exploration. The axes' step is the one of
damped least squares over the Jacobian that both say together.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from config.robot import Robot
from config.tasks.controllers import Learner
from config.tasks.peers import GaussianProcess
from daemon.array_files import prefixed, stripped
from daemon.controllers.forward_jacobian import JacobianController
from daemon.controllers.peers.motion_process import Covariance, MotionProcess, most_likely
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.forward.stop_operators import HeldBack
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector

_MOST_MOTIONS: Final = 1500
"""Evenly from all of the exploration's: more take longer to work in and tell little more."""
_RELATIVE_NOISE: Final = 0.1
"""Hysteresis and curvature: the part of a motion of the tip that no Jacobian explains."""
_KNOWN: Final = 0.5
"""Of the Jacobian's variance, that may be left where the exploration is believed."""
_CHANGE, _LENGTH = 0.4, 0.5
"""Of a body that was not explored: v by c, and the length in ranges."""
_ONLINE: Final = "online/"


class ProcessJacobian:
    """A `TipJacobian`. Axes count in shares of their range within."""

    def __init__(self, options: GaussianProcess, scale: Vector) -> None:
        """scale: (m,) the axes' ranges."""
        self.forward: Lwpr | None = None
        self.believed = 1.0
        self._options = options
        self._scale = scale
        self._explored: MotionProcess | None = None
        self._constant: Vector | None = None
        """(3, m) what the processes are round; None: nothing is known."""
        self._online = self._process(options.difference_mm, _LENGTH)

    @property
    def known(self) -> bool:
        """Whether there is a Jacobian at all."""
        return self._constant is not None

    @property
    def modelled(self) -> bool:
        """Whether an exploration tells what a motion should do."""
        return self._explored is not None

    @property
    def contradicted(self) -> bool:
        """Never: it goes on with what it has, as it was published."""
        return False

    @property
    def held_back(self) -> HeldBack:
        """Processes are of motions as they are: nobody knows."""
        return HeldBack(None, np.zeros_like(self._scale), self._scale)

    def begin(self, model: PretrainedModel) -> None:
        """Learn the exploration, and go by it from now on."""
        motions = model.motions
        kept = slice(None, None, 1 + (len(motions) - 1) // _MOST_MOTIONS)
        moves = motions.delta_u[kept] / self._scale
        places = motions.u[kept] / self._scale + 0.5 * moves
        tip_moved = motions.delta_tip_mm[kept]
        covariance, noise_mm = most_likely(places, moves, tip_moved)
        axes = len(self._scale)
        explored = MotionProcess(covariance, self._options.budget, np.inf, axes)
        for x, d, seen in zip(places, moves, tip_moved, strict=True):
            explored.add(x, d, seen, noise_mm)
        self._explored = explored
        self._constant = np.zeros((3, axes))
        self._online = self._process(self._options.difference_mm, covariance.length)

    def measured(self, jacobian: Vector) -> None:
        """There is no exploration, but this is how the tip answers here: (3, m) per mm or rad."""
        self._constant = jacobian * self._scale
        size_mm = float(np.sqrt((self._constant**2).mean()))
        self._online = self._process(_CHANGE * size_mm, _LENGTH)

    def covered(self, tip_mm: Vector, u: Vector) -> float:
        """How far the exploration is believed here, 0 to 1."""
        del tip_mm
        if self._explored is None:
            return 0.0
        return min((1.0 - self._explored.unknown(u / self._scale)) / (1.0 - _KNOWN), 1.0)

    def at(self, tip_mm: Vector, u: Vector) -> Vector:
        """(3, m) mm per mm or rad."""
        del tip_mm
        x = u / self._scale
        return np.asarray(
            (self._before(x) + self.believed * self._online.jacobian(x)) / self._scale
        )

    def learn(self, sample: MotionSample, gains: Vector) -> None:
        """Take a motion, as it was told: (3,) gains of it came, which are made up for."""
        del gains
        d = sample.delta_u / self._scale
        x = sample.u / self._scale + 0.5 * d
        seen = sample.delta_tip_mm
        relative_mm = _RELATIVE_NOISE * float(np.sqrt(seen @ seen))
        noise_mm = float(np.hypot(self._options.sample_noise_mm, relative_mm))
        self._online.add(x, d, seen - self._before(x) @ d, noise_mm)

    def body_changed(self) -> None:
        """It learns of another body as of any."""

    def to_arrays(self) -> dict[str, Vector]:
        """What was learnt since the exploration."""
        assert self._constant is not None
        online = prefixed(_ONLINE, self._online.to_arrays())
        return {"constant": self._constant, "settings": self._settings, **online}

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, and ValueError for other axes."""
        constant, settings = np.array(arrays["constant"]), arrays["settings"].tolist()
        if constant.shape != (3, len(self._scale)):
            raise ValueError(f"its Jacobian is not for {len(self._scale)} axes")
        online = self._process(settings[1], settings[2])
        online.restore(stripped(_ONLINE, dict(arrays)))
        self._constant, self._online = constant, online

    @property
    def _settings(self) -> Vector:
        return np.array(self._online.covariance)

    def _process(self, change_mm: float, length: float) -> MotionProcess:
        """Of what is learnt while it works: as much all over as from place to place."""
        covariance = Covariance(change_mm, change_mm, length)
        options = self._options
        return MotionProcess(covariance, options.budget, options.memory_samples, len(self._scale))

    def _before(self, x: Vector) -> Vector:
        """(3, m) mm by range, without what was learnt of late."""
        assert self._constant is not None
        if self._explored is None:
            return self._constant
        return np.asarray(self._constant + self._explored.jacobian(x))


class GaussianProcessController(JacobianController):
    """A `Controller`."""

    name = "gaussian_process"

    def __init__(self, options: GaussianProcess, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._process_options = options
        super().__init__(options.of_law(Learner), robot, seed)

    def _new_jacobian(self) -> ProcessJacobian:
        return ProcessJacobian(self._process_options, self._range)
