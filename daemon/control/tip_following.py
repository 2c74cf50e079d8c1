"""From a reference to a step of the axes, given a Jacobian: what all such controllers share.

The wanted step of the tip is the reference's own motion plus a share of the error (Ho 2018,
eq. 14). The step of the axes is the one nearest to a posture that makes it, by damped least squares
over axes measured in shares of their travel. Axes that meet a limit are held there and the others
take over.
"""

import numpy as np

from config.controllers import TipFollowing
from config.robot import Robot
from daemon.control.axis_ranges import AxisRanges
from daemon.control.controller import ControllerError, Observation
from drivers.pose import Vector

LONGEST_STEP_S = 0.1
"""A step that took longer counts as this long: the tip does not leap after a gap."""

Matrix = Vector

_TINY = 1e-12


class TipFollower:
    """The common law, and the posture that the axes are drawn to."""

    def __init__(self, options: TipFollowing, robot: Robot) -> None:
        self.axes = AxisRanges.of(robot)
        self._options = options
        self._posture = self._fixed_posture()

    def reset(self, observation: Observation) -> None:
        """Motion begins: the posture may be the one of this moment."""
        if self._options.posture == "start":
            self._posture = np.clip(observation.targets, self.axes.lowest, self.axes.highest)

    def tip_step(self, observation: Observation) -> Vector:
        """(3,) mm that the tip shall move in this step. Raises ControllerError for no number."""
        options, dt_s = self._options, step_time(observation)
        error = observation.reference_mm - observation.tip_mm
        share = min(options.gain_per_s * dt_s, 1.0)
        step = observation.reference_velocity_mm_s * dt_s + share * error
        if not np.isfinite(step).all():
            raise ControllerError("where the tip is, or shall be, is not a number")
        length, most = float(np.linalg.norm(step)), options.max_tip_speed_mm_s * dt_s
        return np.asarray(step if length <= most else step * (most / length))

    def axis_step(self, jacobian: Matrix, tip_step: Vector, observation: Observation) -> Vector:
        """(m,) change of the targets. jacobian: (3, m) mm per mm or rad.

        Raises ControllerError for a Jacobian or targets that are not finite.
        """
        if not (np.isfinite(jacobian).all() and np.isfinite(observation.targets).all()):
            raise ControllerError("the controller's model is not a number here: learn it anew")
        dt_s = step_time(observation)
        share = min(self._options.posture_gain_per_s * dt_s, 1.0)
        drawn = share * (self._posture - observation.targets)
        lowest, highest = self.axes.room(observation.targets)
        travel = self.axes.travel
        step = travel * bounded_step(
            jacobian * travel,
            tip_step,
            drawn / travel,
            lowest / travel,
            highest / travel,
            self._options.damping_mm,
        )
        return self.axes.slowed(step, dt_s)

    def _fixed_posture(self) -> Vector:
        posture, axes = self._options.posture, self.axes
        if isinstance(posture, str):
            return np.asarray(0.5 * (axes.lowest + axes.highest))
        if len(posture) != axes.count:
            raise ControllerError(
                f"posture has {len(posture)} positions, and the robot {axes.count} axes"
            )
        return np.asarray(np.clip(np.array(posture), axes.lowest, axes.highest))


def step_time(observation: Observation) -> float:
    """Seconds that this step may make up for."""
    return min(max(observation.dt_s, 0.0), LONGEST_STEP_S)


def bounded_step(
    jacobian: Matrix,
    wanted: Vector,
    drawn: Vector,
    lowest: Vector,
    highest: Vector,
    damping: float,
) -> Vector:
    """(m,) x between `lowest` and `highest` with J x ≈ `wanted`, otherwise near `drawn`.

    jacobian: (3, m). An axis that would pass a limit is set to it, the worst one first, and the
    rest is solved again without it.
    """
    step = np.clip(drawn, lowest, highest)
    free = np.ones(len(drawn), dtype=bool)
    while free.any():
        partial = jacobian[:, free]
        missing = wanted - jacobian[:, ~free] @ step[~free] - partial @ drawn[free]
        trial = drawn[free] + damped_solution(partial, missing, damping)
        beyond = np.maximum(lowest[free] - trial, trial - highest[free])
        worst = int(np.argmax(beyond))
        if not beyond[worst] > 0.0:
            step[free] = trial
            break
        index = int(np.flatnonzero(free)[worst])
        step[index] = min(max(trial[worst], lowest[index]), highest[index])
        free[index] = False
    return step


def damped_solution(jacobian: Matrix, wanted: Vector, damping: float) -> Vector:
    """(m,) shortest x with J x = `wanted`; less of it in directions that J hardly moves.

    Along a singular value s below `damping` the answer is multiplied by s²/(s² + λ²), where λ²
    grows from 0 at s = `damping` to damping² at s = 0; other directions are not touched.
    """
    values, directions = np.linalg.eigh(jacobian @ jacobian.T)
    squared = np.maximum(values, 0.0)
    short = np.maximum(1.0 - np.sqrt(squared) / damping, 0.0)
    share = directions.T @ wanted / (squared + (short * damping) ** 2 + _TINY)
    return np.asarray(jacobian.T @ (directions @ share))
