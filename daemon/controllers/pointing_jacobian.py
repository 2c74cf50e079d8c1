"""How the tip's direction answers to the axes: models that were learnt are of its position.

Where a reference says where to point, the direction's rows are fitted to the first motions, and
then corrected by every motion, as the controller `broyden` does it: position and direction
together, so that the tip's whole task is what a motion is held against.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from config.tasks.controllers import Learner
from daemon.control.controller import ControllerError, Observation
from daemon.control.jacobian_estimate import FIRST_STD_MM, JacobianEstimate
from daemon.control.jacobian_kernels import in_rows
from daemon.control.task import POSE, POSITION, task_of
from daemon.controllers.learnt_jacobian import CARRIED_DRIFT_MM
from drivers.pose import Vector

_FRAMES_PER_AXIS: Final = 20
"""So many must the first motions give before rows are fitted: two seconds of motion for four axes.
"""
_RIDGE: Final = 1e-4
"""Of the mean square of the axes' motion."""
_MOVED_SHARE: Final = 0.005
"""A motion ends when the axes have gone so far, in shares of their range, and the tip too."""
_TASK_SHARE: Final = 0.5
"""Of the tip's way in a sample of the controller's: nothing but motions tells how the rows change.
"""


class PointingJacobian:
    """Axes count in shares of their range, directions in mm (`pointing_mm_per_rad`)."""

    def __init__(self, options: Learner, scale: Vector) -> None:
        """scale: (m,) how far each axis goes for a share of 1."""
        self._options = options
        self._scale = scale
        self._estimate: JacobianEstimate | None = None
        self._anchor: tuple[Vector, Vector] | None = None
        self._first: list[tuple[Vector, Vector]] = []
        """(m,) axes and (6,) task of all frames of the first motions."""

    @property
    def known(self) -> bool:
        """Whether it is known how the direction answers."""
        return self._estimate is not None

    @property
    def rows(self) -> Vector | None:
        """(3, m) mm of direction per mm or rad of the axes; None: not known."""
        if self._estimate is None:
            return None
        return np.asarray(self._estimate.jacobian[POSITION:] / self._scale)

    def break_off(self) -> None:
        """What comes next has nothing to do with what came before."""
        self._anchor = None

    def observe(self, observation: Observation) -> None:
        """Take a frame that is believed."""
        seen = task_of(observation, POSE, self._options.pointing_mm_per_rad)
        if seen is None or not (np.isfinite(seen).all() and np.isfinite(observation.u).all()):
            return
        here = observation.u / self._scale, seen
        if self._estimate is None:
            self._first.append(here)
            return
        if self._anchor is None:
            self._anchor = here
            return
        moved, turned = here[0] - self._anchor[0], here[1] - self._anchor[1]
        long_enough_mm = _TASK_SHARE * self._options.sample_tip_mm
        if float(moved @ moved) >= _MOVED_SHARE**2 and float(turned @ turned) >= long_enough_mm**2:
            self._estimate.correct(moved, turned)
            self._anchor = here

    def begin(self) -> None:
        """The first motions are over. Raises ControllerError where they showed too little."""
        axes = len(self._scale)
        if len(self._first) < _FRAMES_PER_AXIS * axes:
            raise ControllerError(
                f"the first motions showed the tip's direction {len(self._first)} times: see what "
                "hides the sensor at the tip, or let them be longer (babbling)"
            )
        us, tasks = (np.array(column) for column in zip(*self._first, strict=True))
        us, tasks = us - us.mean(axis=0), tasks - tasks.mean(axis=0)
        gram = us.T @ us
        ridge = _RIDGE * float(np.trace(gram)) / axes
        jacobian = np.linalg.solve(gram + ridge * np.eye(axes), us.T @ tasks).T
        self._go_on(jacobian, FIRST_STD_MM**2 * np.eye(axes))

    def to_arrays(self) -> dict[str, Vector]:
        """What was learnt, directions by themselves, in radians; empty: nothing yet."""
        if self._estimate is None:
            return {}
        jacobian = self._estimate.jacobian.copy()
        jacobian[POSITION:] /= self._options.pointing_mm_per_rad
        return {"pointing": jacobian, "pointing_covariance": self._estimate.covariance}

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`, or from nothing. Raises KeyError, ValueError for other axes."""
        if "pointing" not in arrays:
            return
        m = len(self._scale)
        jacobian, covariance = np.array(arrays["pointing"]), arrays["pointing_covariance"]
        if jacobian.shape != (POSE, m) or covariance.shape != (m, m):
            raise ValueError(f"what it knows of the direction is not for {m} axes")
        jacobian[POSITION:] *= self._options.pointing_mm_per_rad
        self._go_on(jacobian, covariance)

    def _go_on(self, jacobian: Vector, covariance: Vector) -> None:
        self._first.clear()
        self._anchor = None
        self._estimate = JacobianEstimate(
            in_rows(jacobian),
            in_rows(covariance),
            self._options.sample_noise_mm,
            CARRIED_DRIFT_MM,
        )
