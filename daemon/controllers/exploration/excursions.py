"""The first motions of a controller that knows nothing: each axis a little out and back.

Between the motions the body is given time to settle, and many frames are taken then. What an
excursion does to the tip is the slope of a line through the frames before, at and after it; a
drift that is even in time (creep) does not disturb it. Of a body that is late the rests are over
before all of it has come: once that is known all frames tell it, with the axes as the tip shows
them.

At the end all axes go out together. Where each of them swings the tip aside a lot and lifts it
a little, the swing lowers the tip too, and one by one they tell the lift badly. Of many tendons
none goes out alone, which would strain the others: they go as bends the body.
"""

import numpy as np

from config.tasks.controllers import Broyden
from daemon.control.controller import ControllerError, Observation
from daemon.control.task import POSE, POSITION, task_of
from daemon.control.tip_following import step_time
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_OUT_ENOUGH = 0.5
"""Of an excursion, where no more of it is let through."""
_ARRIVED = 0.1
"""Share of the amplitude that an axis may be away from where it was to go."""
_PATIENCE_S = 5.0
"""An excursion that takes so much longer than it should is given up."""
_FRAMES_AT_LEAST = 3
_RESTS = 3
_STILL_MM = 0.25
"""A tip that goes no further than this in half of the time to settle, is settled."""
_WAITS_AT_MOST = 10.0
"""Times to settle: then it creeps, or something pulls it."""
_FRAMES_AT_MOST = 4000

Frame = tuple[float, Vector, Vector]
"""Time in s, (m,) where the axes were, (3,) where the tip was, or (6,) with its direction."""


class Excursions:
    """Goes through the excursions. What is found so far is kept when motion is interrupted."""

    def __init__(self, options: Broyden, axes: AxisRanges) -> None:
        self._options = options
        self._axes = axes
        self._amplitude = options.explore_share * axes.scale
        self._speed = options.explore_speed_share * axes.max_velocity
        self._plan = [axes.bent_as_far(one, share=1.0) for one in np.eye(axes.count)]
        together = options.explore_together
        if together is None:
            together = not axes.opposed
        if together and axes.count > 1:
            self._plan.append(np.ones(axes.count))
        self._made: list[Vector] = []
        self._effects: list[Vector] = []
        self._homes: list[Vector] = []
        self._frames_of: list[slice] = []
        """Which of `all_frames` are of each excursion that was made."""
        self._home: Vector | None = None
        self._left: Vector | None = None
        """The home of an excursion that was interrupted."""
        self._out = np.zeros(axes.count)
        self._rests: list[list[Frame]] = []
        self._rests_begin: list[int] = []
        """How many frames there were then."""
        self._moving = False
        self._asked = True
        """Whether a step was asked for since the last frame. A robot that is held is not asked, and
        its frames are of no excursion, however many they are."""
        self._elapsed_s = 0.0
        self._coordinates: int | None = None
        """Of what is seen of the tip. None before the first frame."""
        self.all_frames: list[Frame] = []
        """All that were seen, moving and at rest."""
        self._begin_rest()

    @property
    def done(self) -> bool:
        return len(self._effects) == len(self._plan)

    @property
    def jacobian(self) -> Vector:
        """(3, m) mm per whole range of each axis, once `done`; (6, m) with directions."""
        return self._jacobian_of(self._effects)

    def jacobian_of_late(self, shown: Vector) -> Vector:
        """The same of a body that is late. shown: (n, m) axes of `all_frames` as their tips show
        them."""
        effects = list(self._effects)
        for k, rows in enumerate(self._frames_of):
            if rows.stop < _FRAMES_AT_MOST:
                frames = zip(self.all_frames[rows], shown[rows], strict=True)
                as_shown = [(t_s, u, seen) for (t_s, _, seen), u in frames]
                effects[k] = _effect(as_shown, self._homes[k], self._made[k])
        return self._jacobian_of(effects)

    def _jacobian_of(self, effects: list[Vector]) -> Vector:
        moved = np.array(self._made) / self._axes.scale
        return np.asarray(_fitted(moved, np.array(effects)).T)

    @property
    def note(self) -> str:
        return "" if self.done else f"measures what {self._who} does to the tip"

    def reset(self) -> None:
        """Motion begins again: so does the excursion that was interrupted."""
        if self._home is not None:
            self._home, self._left = None, self._home
        self._rests, self._rests_begin = [], []
        self._asked = True
        self._begin_rest()

    def observe(self, observation: Observation) -> None:
        """Take a frame, if the body is at rest by now."""
        if self.done or not self._asked:
            return
        self._asked = False
        if self._coordinates is None:
            self._coordinates = POSITION if observation.tip_direction is None else POSE
        seen = task_of(observation, self._coordinates, self._options.pointing_mm_per_rad)
        if seen is None:
            return
        if self._options.leads and len(self.all_frames) < _FRAMES_AT_MOST:
            self.all_frames.append((observation.t_ns * 1e-9, observation.u, seen))
        if self._moving or self._elapsed_s < 0.5 * self._options.settle_s:
            return
        self._rests[-1].append((observation.t_ns * 1e-9, observation.u, seen))

    def propose(self, observation: Observation) -> Vector:
        """(m,) the next step of the excursion. Raises ControllerError if an axis is stuck."""
        still = np.zeros(self._axes.count)
        if self.done:
            return still
        self._asked = True
        dt_s = step_time(observation)
        self._elapsed_s += dt_s
        if self._home is None:
            self._home = self._home_of(observation.targets)
            self._out = self._excursion(self._home)
            if (np.abs(observation.targets - self._home) > _ARRIVED * self._amplitude).any():
                self._come_inside()
        if not self._moving:
            if self._elapsed_s >= self._options.settle_s and self._enough():
                self._end_rest(self._home)
            return still
        goal = self._home if len(self._rests) in (0, _RESTS - 1) else self._home + self._out
        away = np.maximum(np.abs(observation.u - goal), np.abs(observation.targets - goal))
        if (away <= _ARRIVED * self._amplitude).all():
            self._begin_rest()
        elif self._elapsed_s > float((self._amplitude / self._speed).max()) + _PATIENCE_S:
            if not self._out_enough(observation, goal):
                raise self._stuck(int(np.argmax(away / self._amplitude)), observation, goal)
            self._begin_rest()
        most = self._speed * dt_s
        return np.asarray(np.clip(goal - observation.targets, -most, most))

    @property
    def _who(self) -> str:
        axis = len(self._effects)
        return self._axes.names[axis] if axis < self._axes.count else "moving all axes"

    def _home_of(self, targets: Vector) -> Vector:
        """(m,) where an excursion begins: here, or where the one began that was interrupted.

        From where it was interrupted it would go farther out each time, until nothing lets it.
        """
        left, self._left = self._left, None
        on_its_way = (1.0 + _ARRIVED) * self._amplitude
        if left is not None and (np.abs(targets - left) <= on_its_way).all():
            return left
        return np.asarray(np.clip(targets, self._axes.lowest, self._axes.highest))

    def _excursion(self, home: Vector) -> Vector:
        """(m,) of the next one: outwards, and inwards where there is no room left."""
        axes, out = self._axes, self._plan[len(self._effects)] * self._amplitude
        if axes.bending is None:
            outwards = home + self._amplitude <= axes.highest
            return np.asarray(out * np.where(outwards, 1.0, -1.0))
        outwards = (home + out <= axes.highest) & (home + out >= axes.lowest)
        return np.asarray(out if outwards.all() else -out)

    def _come_inside(self) -> None:
        """Before the first rest: homing may leave an axis a little outside its travel."""
        self._rests, self._rests_begin = [], []
        self._moving, self._elapsed_s = True, 0.0

    def _begin_rest(self) -> None:
        self._rests.append([])
        self._rests_begin.append(len(self.all_frames))
        self._moving = False
        self._elapsed_s = 0.0

    def _end_rest(self, home: Vector) -> None:
        """Go on: out, back, or to the next excursion, whose first rest this one is as well."""
        if len(self._rests) == _RESTS:
            frames = [frame for rest in self._rests for frame in rest]
            self._made.append(self._out)
            self._effects.append(_effect(frames, home, self._out))
            self._homes.append(home)
            self._frames_of.append(slice(self._rests_begin[0], len(self.all_frames)))
            self._home = None
            self._rests, self._rests_begin = self._rests[-1:], self._rests_begin[-1:]
            return
        self._moving, self._elapsed_s = True, 0.0

    def _enough(self) -> bool:
        """Whether the tip stands still, by the frames of the last part of the rest."""
        frames, settle_s = self._rests[-1], self._options.settle_s
        if len(frames) < _FRAMES_AT_LEAST or not self._options.leads:
            return len(frames) >= _FRAMES_AT_LEAST
        del frames[: sum(frames[-1][0] - frame[0] > 0.5 * settle_s for frame in frames)]
        third = max(1, len(frames) // 3)
        places = np.array([frame[2][:POSITION] for frame in frames])
        moved_mm = places[-third:].mean(axis=0) - places[:third].mean(axis=0)
        still = float(moved_mm @ moved_mm) < _STILL_MM**2
        return still or self._elapsed_s > _WAITS_AT_MOST * settle_s

    def _out_enough(self, observation: Observation, goal: Vector) -> bool:
        """Whether the axes are where they were let go, and that is most of the way out: beside an
        obstacle they are turned aside, and effects are of what they have made in truth."""
        home, u, targets = goal - self._out, observation.u, observation.targets
        follow = (np.abs(u - targets) <= _ARRIVED * self._amplitude).all()
        made = float((u - home) @ self._out / (self._out @ self._out))
        return bool(follow) and len(self._rests) not in (0, _RESTS - 1) and made >= _OUT_ENOUGH

    def _stuck(self, axis: int, observation: Observation, goal: Vector) -> ControllerError:
        return ControllerError(
            f"{self._axes.names[axis]} was to go to {goal[axis]:.3g} {self._axes.units[axis]}, and "
            f"is at {observation.u[axis]:.3g} after {self._elapsed_s:.0f} s: see what holds it, or "
            "begin where the tip is free"
        )


def _effect(frames: list[Frame], home: Vector, out: Vector) -> Vector:
    """(3,) or (6,) motion of the tip by an excursion: c of p = a + b t + c s, by least squares.

    s is how much of the excursion the axes had made.
    """
    squared = out @ out
    table = np.array([[t_s, (u - home) @ out / squared, *seen] for t_s, u, seen in frames])
    centred = table - table.mean(axis=0)
    return np.asarray(_fitted(centred[:, :2], centred[:, 2:])[1])


def _fitted(inputs: Vector, outputs: Vector) -> Vector:
    """Least squares. Positions by themselves: what is seen beside them rounds nothing in them."""
    parts = [outputs[:, :POSITION], outputs[:, POSITION:]]
    solutions = [np.linalg.lstsq(inputs, part, rcond=None)[0] for part in parts if part.size]
    return np.concatenate(solutions, axis=1)
