"""PID on the tip's error, and the Jacobian of a body of circular arcs to make axes of it.

What the PID gives is a velocity of the tip: the axes add it up, so that a tip at rest ends where
its reference is without any integral. The integral is for a reference that moves and a Jacobian
that is wrong. With two degrees of freedom (Åström and Hägglund, Advanced PID Control, 2006): the
reference's velocity is weighted by one or by none. One is the default, for all others that this is
compared with are told that velocity as well; a loop that had to find it by its integral would be
compared for what it was not told.

The integral stands still while an axis' limit, a speed or the gate keeps the tip from what is asked
and its error asks for more of that (conditional integration, there in section 3.5).
"""

from typing import Final

import numpy as np

from config.robot import Robot
from config.tasks.controllers import TipFollowing
from config.tasks.peers import PidConstantCurvature
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.task import within
from daemon.control.tip_following import step_time
from daemon.controllers.constant_curvature import ArcController
from drivers.pose import Vector

_KEPT_BACK_SHARE: Final = 0.1
_KEPT_BACK_MM_S: Final = 0.5
"""Of what was asked, and at least: by so much more than what became of it the loop is kept back.
Damped least squares and the posture leave a little less everywhere."""


class Pid:
    """From errors to velocities of the tip, (3,) mm and mm/s."""

    def __init__(self, options: PidConstantCurvature) -> None:
        self._options = options
        self.begin()

    def begin(self) -> None:
        """Motion begins: nothing is owed."""
        self._integral = np.zeros(3)
        self._velocity: Vector | None = None
        self._asked = np.zeros(3)
        self._kept_back = np.zeros(3)

    def ask(self, observation: Observation, dt_s: float) -> Vector:
        """(3,) mm/s. What is only extrapolated is not integrated."""
        options, wished = self._options, observation.reference_velocity_mm_s
        error = observation.reference_mm - observation.tip_mm
        if observation.believed and not error @ self._kept_back > 0.0:
            integral = self._integral + options.integral_per_s2 * dt_s * error
            self._integral = within(integral, options.max_tip_speed_mm_s)
        moving = wished if options.feed_forward else np.zeros(3)
        proportional = min(options.gain_per_s, 1.0 / dt_s) * error
        damping = options.derivative * (moving - self._filtered(observation, dt_s))
        self._asked = proportional + self._integral + damping + moving
        return self._asked

    def became(self, possible: Vector) -> None:
        """(3,) mm/s is what became of what was asked last."""
        missing = self._asked - possible
        much = _KEPT_BACK_SHARE * float(np.linalg.norm(self._asked)) + _KEPT_BACK_MM_S
        self._kept_back = missing if missing @ missing > much**2 else np.zeros(3)

    def _filtered(self, observation: Observation, dt_s: float) -> Vector:
        seen = observation.tip_velocity_mm_s
        if self._velocity is None:
            self._velocity = seen
        share = dt_s / (self._options.derivative_filter_s + dt_s)
        self._velocity = self._velocity + share * (seen - self._velocity)
        return self._velocity


class PidConstantCurvatureController(ArcController):
    """A `Controller`."""

    name = "pid_constant_curvature"

    def __init__(self, options: PidConstantCurvature, robot: Robot) -> None:
        """Raises ControllerError for a robot that is no such arm."""
        super().__init__(options, options.of_law(TipFollowing), robot)
        self._max_tip_speed_mm_s = options.max_tip_speed_mm_s
        self._pid = Pid(options)
        self._last: tuple[Vector, Vector, float] | None = None
        """The Jacobian and the targets of the last step, and how long it was in s."""

    def reset(self, observation: Observation) -> None:
        super().reset(observation)
        self._pid.begin()
        self._last = None

    def propose(self, observation: Observation) -> Proposal:
        dt_s = step_time(observation)
        if not dt_s > 0.0:
            return Proposal(np.zeros_like(observation.targets))
        self._take_stock(observation)
        asked = self._pid.ask(observation, dt_s)
        if not np.isfinite(asked).all():
            self._pid.begin()
            raise ControllerError("where the tip is, or shall be, is not a number")
        _, jacobian = self.kinematics.tip(observation.targets)
        tip_step = within(asked, self._max_tip_speed_mm_s) * dt_s
        self._last = jacobian, observation.targets, dt_s
        return Proposal(self._follower.axis_step(jacobian, tip_step, observation))

    def _take_stock(self, observation: Observation) -> None:
        """What limits, speeds and the gate have made of the last step."""
        if self._last is None or not np.isfinite(observation.targets).all():
            return
        jacobian, targets, dt_s = self._last
        self._pid.became(jacobian @ (observation.targets - targets) / dt_s)


def make(options: PidConstantCurvature, robot: Robot, seed: int) -> PidConstantCurvatureController:
    """It does nothing at random. Raises ControllerError."""
    del seed
    return PidConstantCurvatureController(options, robot)
