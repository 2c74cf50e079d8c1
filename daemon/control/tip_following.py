"""From a reference to a step of the axes, given a Jacobian: what all such controllers share.

The wanted step of the tip is the reference's own motion plus a share of the error (Ho 2018,
eq. 14). The step of the axes is the one nearest to a posture that makes it, by damped least squares
over axes measured in shares of their range, the dearer ones weighing more. Axes that meet a limit,
their own or one that couples them, are held there and the others take over.
"""

import math

import numpy as np

from config.robot import Robot
from config.tasks.controllers import TipFollowing
from daemon.control import jacobian_kernels as kernels
from daemon.control import leading
from daemon.control.avoidance import CoupledKeeping
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.jacobian_kernels import in_rows
from daemon.control.lag.hysteresis import Hysteresis
from daemon.control.lag.probing import ProbedMotion, Probing
from daemon.control.leading import Leading
from daemon.control.redundancy import (
    Posture,
    Redundancy,
    TensionKeeping,
    bounded_step,
    damped_solution,
    leaving_ends,
)
from daemon.control.task import POSITION, points, turn_between, within
from daemon.learning.forward import stop_operators
from daemon.learning.forward.stop_operators import HeldBack
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

LONGEST_STEP_S = 0.2
"""A step that took longer counts as this long, however slow the tracker: the tip does not leap
after a gap."""

_DOUBTED = 0.5
"""Of what the motions of a body tell that is led by prediction alone. On sixty slow bodies that the
model does not know second rounds are so 3 % nearer in the mean than where nothing is learnt, and
7 % further off at most. With none of it they are 4 % nearer, and up to 13 % further off."""

_AT_ZERO = 0.02
"""Of an axis' range: so near to zero a body is where it rests."""

_FORESEEN_S = 0.025
"""A step of the tracker's, as the law is asked for it before anything moves."""

Matrix = Vector


class TipFollower:
    """The common law, and the posture that the axes are drawn to."""

    def __init__(self, options: TipFollowing, robot: Robot) -> None:
        self.axes = AxisRanges.of(robot)
        self._options = options
        self.redundancy = Redundancy(options, self.axes)
        self._tension_keeping = TensionKeeping(robot, self.axes) if self.axes.opposed else None
        self._coupled_keeping = CoupledKeeping(self.axes) if self.axes.coupled.limits else None
        self._posture = Posture(options, self.redundancy, self.axes)
        self._leads = options.leads
        self._probing = Probing() if self._leads and options.probe else None
        self._probed = ProbedMotion()
        probes = self._probing is not None
        slow_above_mm = options.slow_above_mm
        self.leading = Leading(options.gain_per_s, options.by_cycles, probes, slow_above_mm)
        self._told: tuple[Matrix, Vector] | None = None
        """The last Jacobian, and the targets that it was used at."""
        self._home = self._posture.at
        """Where small motions began."""
        self._hysteresis: Hysteresis | None = None
        self._jumps = 0
        """Of the tip, before motion began."""
        self._put_off: tuple[Observation, float] | None = None
        """The last step, from which hysteresis is still to be learnt."""

    @property
    def posture(self) -> Vector:
        """(m,) that the axes are drawn to."""
        return self._posture.at

    def set_posture(self, posture: Vector) -> None:
        """Draw to (m,) another one, as far as the axes go. Raises ValueError for no numbers."""
        self._posture.set(posture)

    def reset(self, observation: Observation) -> None:
        """Motion begins: the posture may be the one of this moment."""
        self.leading.begin()
        if self._tension_keeping is not None:
            self._tension_keeping.begin()
        if (np.abs(observation.targets) <= _AT_ZERO * self.axes.scale).all():
            self.leading.load.rest_mm = observation.tip_mm
        self._jumps = self.leading.jumps
        self._told = self._put_off = None
        if self._hysteresis is not None:
            self._hysteresis.break_off()
        if self._probing is not None:
            self._probing.begin()
            self._probed = ProbedMotion()
        self._posture.begin(observation.targets)

    def expect_hysteresis(self, held_back: HeldBack | None) -> None:
        """A model's body holds so much back where axes turn. If nobody knows, play alone is looked
        for. It counts where the body is led, and no axis turns round."""
        self._hysteresis = self._put_off = None
        if held_back is not None and self._leads and not self._posture.turns:
            self._hysteresis = Hysteresis(held_back)

    def free(self, u: Vector) -> Vector:
        """(m,) axes at (m,) without what the body holds back of their way, if that is known."""
        return u if self._hysteresis is None else self._hysteresis.free(u)

    @property
    def probed(self) -> bool:
        """Whether it is known how late the body is, or nobody asks."""
        return self._probing is None or self._probing.done

    @property
    def contradicted(self) -> bool:
        """Whether small motions went elsewhere than the Jacobian had told them to."""
        lag = self.leading.lag
        return self._probed.contradicts(lag.lag_s, lag.dead_share)

    def probe(self, jacobian: Matrix, observation: Observation) -> Proposal:
        """The next step of the small motions that show how late the body is.

        jacobian: (3, m) mm per mm or rad. Raises ControllerError for no number.
        """
        probing = self._probing
        assert probing is not None
        if not _all_finite(observation.tip_mm):
            raise ControllerError("where the tip is, is not a number")
        moved_mm = self._moved_mm(observation)
        if moved_mm is not None:
            probing.made(moved_mm)
            t_s, tip_mm = observation.t_ns * 1e-9, observation.tip_mm
            self._probed.see(t_s, moved_mm, tip_mm, observation.believed)
            self.leading.see_probe(observation, step_time(observation), moved_mm)
            if self._hysteresis is not None and observation.believed:
                t_s = observation.t_ns * 1e-9
                self._hysteresis.see_probe(t_s, step_time(observation), observation.tip_mm)
        else:
            self._home = observation.targets
        if probing.asks:
            lag = self.leading.lag
            probing.answer(lag.by_steps_s, lag.lag_s)
        returns, dt_s = probing.returns, step_time(observation)
        step = within(probing.step(dt_s), self._options.max_tip_speed_mm_s * dt_s)
        no_posture = np.zeros_like(observation.targets)
        delta_u = self.axis_step(jacobian, step, observation, no_posture)
        if returns:
            delta_u = self.within_limits(self._home - observation.targets, observation)
        proposal = Proposal(delta_u, probing.note, 0)
        if probing.done:
            self.leading.end_probe()
            if self._hysteresis is not None:
                self._hysteresis.end_probe(self.leading.lag)
        return proposal

    @property
    def predicts(self) -> bool:
        """Whether the body is so late that it is led by prediction alone."""
        return self._leads and self.leading.predicted >= 1.0

    @property
    def _lets_go(self) -> bool:
        """Whether axes at their ends come back where the others alone cannot move the tip. Across a
        long lag the tip shows too late where that takes it: so two of a slow body's twelve load
        steps would not be made up for."""
        return not (self._posture.turns or self.predicts)

    @property
    def learnable(self) -> float:
        """How far motions correct a Jacobian that was known before, 0 to 1. Across a long lag what
        a motion tells is of where the axes were, and of a hysteresis that may have turned since."""
        return 1.0 - _DOUBTED * self.leading.predicted if self._leads else 1.0

    @property
    def made_up_for(self) -> Vector:
        """(3,) how much of what is told comes along each axis of space, as far as that is led."""
        return self.leading.made_up_for if self._leads else np.ones(3)

    def as_told_mm(self, motion_mm: Vector, tip_mm: Vector) -> Vector:
        """(3,) what was told for (3,) motion that came, of a tip at (3,), as far as that is led."""
        return self.leading.as_told_mm(motion_mm, tip_mm) if self._leads else motion_mm

    def due_mm(self, observation: Observation) -> Vector:
        """(3,) where the tip will be when all that was told has arrived, which is where the axes'
        places belong to. Without leading: where it is."""
        if not self._leads:
            return observation.tip_mm
        return np.asarray(observation.tip_mm + self.leading.left_mm)

    def due_axes(self, observation: Observation) -> Vector:
        """(m,) axes, without what the body holds back, that belong to `due_mm`: where they were
        told to go. From where they are measured a Jacobian is that of a moment ago, and on a path
        that turns a late tip drifts off by it, always to the same side."""
        return self.free(observation.targets if self._leads else observation.u)

    def task_step(self, observation: Observation) -> Vector:
        """(3,) mm that the tip shall move in this step, or (6,) as it shall turn as well.

        Raises ControllerError for no number.
        """
        step = self.tip_step(observation)
        if not points(observation):
            return step
        return np.concatenate([step, self._options.pointing_mm_per_rad * self._turn(observation)])

    def _turn(self, observation: Observation) -> Vector:
        """(3,) rad by which the tip's direction shall change in this step."""
        options, dt_s = self._options, step_time(observation)
        direction, wanted = observation.tip_direction, observation.reference_direction
        assert direction is not None and wanted is not None
        turn = min(options.gain_per_s * dt_s, 1.0) * turn_between(direction, wanted)
        if options.feed_forward and observation.reference_turn is not None:
            turn = turn + observation.reference_turn * dt_s
        if not _all_finite(turn):
            raise ControllerError("where the tip points, or shall point, is not a number")
        return within(turn, options.max_tip_turn_rad_s * dt_s)

    def tip_step(self, observation: Observation) -> Vector:
        """(3,) mm that the tip shall move in this step. Raises ControllerError for no number."""
        dt_s = step_time(observation)
        known = _all_finite(observation.tip_mm) and _all_finite(observation.reference_mm)
        if known and self._leads:  # which would keep what is no number, and lead by it ever after
            self._take_stock(observation, dt_s)
            step = self.leading.step(observation, dt_s)
        else:
            step = self._plain_step(observation, dt_s)
        if not _all_finite(step):
            raise ControllerError("where the tip is, or shall be, is not a number")
        return within(step, self._options.max_tip_speed_mm_s * dt_s)

    def proposal(self, delta_u: Vector, observation: Observation, note: str = "") -> Proposal:
        """A step with which the tip follows, and what is expected of it."""
        if not self._leads or observation.ahead is None:
            return Proposal(delta_u, note)
        leading = self.leading
        return Proposal(delta_u, note, None, leading.expected_mm(observation), leading.pace)

    def _plain_step(self, observation: Observation, dt_s: float) -> Vector:
        error = observation.reference_mm - observation.tip_mm
        step = min(self._options.gain_per_s * dt_s, 1.0) * error
        if self._options.feed_forward:
            step = step + observation.reference_velocity_mm_s * dt_s
        return np.asarray(step)

    def _take_stock(self, observation: Observation, dt_s: float) -> None:
        """What was told since the last step, and what the tip made of all before."""
        self.work_off()
        moved_mm = self._moved_mm(observation)
        if moved_mm is not None:
            self.leading.take_stock(observation, dt_s, moved_mm)
            self._put_off = observation, dt_s

    def work_off(self) -> None:
        """What the last step tells of the body's lag and hysteresis: a moment with nothing else to
        do is for it, and else the next step."""
        self.leading.work_off()
        if self._put_off is not None:
            self._learn_hysteresis(*self._put_off)
            self._put_off = None

    def _learn_hysteresis(self, observation: Observation, dt_s: float) -> None:
        """Until something is hung on: its creep looks like friction, and of a slow body's twelve
        load steps two would not be made up for."""
        hysteresis, leading = self._hysteresis, self.leading
        if hysteresis is None:
            return
        if leading.jumps != self._jumps or leading.repeats or not observation.believed:
            hysteresis.break_off()
            return
        t_s, on_path = observation.t_ns * 1e-9, observation.phase is not None
        hysteresis.learn(t_s, dt_s, observation.tip_mm, leading.lag, on_path)

    def _moved_mm(self, observation: Observation) -> Vector | None:
        """(3,) that was told since the last step; None: nobody knows."""
        if not _all_finite(observation.targets):
            return None
        hysteresis = self._hysteresis
        if hysteresis is not None:
            hysteresis.follow(observation.targets, step_time(observation))
        if self._told is None:
            return None
        jacobian, targets = self._told[0][:POSITION], self._told[1]
        if hysteresis is not None:
            return hysteresis.moved_mm(jacobian)
        return np.asarray(jacobian @ (observation.targets - targets))

    def drawn(self, observation: Observation, times: float = 1.0) -> Vector:
        """(m,) change of the targets that the posture asks for, with so many times its gain."""
        return self._posture.drawn(observation, step_time(observation), times)

    def drawn_further(self, observation: Observation) -> Vector:
        """(m,) that the posture asks for besides, of a body that is led."""
        return self._posture.drawn_further(observation, step_time(observation))

    def axis_step(
        self,
        jacobian: Matrix,
        tip_step: Vector,
        observation: Observation,
        near: Vector | None = None,
    ) -> Vector:
        """(m,) change of the targets. jacobian: (3, m) mm per mm or rad of a body that holds
        nothing back, or (6, m) with the direction's rows in mm, as `task_step` has them.

        near: (m,) a step that should be changed as little as need be; None: the posture's.
        Raises ControllerError for a Jacobian or targets that are not finite.
        """
        self._tell(jacobian, observation)
        hysteresis, dt_s = self._hysteresis, step_time(observation)
        if near is None:
            near = self.drawn(observation) + self.drawn_further(observation)
        elif self.axes.bending is not None:
            drawn = self.drawn(observation)
            near = drawn + self.axes.less_together(near - drawn, 1.0)
        lowest, highest = self._step_range(observation)
        keeping = self._tension_keeping
        if keeping is not None:
            lag = self.leading.lag
            keeping.see(observation.tensions_n, dt_s, lag.dead_share * lag.lag_s)
            lowest, highest = keeping.bounds(lowest, highest)
        # The body's free axes are what the Jacobian is of, and what is to stay near the posture.
        needed = np.eye(self.axes.count) if hysteresis is None else hysteresis.needed
        each = np.diag(needed)
        unstrained = self.axes.unstrained(jacobian)
        step, made = kernels.axis_step(
            in_rows(unstrained),
            in_rows(tip_step),
            kernels.StepBounds(in_rows(near), lowest / each, highest / each),
            self.redundancy.unit,
            self.axes.max_velocity / each,
            dt_s,
            self.redundancy.damping_mm(unstrained),
            self._lets_go,
        )
        if hysteresis is not None:
            step = hysteresis.with_what_is_lost(needed @ step)
        if keeping is not None:
            step = keeping.evened(step)
        step = kernels.kept_within(step, lowest, highest, self.axes.max_velocity * dt_s)
        kept = self.coupled_kept(step, jacobian, observation)
        if kept is not step:
            made = made + jacobian @ (kept - step)
        if self._leads:
            self.leading.see_made(tip_step[:POSITION], made[:POSITION])
        return np.asarray(kept)

    def coupled_kept(self, step: Vector, jacobian: Matrix, observation: Observation) -> Vector:
        """(m,) a step that keeps what couples the axes; itself where there is nothing to keep."""
        if self._coupled_keeping is None:
            return step
        dt_s = step_time(observation)
        return self._coupled_keeping.kept(step, observation.targets, jacobian, dt_s)

    def axis_velocity(self, jacobian: Matrix, tip_velocity: Vector, u: Vector) -> Vector:
        """(m,) per second that this law asks of axes at (m,) for (3,) mm/s of the tip, however
        fast they are; where they are not fast enough, spread over them. jacobian: (3, m)."""
        jacobian = self.axes.unstrained(jacobian)
        unit, damping = self.redundancy.unit, self.redundancy.damping_mm(jacobian)
        scaled = in_rows(jacobian * unit)
        lowest, highest = self.axes.step_range(u)
        drawn = self.redundancy.posture_gain_per_s * _FORESEEN_S * self._posture.shaped_as(u) / unit
        lowest, highest = lowest / unit, highest / unit
        wanted = _FORESEEN_S * tip_velocity
        step = bounded_step(scaled, wanted, drawn, lowest, highest, damping, self._lets_go)
        fastest = _FORESEEN_S * self.axes.max_velocity / unit
        if (np.abs(step) > fastest).any():
            bounds = kernels.StepBounds(drawn, lowest, highest)
            step = kernels.least_hurried_step(scaled, step, bounds, fastest, damping)
        return np.asarray(step * unit / _FORESEEN_S)

    def axes_nearer(self, jacobian: Matrix, missing_mm: Vector, u: Vector) -> Vector:
        """(m,) axes within their travel, nearest to (m,) `u`, that bring the tip (3,) mm further.
        jacobian: (3, m)."""
        jacobian, unit = self.axes.unstrained(jacobian), self.redundancy.unit
        step = damped_solution(jacobian * unit, missing_mm, self.redundancy.damping_mm(jacobian))
        return np.clip(u + unit * step, self.axes.lowest, self.axes.highest)

    def _step_range(self, observation: Observation) -> tuple[Vector, Vector]:
        """(m,) lowest and highest step. Late bodies' axes leave their ends on the way to a path."""
        axes, targets = self.axes, observation.targets
        bounds = axes.step_range(targets)
        drawn = self.redundancy.posture_gain_per_s > 0.0 and not self._posture.turns
        on_the_way = observation.ahead is not None and not observation.on_path and self.probed
        if drawn and on_the_way and self.predicts:
            return leaving_ends(axes, targets, bounds, step_time(observation))
        return bounds

    def other_step(self, jacobian: Matrix, step: Vector, observation: Observation) -> Vector:
        """(m,) a step that was found otherwise, as far as it may be. jacobian: (3, m), by which it
        is known what of it is under way, and what the tip makes of it.

        Raises ControllerError as `axis_step` does.
        """
        self._tell(jacobian, observation)
        return self.coupled_kept(self.within_limits(step, observation), jacobian, observation)

    def _tell(self, jacobian: Matrix, observation: Observation) -> None:
        if not (_all_finite(jacobian) and _all_finite(observation.targets)):
            raise ControllerError("the controller's model is not a number here: learn it anew")
        self._told = jacobian, observation.targets

    def within_limits(self, step: Vector, observation: Observation) -> Vector:
        """(m,) a step as far as travel and speed of each axis let it be."""
        lowest, highest = self.axes.step_range(observation.targets)
        return self.axes.slowed(np.clip(step, lowest, highest), step_time(observation))


def step_time(observation: Observation) -> float:
    """Seconds that this step may make up for."""
    return min(max(observation.dt_s, 0.0), LONGEST_STEP_S)


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: seconds once, then tenths of one."""
    jacobian, axes, ones = np.eye(3), np.zeros(3), np.ones(3)
    damped_solution(jacobian, axes, 1.0)
    bounds = kernels.StepBounds(axes, axes, axes)
    kernels.axis_step(jacobian, axes, bounds, ones, ones, 1.0, 1.0, True)
    kernels.least_hurried_step(jacobian, axes, bounds, ones, 1.0)
    kernels.kept_within(axes, axes, axes, ones)
    kernels.condition(jacobian, len(jacobian))
    kernels.corrected(jacobian, jacobian, axes, axes, 1.0, 1.0, 1.0, 1.0)
    bounded_step(jacobian, axes, axes, axes, axes, 1.0)
    ranges = AxisRanges(tuple("xyz"), axes, ones, ones, ones, axes)
    CoupledKeeping(ranges).kept(axes, axes, jacobian, 1.0)
    leading.warm_up()
    stop_operators.warm_up()


def _all_finite(array: Vector) -> bool:
    """Of a few numbers: numpy's own overhead would be most of it."""
    return all(map(math.isfinite, array.ravel().tolist()))
