"""Offset-free model-predictive control on a linear model (Pannocchia and Rawlings, AIChE J. 2003).

The model: the tip goes J Δu after a dead time and with a first-order lag. J is identified from an
exploration and taken for the place where the axes are, lag and dead time are found by steps. Its
states are what the tip has followed of what was told, and a disturbance for each coordinate, of
what no model has, which is expected to change as it does: each frame takes it nearer to what the
tip was off by. With as many disturbances as coordinates no error is left at rest, nor, with their
trend, on a straight way (Maeder and Morari, Automatica 46, 2010). At every step the
speeds of the axes over a horizon are found that keep the tip on its reference, as it is known
ahead, within how fast and how far the axes go; the first of them is made.
"""

from collections import deque
from math import exp
from typing import Final

import numpy as np

from config.robot import Robot
from config.tasks.controllers import Learner
from config.tasks.peers import ModelPredictive
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.jacobian_kernels import in_rows
from daemon.control.lag.body_lag import parts
from daemon.control.task import within
from daemon.control.tip_following import step_time
from daemon.controllers.forward_jacobian import JacobianController
from daemon.controllers.peers import horizon_kernels as kernels
from daemon.controllers.peers.identified_jacobian import IdentifiedJacobian
from drivers.pose import Vector

_SHORTEST_LAG_S: Final = 1e-3
_REST_MM: Final = 10.0
"""Price of the way to the posture: it stands by itself, where the tip does not mind."""


class LaggedTip:
    """What was told, what of it the tip has followed, and the disturbance; (3,) mm each."""

    def __init__(self, dead_s: float, lag_s: float, observer_s: float) -> None:
        self.dead_s = dead_s
        self.lag_s = max(lag_s, _SHORTEST_LAG_S)
        self._observer_s = observer_s
        self._told: deque[tuple[float, Vector]] = deque([(-np.inf, np.zeros(3))])
        """What has arrived last, and what is to arrive."""
        self._followed = np.zeros(3)
        self._t_s = self._seen_s = 0.0
        self._disturbance: Vector | None = None
        self._trend = np.zeros(3)
        """mm/s by which the disturbance changes: a Jacobian that is wrong shows as one."""

    @property
    def tip_mm(self) -> Vector:
        """(3,) where the tip is now, by the model."""
        return self._followed + (0.0 if self._disturbance is None else self._disturbance)

    def tell(self, told_mm: Vector, dt_s: float) -> None:
        """(3,) was told since the last step, which is `dt_s` ago."""
        self._followed = self._after(self._followed, self._t_s, dt_s)
        self._t_s += dt_s
        self._told.append((self._t_s, self._told[-1][1] + told_mm))
        while len(self._told) > 1 and self._told[1][0] <= self._t_s - self.dead_s:
            self._told.popleft()
        if self._disturbance is not None:
            self._disturbance = self._disturbance + dt_s * self._trend

    def see(self, tip_mm: Vector) -> None:
        """(3,) where the tip is measured."""
        passed_s = self._t_s - self._seen_s
        self._seen_s = self._t_s
        if self._disturbance is None:
            self._disturbance = tip_mm - self._followed
        elif passed_s > 0.0:
            missing = tip_mm - self._followed - self._disturbance
            kept = exp(-passed_s / self._observer_s)
            self._disturbance = self._disturbance + (1.0 - kept * kept) * missing
            self._trend = self._trend + (1.0 - kept) ** 2 / passed_s * missing

    def coming(self, ends_s: Vector) -> Vector:
        """(n, 3) mm where the tip will be at these times from now, if no more is told."""
        disturbance = self.tip_mm - self._followed
        places, followed, t_s = [], self._followed, self._t_s
        for end_s in ends_s.tolist():
            followed = self._after(followed, t_s, self._t_s + end_s - t_s)
            t_s = self._t_s + end_s
            places.append(followed + disturbance + end_s * self._trend)
        return np.array(places)

    def response(self, ends_s: Vector) -> Vector:
        """(n, n) share of what is told evenly in an interval, the column, that the tip has followed
        at the ends, the rows, of intervals that are all alike."""
        since = ends_s[:, None] - ends_s[None, :]
        length_s = ends_s[0]
        return np.asarray((self._ramp(since + length_s) - self._ramp(since)) / length_s)

    def _ramp(self, since_s: Vector) -> Vector:
        """Of what goes on with 1/s since then."""
        arrived = np.maximum(since_s - self.dead_s, 0.0)
        return np.asarray(arrived + self.lag_s * np.expm1(-arrived / self.lag_s))

    def _after(self, followed: Vector, t_s: float, dt_s: float) -> Vector:
        """(3,) from one time to another, with what arrives meanwhile."""
        end_s = t_s + dt_s
        told = self._told[0][1]
        for at_s, more in self._told:
            arrives_s = at_s + self.dead_s
            if arrives_s >= end_s:
                break
            if arrives_s > t_s:
                followed = told + exp((t_s - arrives_s) / self.lag_s) * (followed - told)
                t_s = arrives_s
            told = more
        return np.asarray(told + exp((t_s - end_s) / self.lag_s) * (followed - told))


class ModelPredictiveController(JacobianController):
    """A `Controller`."""

    name = "model_predictive"
    steers_direction = False

    def __init__(self, options: ModelPredictive, robot: Robot, seed: int) -> None:
        """Raises ControllerError for a model that cannot be loaded."""
        self._mpc = options
        frame = options.of_law(
            Learner,
            lead=options.probe,
            by_cycles=False,
            learning=options.model is None,
        )
        super().__init__(frame, robot, seed)
        self._scale = self._follower.redundancy.unit
        n = options.intervals
        self._ends_s = options.horizon_s / n * np.arange(1.0, n + 1.0)
        self._tip: LaggedTip | None = None
        self._response = np.zeros((n, n))
        self._last: tuple[Vector, Vector, float] | None = None
        """Jacobian and targets of the last step, and how long it was in s."""
        self._prices = np.zeros((2, n, len(self._scale)))

    def reset(self, observation: Observation) -> None:
        super().reset(observation)
        self._tip = self._last = None
        self._prices[:] = 0.0

    def _new_jacobian(self) -> IdentifiedJacobian:
        return IdentifiedJacobian(self._range)

    def _follow(self, observation: Observation) -> Proposal:
        dt_s = step_time(observation)
        jacobian = self._jacobian.at(observation.tip_mm, observation.u)
        numbers = (observation.tip_mm, observation.targets, observation.reference_mm, jacobian)
        if not all(np.isfinite(one).all() for one in numbers):
            self._tip = self._last = None
            raise ControllerError("where the tip is, shall be or would go is not a number")
        if not dt_s > 0.0:
            return Proposal(np.zeros_like(observation.targets))
        tip, now = self._observed(observation, dt_s)
        interval_s = float(self._ends_s[0])
        horizon = kernels.Horizon(
            self._response,
            in_rows(jacobian * self._scale),
            in_rows(self._wanted(observation, tip)),
            in_rows(now * interval_s),
            in_rows(self._resting(observation) * interval_s),
        )
        lowest, highest = self._follower.axes.step_range(observation.targets)
        bounds = kernels.Bounds(
            in_rows(self._follower.axes.max_velocity * interval_s / self._scale),
            in_rows(lowest / self._scale),
            in_rows(highest / self._scale),
        )
        weights = kernels.Weights(self._mpc.smoothness_mm, self._mpc.effort_mm, _REST_MM)
        motion, self._prices = kernels.best_motion(horizon, weights, bounds, self._prices)
        self._last = jacobian, observation.targets, dt_s
        step = motion[0] * self._scale * (dt_s / interval_s)
        step = self._follower.within_limits(step, observation)
        return Proposal(self._follower.coupled_kept(step, jacobian, observation))

    def _observed(self, observation: Observation, dt_s: float) -> tuple[LaggedTip, Vector]:
        """The model with what was told and seen, and (m,) shares per second that the axes go."""
        now = np.zeros(len(self._scale))
        if self._tip is None:
            lag = self._follower.leading.lag
            self._tip = LaggedTip(*parts(lag.lag_s, lag.dead_share), self._mpc.observer_s)
            self._response = in_rows(self._tip.response(self._ends_s))
        elif self._last is not None:
            jacobian, targets, last_s = self._last
            moved = observation.targets - targets
            self._tip.tell(jacobian @ moved, dt_s)
            now = moved / self._scale / last_s
        if observation.believed:
            self._tip.see(observation.tip_mm)
        return self._tip, now

    def _wanted(self, observation: Observation, tip: LaggedTip) -> Vector:
        """(n, 3) mm from where the tip will be anyway to where it shall be."""
        wanted = tip.coming(self._ends_s)
        here = tip.tip_mm
        for k, ahead_s in enumerate(self._ends_s.tolist()):
            aim = None if observation.ahead is None else observation.ahead(ahead_s)
            if aim is None:  # a hand leads, and nobody knows where
                velocity = observation.reference_velocity_mm_s
                aim = observation.reference_mm + ahead_s * velocity, velocity
            way = within(aim[0] - here, self._mpc.max_tip_speed_mm_s * ahead_s)
            wanted[k] = here + way - wanted[k]
        return wanted

    def _resting(self, observation: Observation) -> Vector:
        """(m,) shares per second to the posture."""
        away = self._follower.posture - observation.targets
        return np.asarray(self._follower.redundancy.posture_gain_per_s * away / self._scale)


def warm_up() -> None:
    """Compile the kernel, or load it from numba's cache."""
    axes, moves = np.ones(2), np.ones((1, 3))
    horizon = kernels.Horizon(np.ones((1, 1)), np.ones((3, 2)), moves, axes, axes)
    bounds = kernels.Bounds(axes, -axes, axes)
    kernels.best_motion(horizon, kernels.Weights(1.0, 1.0, 1.0), bounds, np.zeros((2, 1, 2)))
