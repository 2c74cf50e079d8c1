"""Leading a body that answers late: what is under way, how much of it comes, and repeated paths.

Four things are found while the body is followed. How late it answers (`BodyLag`) and how much more
or less than told its tip goes along each axis of space, both from the same motions of some seconds;
and from those of the last tenths of a second, how it answers here and now (`Answer`): so that what
is told and has not arrived counts with what it will come to. And where a path is repeated, what the
tip was off by at each of its places: there it is led the other way (`CycleCorrection`).

A short lag is led by the reference's velocity alone. Across a long one the tip as it will be when
all that was told has arrived is led to where it should be then (Smith's predictor, with the inverse
of dead time and lag before it): errors of the Jacobian come in with what is under way, but the loop
does not wait for the body.
"""

from math import exp
from typing import Final

import numpy as np

from daemon.control.controller import Observation, Phase
from daemon.control.lag import answer as answers
from daemon.control.lag import body_lag, hysteresis, play
from daemon.control.lag import lag_kernels as kernels
from daemon.control.lag.answer import ON_A_PATH_S, ON_THE_WAY_BACK_S, Answer
from daemon.control.lag.body_lag import DEAD_SHARES, BodyLag, Underway, parts
from daemon.control.lag.disturbance import Disturbance, Jump
from daemon.control.lag.expected_error import ExpectedError
from daemon.control.lag.load import Hung, Load
from daemon.control.lag.persistence import Persistence
from daemon.control.lag.preview import Preview, Reference
from daemon.control.repeated_path import CycleCorrection
from drivers.pose import Vector, length

_SHORT_S, _LONG_S = 0.1, 0.25
"""Up to the one a lag is led by the reference alone, from the other on by prediction alone. With
0.2 and 0.4 the arm as made settles 3 to 4 % farther off on rectangle and star, and as near on
circles; and random bodies with lags of 0.1 to 0.36 s 2 % on the mean, a rectangle at 24 mm/s 68 %.
"""
_LATE_FROM_S, _LATE_S = 0.2, 0.4
"""The same where no model tells the Jacobian: from one that first motions have told an arm's first
lap with a load is 0.9 mm off so, and else 1.25. And from the one on a jump shows too late to be
caught by a higher gain, from the other on what is told at first is hurried instead."""
_AVERAGED: Final = 0.3
"""Of the first-order lag, to either side: over so much a reference's velocity is averaged for the
prediction. With 0.65 an arm 0.6 s late begins a circle of 14 mm at 30 mm/s three times as far off:
an eighth of what leads it is lost."""
_AVERAGED_AT_CORNERS: Final = 0.65
"""... where one is near: it is rounded, as far as axes that have to go faster there can. A slow
arm's rectangle and star begin and settle nearest with it; with 0.5 and 0.8 up to a fifth farther.
"""
_AVERAGED_AT_LEAST_S: Final = 0.02
_GAIN_BY_LAG: Final = 6.0
"""Gain times lag, at most, where the tip is predicted: more rings where the prediction is wrong."""
_UNPREDICTED_GAIN_BY_LAG: Final = 1.0
"""... and where it is not: from π/2 on a loop that waits so long for its answer swings up."""
_SHORTEST_LAG_S: Final = 0.1
"""That any body has, with its drives and the tracker."""
_CATCHING: Final = 1.3
"""So much more gain while a tip that was pushed or loaded is caught, where the body is prompt. With
1.6 it takes some hundredths of a second less, with 1.0 more (30 g, four bodies)."""
_HURRY: Final = 0.8
"""... and so much more of what is missing, along the way that the tip was taken off, is told at
first than shall come of it, where the lag is long: what a first-order lag keeps back then comes
sooner. With half of it the way back takes 0.2 to 0.3 s longer."""
_UNMADE_SHARE: Final = 0.1
"""Of a wanted motion: so much that axes do not make of it, at their ends or in a direction in which
they hardly move the tip, is more than rounding."""
_ONE: Final = np.eye(3)
_GAIN_APPROACH_S: Final = 1.0
"""Time constant of the way to the gains that were found: nothing jumps."""


class Leading:
    """Takes what was told and seen, step by step; gives the motion to ask for."""

    def __init__(
        self,
        gain_per_s: float,
        by_cycles: bool,
        probes: bool = False,
        slow_above_mm: float | None = None,
    ) -> None:
        """slow_above_mm: the error above which a path is followed more slowly; None: never."""
        self.lag = BodyLag(dead_shares=DEAD_SHARES if probes else DEAD_SHARES[:1])
        self.modelled = False
        """Whether what is told comes from a model's Jacobian."""
        self._gain_per_s = gain_per_s
        self._by_cycles = by_cycles
        self._underway = Underway()
        self._told_mm = np.zeros(3)
        """All that was told, as the Jacobian has it."""
        self.gains = np.ones(3)
        """(3,) how much of what is told comes along each axis of space."""
        self._cycles: CycleCorrection | None = None
        self._on_path_s = 0.0
        self._preview = Preview()
        self._disturbance = Disturbance()
        self._answer = Answer()
        self._persistence = Persistence()
        self._expected = ExpectedError(gain_per_s, slow_above_mm)
        self.load = Load()
        """What jumps told of what hangs on the body."""
        self._loaded = np.eye(3)
        """(3, 3) how much more that lets come of what was told last."""
        self._before: tuple[Jump, Vector, Vector, Hung] | None = None
        """The last jump, and what was known of the gains and the load when it came."""
        self._taken_along = np.zeros(3)
        """(3,) unit vector along which the tip was taken off last: what is late along it is hurried
        back. Along its path it is late as ever, and hurry would make it swing."""
        self._unloaded_gains: Vector | None = None
        """What was known of them when the first jump since motion began came."""
        self._out_of_reach = np.zeros(3)
        """(3,) unit vector along which axes did not make what was wanted last, however slow that
        was; zeros where they made it all."""
        self.jumps = 0
        """How often the tip was taken off at once: something was hung on, or pushed it."""
        self._put_off: tuple[float, float, Vector, Vector] | None = None
        """Of the last step, what the lag is to be told from ..."""
        self._answer_put_off: tuple[float, float, Vector, Vector, float, float] | None = None
        """... and how the tip answers, where the step that follows does not go by that."""

    @property
    def predicted(self) -> float:
        """How far the lag is led by prediction, 0 to 1."""
        if not self.modelled:
            return self.late
        return min(max((self.lag.lag_s - _SHORT_S) / (_LONG_S - _SHORT_S), 0.0), 1.0)

    @property
    def late(self) -> float:
        """How far a jump of the tip shows too late to be led back by what is seen of it, 0 to 1."""
        return min(max((self.lag.lag_s - _LATE_FROM_S) / (_LATE_S - _LATE_FROM_S), 0.0), 1.0)

    @property
    def repeats(self) -> bool:
        """Whether a path is gone along again that is corrected by its cycles: what is learnt of the
        whole body meanwhile would change what the last cycle has told of this one."""
        return self._cycles is not None and self._on_path_s >= self._cycles.path.cycle_s

    @property
    def made_up_for(self) -> Vector:
        """(3,) gains, besides which motions tell something of the body: what a load makes of it is
        none of its own. After a load the others are those of before, for motions tell what it
        changes besides sooner than the gains do, and better: it is another change at each place."""
        return np.asarray(self.load.hung.times * self._body_gains)

    def as_told_mm(self, motion_mm: Vector, tip_mm: Vector) -> Vector:
        """(3,) what was told for (3,) motion that came, of a tip at (3,): what a load makes of the
        body there, and the body's own gains, are made up for."""
        motion_mm = motion_mm / self._body_gains
        return np.asarray(np.linalg.solve(self.load.matrix_at(tip_mm), motion_mm), np.float64)

    @property
    def _body_gains(self) -> Vector:
        """(3,) as they were before anything was hung on."""
        return self.gains if self._unloaded_gains is None else self._unloaded_gains

    @property
    def pace(self) -> float:
        """Share of a path's own speed at which it should go on."""
        return self._expected.pace

    def expected_mm(self, observation: Observation) -> float:
        """How far off the tip is expected to be, root mean square, at the reference's speed."""
        speed_mm_s = length(observation.reference_velocity_mm_s)
        return self._expected.at(speed_mm_s, self.lag.lag_s)

    @property
    def left_mm(self) -> Vector:
        """(3,) that the tip will go without being told more."""
        return self._underway.left_mm

    def begin(self) -> None:
        """Motion begins: everything has arrived."""
        self._put_off = None
        self.work_off()  # how far the answer is to be foretold is not forgotten
        self.lag.break_off()
        self._underway.begin()
        self._disturbance.begin()
        self._answer.begin()
        self._persistence.begin()
        self._before = self._unloaded_gains = None
        self._preview.begin()
        self._out_of_reach = np.zeros(3)
        if self._cycles is not None:
            self._cycles.break_off()

    def take_stock(self, observation: Observation, dt_s: float, moved_mm: Vector) -> None:
        """(3,) was told since the last step; the tip is seen to have made this of all before. What
        that tells of the lag is found by `work_off`, at the latest before the next one."""
        self.work_off()
        t_s = observation.t_ns * 1e-9
        moved_mm = self._loaded @ moved_mm
        self._told_mm = self._told_mm + moved_mm
        moved_mm = self.gains * moved_mm
        self._underway.tell(t_s, dt_s, moved_mm, self.lag.lag_s, self.lag.dead_share)
        if not observation.believed:
            return
        arrived_mm = self._underway.told_mm - self._underway.left_mm
        off_mm = observation.tip_mm - arrived_mm
        on_its_way = self._disturbance.jumped(t_s)
        jump = self._disturbance.add(t_s, off_mm, arrived_mm, self.lag.lag_s)
        if jump is not None:
            self.jumps += 1
            self._answer.begin()
            self.lag.break_off()
            if not on_its_way:  # else it is the same one, going on
                self._body_changed(jump)
        straight = self._disturbance.just_jumped(t_s)
        memory_s = ON_THE_WAY_BACK_S if straight else ON_A_PATH_S
        seen = t_s, dt_s, observation.tip_mm, arrived_mm, self.lag.lag_s, memory_s
        if self.predicted > 0.0 or self._disturbance.jumped(t_s):
            self._answer.add(*seen)
        else:
            self._answer_put_off = seen
        share = 1.0 - exp(-dt_s / _GAIN_APPROACH_S)
        self.gains = self.gains + share * (self.lag.gains - self.gains)
        self._put_off = t_s, dt_s, self._told_mm, observation.tip_mm

    def work_off(self) -> None:
        """Find what the last step tells of the lag, and of how the tip answers: not while a frame
        waits for its own."""
        if self._answer_put_off is not None:
            self._answer.add(*self._answer_put_off)
            self._answer_put_off = None
        if self._put_off is not None:
            self.lag.add(*self._put_off)
            self._put_off = None

    def _body_changed(self, jump: Jump) -> None:
        """A load that is taken off again leaves the body as it was before: what was known then is
        known now. Otherwise the jump tells how much further the body goes."""
        self._taken_along = jump.by_mm / length(jump.by_mm)
        if self._unloaded_gains is None:
            self._unloaded_gains = self.gains
        before, load = self._before, self.load
        self._before = jump, self.gains, self.lag.gain_memory(), load.hung
        if before is not None:
            last, gains, memory, hung = before
            grown = float((self.gains / gains).mean()) * load.hung.times / hung.times
            if jump.undoes(last, grown):
                self.gains, load.hung = gains, hung
                self.lag.recall_gains(memory)
                return
        load.hang(jump)

    def see_probe(self, observation: Observation, dt_s: float, moved_mm: Vector) -> None:
        """(3,) was told since the last step, to see how late the body is."""
        self._told_mm = self._told_mm + moved_mm
        if observation.believed:
            self.lag.add(observation.t_ns * 1e-9, dt_s, self._told_mm, observation.tip_mm)

    def end_probe(self) -> None:
        """It has seen enough."""
        self.lag.settle()
        self.lag.break_off()

    def see_made(self, wanted_mm: Vector, made_mm: Vector) -> None:
        """Of (3,) that were wanted in this step the axes make (3,), if none is too slow for it."""
        unmade_mm = wanted_mm - made_mm
        size_mm = length(unmade_mm)
        much = size_mm > _UNMADE_SHARE * length(wanted_mm)
        self._out_of_reach = unmade_mm / size_mm if much else np.zeros(3)

    def step(self, observation: Observation, dt_s: float) -> Vector:
        """(3,) mm to ask for in this step."""
        error = observation.reference_mm - observation.tip_mm
        t_s, lag_s, share = observation.t_ns * 1e-9, self.lag.lag_s, self.predicted
        gain = self._gain_per_s * self._of_use(t_s, dt_s, error)
        answered, hurry = share * self._answer.worth, 0.0
        if self._disturbance.jumped(t_s):  # what the way back tells is all that is known by now
            answered += 1.0 - share
        if self._disturbance.just_jumped(t_s):
            # All the way back is told before much of it is seen, which alone would overshoot.
            gain *= 1.0 + max(1.0 - 2.0 * self.late, 0.0) * _CATCHING
            hurry = max(2.0 * self.late - 1.0, 0.0) * _HURRY
            share = 1.0
        answer = _ONE + answered * (self._answer.matrix - _ONE)
        left = answer @ self._underway.left_mm
        predicted_gain = min(gain, _GAIN_BY_LAG / max(lag_s, _SHORTEST_LAG_S))
        gain = min(gain, _UNPREDICTED_GAIN_BY_LAG / max(lag_s, _SHORTEST_LAG_S))
        gain += share * (predicted_gain - gain)
        self._learn_cycle(observation, dt_s, error)
        error = error + self._correction(observation.phase, 0.0)[0]
        self._see_reference(observation, dt_s)
        if share == 0.0:
            velocity = self._velocity_after_lag(observation, dt_s)
        else:
            velocity, due, further = self._ahead(observation, dt_s)
            coming = answer @ self._underway.coming_mm
            late = due - observation.tip_mm - coming
            late += hurry * float(late @ self._taken_along) * self._taken_along
            error = error + share * (late + further - (left - coming) - error)
        wanted = min(gain * dt_s, 1.0) * error + velocity * dt_s
        self._expect(observation, dt_s)
        self._loaded = self.load.matrix_at(observation.tip_mm + left)  # where it is to come
        return kernels.to_tell(answer, self.gains, self._loaded, wanted)

    def _expect(self, observation: Observation, dt_s: float) -> None:
        """What the tip is off by tells of what it will be; what takes it off at once does not."""
        expected, lag_s = self._expected, self.lag.lag_s
        if observation.ahead is None:
            return
        if observation.believed and not self._disturbance.jumped(observation.t_ns * 1e-9):
            error_mm = observation.reference_mm - observation.tip_mm
            beyond_mm = float(error_mm @ self._out_of_reach)
            speed_mm_s = length(observation.reference_velocity_mm_s)
            within_mm = length(error_mm - beyond_mm * self._out_of_reach)
            expected.add(dt_s, within_mm, speed_mm_s, lag_s, beyond_mm)
        if observation.own_speed_mm_s is not None:
            expected.look_ahead(dt_s, observation.own_speed_mm_s, lag_s)

    def _of_use(self, t_s: float, dt_s: float, error_mm: Vector) -> float:
        """The share of the gain that (3,) this error is met with. Across a long lag the gain is
        bounded by that, and a tip that was taken off needs all of it."""
        if self._disturbance.jumped(t_s):
            self._persistence.begin()
            return 1.0
        share = self._persistence.add(t_s, dt_s, error_mm, self.lag.lag_s)
        return 1.0 - (1.0 - self.predicted) * (1.0 - share)

    def _learn_cycle(self, observation: Observation, dt_s: float, error_mm: Vector) -> None:
        phase = observation.phase
        if not self._by_cycles or phase is None:
            self._on_path_s = 0.0
            if self._cycles is not None:
                self._cycles.break_off()
            return
        if self._cycles is None or not self._cycles.path.fits(phase, observation.reference_mm):
            self._cycles = CycleCorrection(phase.cycle_s, self.lag.lag_s)
            self._on_path_s = 0.0
        self._on_path_s += phase.pace * dt_s
        if not observation.believed or self._disturbance.jumped(observation.t_ns * 1e-9):
            self._cycles.break_off()
            return
        self._cycles.add(phase, dt_s, self.lag.lag_s, error_mm, observation.reference_mm)

    def _correction(self, phase: Phase | None, lead_s: float) -> tuple[Vector, Vector]:
        if self._cycles is None or phase is None:
            return np.zeros(3), np.zeros(3)
        correction, changes = self._cycles.at(phase.after(lead_s))
        return correction, phase.pace * changes

    def _see_reference(self, observation: Observation, dt_s: float) -> None:
        place_mm, velocity_mm_s = observation.reference_mm, observation.reference_velocity_mm_s
        now = Reference(observation.t_ns * 1e-9, place_mm, velocity_mm_s, observation.ahead)
        self._preview.see(now, dt_s, *parts(self.lag.lag_s, self.lag.dead_share))

    def _velocity_after_lag(self, observation: Observation, dt_s: float) -> Vector:
        """(3,) mm/s that the reference will have when what is told now has arrived."""
        lead_s = self.lag.lag_s + (0.5 + self._preview.corner) * dt_s
        aim = self._preview.at(lead_s)
        if aim is None:  # a hand leads, and nobody knows where
            return observation.reference_velocity_mm_s
        return np.asarray(aim[1] + self._correction(observation.phase, lead_s)[1])

    def _ahead(self, observation: Observation, dt_s: float) -> tuple[Vector, Vector, Vector]:
        """(3,) mm/s that what is told is to have; (3,) mm where the reference is after the dead
        time; and (3,) mm that what is told is to be ahead of that, as far as the first-order lag
        is.

        Across a short lag the first is the velocity that the reference will have after it, across a
        long one that of the other two together: it goes with them through a corner."""
        lag_s = self.lag.lag_s
        dead_s, first_order_s = parts(lag_s, self.lag.dead_share)
        corner = self._preview.corner
        averaged = _AVERAGED + corner * (_AVERAGED_AT_CORNERS - _AVERAGED)
        averaged_s = max(averaged * first_order_s, _AVERAGED_AT_LEAST_S)
        sooner_s = corner * dt_s
        next_s = 0.5 * dt_s + sooner_s  # what is told now is gone in the step that follows
        earlier_s, later_s = dead_s + sooner_s - averaged_s, dead_s + sooner_s + averaged_s
        aims = []
        for lead_s in (lag_s + next_s, dead_s, dead_s + next_s, earlier_s, later_s):
            aim = self._preview.at(lead_s)
            if aim is None:  # a hand leads, and nobody knows where
                velocity = observation.reference_velocity_mm_s
                due_mm = observation.reference_mm + dead_s * velocity
                return velocity, due_mm, first_order_s * velocity
            correction, changes = self._correction(observation.phase, lead_s)
            aims.append((aim[0] + correction, aim[1] + changes))
        told, due, following, earlier, later = aims
        mean_velocity = (later[0] - earlier[0]) / (later_s - earlier_s)
        acceleration = (later[1] - earlier[1]) / (later_s - earlier_s)
        velocity = following[1] + first_order_s * acceleration
        velocity = told[1] + self.predicted * (velocity - told[1])
        return velocity, due[0], first_order_s * mean_velocity


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: a second once, then hundredths."""
    body_lag.warm_up()
    answers.warm_up()
    play.warm_up()
    hysteresis.warm_up()
    kernels.to_tell(_ONE, np.ones(3), _ONE, np.ones(3))
