"""How redundant axes are resolved: which are dear, where they are drawn, what is not asked of them.

Where options leave it open the robot decides. Tendons pull against each other: what only all of
them together would do for the tip takes tension, or leaves one of them slack, so it is given up
sooner than with other axes, and tendons are drawn to their posture faster. The same is what keeps
them tight: it takes up what pretension an arm has lost, and leaves its tip alone.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from config.tasks.controllers import TipFollowing
from daemon.control import jacobian_kernels as kernels
from daemon.control.controller import ControllerError, Observation
from daemon.control.jacobian_kernels import in_rows
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_DAMPING_MM: Final = 8.0
_TENDONS_DAMPING: Final = 0.5
"""Of how far all axes move the tip, the root of the sum of squares. Of an arm with three straight
tendons and a helical one that is between 290, 270 and 14 mm: what bends it, and what lengthens it.
"""
_POSTURE_PER_S: Final = 0.1
_TENDONS_POSTURE_PER_S: Final = 1.0
_FURTHER: Final = 4.0
_FURTHER_PER_S: Final = 0.4
"""Times the posture's gain, and per second at most, to draw the axes of a body with that is led. On
a repeated path their way is soon the same in every cycle, and what one teaches holds for the next:
a slow body's rectangle settles at 1.1 mm without, at 0.84 with twice as much, at 0.75 with four
times. On the way to a path an arm that rests with its axes at their ends comes to its posture
before it is there: else those that stay behind bend it into an S, along which its model is wrong.
Of thirty arms with lags of 0.35 to 1 s one never came to its path without, and one was held on it
again and again."""
_SPARED: Final = 0.05
"""Of the weakest tendon's range of tensions, that all keep at either end. Friction lets a tension
fall at once where a tendon turns round: within twice of this one moves there ever more slowly."""
_BACK: Final = 0.2
"""Of their speed, with which all tendons are pulled, or released, where one has lost all of what is
spared. With 5 N/mm, which tendons of 0.2 m have, and a delay of 0.25 s it does not swing."""
_RATE_S: Final = 0.1
"""Time constant of how fast a tension changes: what is measured is a motor's torque, with noise."""
_OFF_ENDS: Final = 0.1
"""Of its travel: nearer to an end no axis of a late body stays on the way to a path ..."""
_LEAVES: Final = 0.5
"""... which it leaves with up to so much of its speed, whatever the tip asks. Else an arm that has
begun to bend into an S goes on so: one that was 0.8 s late was held a hundred times."""


class Redundancy:
    """What one controller's options come to for one robot's axes."""

    def __init__(self, options: TipFollowing, axes: AxisRanges) -> None:
        """Raises ControllerError where the options do not fit the axes."""
        self._options = options
        self._axes = axes
        self.unit = axes.scale / np.sqrt(self._weights())
        """(m,) how far each axis goes for the price of 1."""
        self.posture = self._posture()
        """(m,) that the axes are drawn to."""
        self.posture_gain_per_s = self._posture_gain_per_s()
        """Share of the way there per second."""

    def damping_mm(self, jacobian: Vector) -> float:
        """Directions in which the tip moves less than this while an axis goes through its range are
        given up gently. jacobian: (3 or 6, m), whose first rows are mm per mm or rad."""
        stated = self._options.damping_mm
        if stated is not None:
            return stated
        if not self._axes.opposed:
            return _DAMPING_MM
        size_mm = float(np.linalg.norm(jacobian[:3] * self.unit))
        return max(_TENDONS_DAMPING * size_mm, _DAMPING_MM)

    def _posture_gain_per_s(self) -> float:
        stated = self._options.posture_gain_per_s
        if stated is not None:
            return stated
        return _TENDONS_POSTURE_PER_S if self._axes.opposed else _POSTURE_PER_S

    def _weights(self) -> Vector:
        weights, axes = self._options.axis_weights, self._axes
        if weights is None:
            return np.ones(axes.count)
        if len(weights) != axes.count:
            raise ControllerError(
                f"axis_weights are {len(weights)}, and the robot has {axes.count} axes"
            )
        return np.asarray(np.array(weights) / np.mean(weights))

    def _posture(self) -> Vector:
        posture, axes = self._options.posture, self._axes
        if isinstance(posture, str):
            return np.asarray(0.5 * (axes.lowest + axes.highest))
        if len(posture) != axes.count:
            raise ControllerError(
                f"posture has {len(posture)} positions, and the robot {axes.count} axes"
            )
        return np.asarray(np.clip(np.array(posture), axes.lowest, axes.highest))


class Posture:
    """Of one robot's m axes, in their own units."""

    def __init__(self, options: TipFollowing, redundancy: Redundancy, axes: AxisRanges) -> None:
        self._lowest, self._highest = axes.lowest, axes.highest
        self._at = redundancy.posture
        self._gain_per_s = redundancy.posture_gain_per_s
        self._begins_here = options.posture == "start"
        self._rotations = axes.period > 0.0
        self.turns = bool(self._rotations.any())
        """Whether axes turn round: then far ways come of little, the body can snap on them, and the
        middle of their travel is no better than another place."""
        self._further_per_s = self._drawn_further_per_s(options.leads)
        self._turned_together: float | None = None
        """The mean of axes that come round, as a path began; None: it has not."""

    @property
    def at(self) -> Vector:
        """(m,) that the axes are drawn to."""
        return self._at.copy()

    def set(self, posture: Vector) -> None:
        """Draw to (m,) another one, as far as the axes go. Raises ValueError for no numbers."""
        if np.shape(posture) != self._lowest.shape or not np.isfinite(posture).all():
            raise ValueError(f"a posture is {len(self._lowest)} finite numbers, not {posture}")
        self._at = np.clip(posture, self._lowest, self._highest)

    def begin(self, targets: Vector) -> None:
        """Motion begins with the axes told to be at (m,): the posture may be the one of this
        moment."""
        self._turned_together = None
        if self._begins_here:
            self._at = np.clip(targets, self._lowest, self._highest)

    def drawn(self, observation: Observation, dt_s: float, times: float) -> Vector:
        """(m,) change of the targets that the posture asks for in `dt_s`, with so many times its
        gain."""
        share = min(times * self._gain_per_s * dt_s, 1.0)
        return np.asarray(share * self._way(observation))

    def drawn_further(self, observation: Observation, dt_s: float) -> Vector:
        """(m,) that the posture asks for besides, of a body that is led."""
        share = min(self._further_per_s * dt_s, 1.0)
        return np.asarray(share * self._way(observation))

    def shaped_as(self, u: Vector) -> Vector:
        """(m,) from (m,) axes to where the body has the posture's shape. How tubes are turned all
        together is none of it: to draw that to a place, too, would turn them against each other
        where a tip is on the other side, and a body that is folded back reaches less far."""
        way = self._at - u
        if self.turns:
            way[self._rotations] -= way[self._rotations].mean()
        return way

    def _way(self, observation: Observation) -> Vector:
        """(m,) from where the axes are told to be to the posture, on a path with all tubes turned
        together as they were when it began: so they come back to what was learnt of them."""
        targets = observation.targets
        way = self.shaped_as(targets)
        if self.turns:
            together = float(targets[self._rotations].mean())
            if not observation.on_path:
                self._turned_together = None
            elif self._turned_together is None:
                self._turned_together = together
            else:
                way[self._rotations] += self._turned_together - together
        return way

    def _drawn_further_per_s(self, leads: bool) -> float:
        if self.turns or not leads:
            return 0.0
        return max(min(_FURTHER * self._gain_per_s, _FURTHER_PER_S) - self._gain_per_s, 0.0)


class TensionKeeping:
    """Keeps tendons from going slack or tearing, as their tensions are seen step by step.

    What is nearly slack is let go of no further, and the others make the tip's step; and all of
    them are pulled together, which bends no body. What a tip asks of all of them, to be higher or
    lower than it can, comes second.
    """

    def __init__(self, robot: Robot, axes: AxisRanges) -> None:
        ranges_n = [axis.tension_range_n for axis in robot.axes if axis.tension_range_n is not None]
        self._lowest_n, self._highest_n = np.array(ranges_n, np.float64).T
        self._range_n = float(np.min(self._highest_n - self._lowest_n))
        self._spared_n = _SPARED * self._range_n
        self._tendons = list(axes.tendons)
        self._speeds = axes.max_velocity[self._tendons]
        self._seen_n: Vector | None = None
        self._rates = np.zeros(axes.count)
        """(m,) N/s"""
        self._release = self._pull = np.full(len(self._tendons), np.inf)
        """How far each tendon may be released, and pulled, in this step; below zero: it has to go
        back so far."""

    def begin(self) -> None:
        """Motion begins: what tensions did before tells nothing."""
        self._seen_n = None
        self._rates = np.zeros_like(self._rates)

    def see(self, tensions_n: Vector | None, dt_s: float, late_s: float = 0.0) -> None:
        """(m,) tensions as measured at the step that is asked about now. None, or no number: nobody
        knows; nothing is kept then, and the gate lets nothing through.

        late_s: so long what was told goes on to arrive at the body, and tensions change as now.
        """
        if tensions_n is None:
            tensions_n = np.full_like(self._rates, np.nan)
        if self._seen_n is not None and dt_s > 0.0:
            newest = np.nan_to_num((tensions_n - self._seen_n) / dt_s)
            self._rates += min(dt_s / _RATE_S, 1.0) * (newest - self._rates)
        self._seen_n = tensions_n
        now_n, then_n = tensions_n[self._tendons], self.ahead(late_s)[self._tendons]
        over_slack = (np.minimum(now_n, then_n) - self._lowest_n) / self._spared_n - 1.0
        to_torn = (self._highest_n - np.maximum(now_n, then_n)) / self._spared_n - 1.0
        self._release, self._pull = self._step(over_slack, dt_s), self._step(to_torn, dt_s)

    def ahead(self, seconds: float) -> Vector:
        """(m,) tensions so much later, if they go on as now; no numbers where nobody knows."""
        seen_n = np.full_like(self._rates, np.nan) if self._seen_n is None else self._seen_n
        return np.asarray(seen_n + seconds * self._rates)

    def slacker_than(self, share: float) -> NDArray[np.bool_]:
        """(m,) which tendons are nearer to slack than by so much of the weakest one's range of
        tensions. None of which nobody knows."""
        slacker = np.zeros(len(self._rates), np.bool_)
        over_slack = self.ahead(0.0)[self._tendons] - self._lowest_n
        slacker[self._tendons] = over_slack < share * self._range_n
        return slacker

    def bounds(self, lowest: Vector, highest: Vector) -> tuple[Vector, Vector]:
        """(m,) lowest and highest step nearest to those given that neither slacken a tendon nor
        tear it."""
        release, pull = np.full_like(lowest, np.inf), np.full_like(highest, np.inf)
        release[self._tendons] = np.maximum(self._release, 0.0)
        pull[self._tendons] = np.maximum(self._pull, 0.0)
        return np.clip(lowest, -release, pull), np.clip(highest, -release, pull)

    def evened(self, step: Vector) -> Vector:
        """(m,) a step with so much more of all tendons together, or less, that none gets slacker
        that is nearly slack, and none tighter that is nearly torn, which counts first."""
        mean = float(step[self._tendons].mean())
        may = min(max(mean, -float(self._release.min())), float(self._pull.min()))
        return self._together(step, may - mean)

    def tightened(self, step: Vector) -> Vector:
        """(m,) a step that bends the body as `step` does, with so much more of all tendons together
        that none is let go of further than it may, as far as none is pulled further than it may."""
        alone = step[self._tendons]
        lacking = max(float(np.max(-self._release - alone)), 0.0)
        return self._together(step, min(lacking, float(np.min(self._pull - alone))))

    def _together(self, step: Vector, more: float) -> Vector:
        if more == 0.0:
            return step
        step = step.copy()
        step[self._tendons] += more
        return step

    def _step(self, left: Vector, dt_s: float) -> Vector:
        """(tendons,) left: of what is spared."""
        return np.where(left < 1.0, dt_s * self._speeds * _allowed(left, _BACK), np.inf)


def leaving_ends(
    axes: AxisRanges, targets: Vector, bounds: tuple[Vector, Vector], dt_s: float
) -> tuple[Vector, Vector]:
    """(m,) lowest and highest step, of those given, with which axes that are near an end leave it,
    and none comes there."""
    near, fastest = _OFF_ENDS * axes.travel, axes.max_velocity * dt_s
    lower = fastest * _allowed((targets - axes.lowest) / near - 1.0, _LEAVES)
    higher = fastest * _allowed((axes.highest - targets) / near - 1.0, _LEAVES)
    return np.maximum(bounds[0], -lower), np.minimum(bounds[1], higher)


def _allowed(left: Vector, back: float) -> Vector:
    """Share of an axis' speed, with which it may go where so much is left; below zero it goes back,
    with `back` where all of it is used up."""
    return np.where(left < 0.0, back * np.maximum(left, -1.0), left)


def bounded_step(
    jacobian: Vector,
    wanted: Vector,
    drawn: Vector,
    lowest: Vector,
    highest: Vector,
    damping: float,
    lets_go: bool = True,
) -> Vector:
    """(m,) x between `lowest` and `highest` with J x ≈ `wanted`, otherwise near `drawn`.

    jacobian: (r, m). An axis that would pass a limit is set to it, the worst one first, and the
    rest is solved again without it. lets_go: where that makes less than could be made, those that
    were set come back as far as it helps.
    """
    return np.asarray(
        kernels.bounded_step(
            in_rows(jacobian),
            in_rows(wanted),
            in_rows(drawn),
            in_rows(lowest),
            in_rows(highest),
            damping,
            lets_go,
        )
    )


def damped_solution(jacobian: Vector, wanted: Vector, damping: float) -> Vector:
    """(m,) shortest x with J x = `wanted`; less of it in directions that J hardly moves.

    Along a singular value s below `damping` the answer is multiplied by s²/(s² + λ²), where λ²
    grows from 0 at s = `damping` to damping² at s = 0; other directions are not touched.
    """
    return np.asarray(kernels.damped_solution(in_rows(jacobian), in_rows(wanted), damping))
