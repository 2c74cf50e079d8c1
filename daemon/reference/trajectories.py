"""Trajectories as they are followed: a place and a velocity for every time."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from config.documents.kinds import TRAJECTORIES, Entry, KindError, described, entry_of, maker
from config.tasks.planned_path import PlannedPath
from config.tasks.trajectory import (
    FARTHEST_MM,
    LONGEST_S,
    FixedPointing,
    Pointed,
    Pointing,
)
from drivers.pose import Vector

Motion = tuple[Vector, Vector]
"""(3,) mm and (3,) mm/s."""


@dataclass(frozen=True)
class Cycle:
    """One cycle: what is where at a time from 0 to its length, and when its velocity jumps."""

    at: Callable[[float], Motion]
    corners_s: Vector = field(default_factory=lambda: np.zeros(0))
    pointing: Callable[[float], Motion] | None = None
    """(3,) unit vector along the tip's axis, and how it changes, 1/s. None: it may be any."""
    lasts_s: float | None = None
    """Its length. None: the options' `cycle_s`."""
    path: PlannedPath | None = None
    """The planned path that it is: it says where the axes should be as well."""


_NEAREST_MM = 1e-3
"""A tip nearer to the point that it points at points anywhere."""
_SHORTEST = 1e-6
"""Of what is half way between two opposite directions."""
_CLOSED_MM = 0.02
_CLOSED_RAD = 1e-3
"""A cycle's end so near to its beginning is there."""


class Trajectory:
    """A cycle and how often it is repeated. Before its time it waits, after it it stands still."""

    def __init__(self, kind: str, cycle: Cycle, cycle_s: float, cycles: int) -> None:
        self.kind = kind
        self.cycle_s = cycle_s
        self.cycles = cycles
        self.corners_s = cycle.corners_s
        self.end_mm = cycle.at(cycle_s)[0]
        self._cycle = cycle
        path = cycle.path
        self._way = None if path is None else (np.array(path.t_s), np.array(path.u).T)

    @property
    def points(self) -> bool:
        """Whether it says where the tip shall point."""
        return self._cycle.pointing is not None

    def pointing_at(self, t_s: float) -> Motion | None:
        """(3,) unit vector along the tip's axis and its change in 1/s, `t_s` after the start."""
        if self._cycle.pointing is None:
            return None
        if t_s < 0.0 or t_s >= self.duration_s:
            end_s = 0.0 if t_s < 0.0 else self.cycle_s
            return self._cycle.pointing(end_s)[0], np.zeros(3)
        return self._cycle.pointing(t_s - self.cycle_of(t_s) * self.cycle_s)

    @property
    def path(self) -> PlannedPath | None:
        """The planned path that it is; None: it is another kind of trajectory."""
        return self._cycle.path

    def posture_at(self, t_s: float) -> Vector | None:
        """(m,) where the axes should be `t_s` after the start; None: nobody said."""
        if self._way is None:
            return None
        times, columns = self._way
        return np.array([np.interp(t_s, times, column) for column in columns])

    @property
    def duration_s(self) -> float:
        return self.cycle_s * self.cycles

    @property
    def start_mm(self) -> Vector:
        return self._cycle.at(0.0)[0]

    def at(self, t_s: float) -> Motion:
        """(3,) mm and (3,) mm/s at `t_s` after the start."""
        if t_s < 0.0:
            return self.start_mm, np.zeros(3)
        if t_s >= self.duration_s:
            return self.end_mm.copy(), np.zeros(3)
        return self._cycle.at(t_s - self.cycle_of(t_s) * self.cycle_s)

    @property
    def closed(self) -> bool:
        """Whether a cycle ends where it begins, and points there as it began."""
        return not self.why_open

    @property
    def why_open(self) -> str:
        """What its end is not like its beginning in; nothing where it is closed."""
        gap_mm = float(np.linalg.norm(self.end_mm - self.start_mm))
        if gap_mm > _CLOSED_MM:
            return f"its end is {gap_mm:.2f} mm away from its beginning"
        pointing = self._cycle.pointing
        if pointing is None:
            return ""
        apart_rad = float(np.linalg.norm(pointing(0.0)[0] - pointing(self.cycle_s)[0]))
        if apart_rad > _CLOSED_RAD:
            return "at its end it points otherwise than at its beginning"
        return ""

    def in_cycle(self, t_s: float) -> Motion:
        """(3,) mm and (3,) mm/s at a time within one cycle, its very end included."""
        return self._cycle.at(t_s)

    def cycle_of(self, t_s: float) -> int:
        """Number of the cycle at `t_s`, from 0 to `cycles` − 1."""
        return min(max(int(t_s / self.cycle_s), 0), self.cycles - 1)


def make_trajectory(options: Pointed, base: Path, cycles: int | None = None) -> Trajectory:
    """The trajectory that `options` describe.

    base: where relative file names start. cycles: instead of the options' own number; a hold is
    that many times as long. Raises WaypointError for waypoints that cannot be used,
    PlannedPathError for a file that is no path, KindError for
    what a package has that cannot be used, ValueError for what would never end.
    """
    if cycles is not None and cycles < 1:
        raise ValueError(f"a trajectory has 1 cycle or more, not {cycles}")
    declared: int = getattr(options, "cycles", 1)
    repeated = declared if cycles is None else cycles
    make, entry = maker(TRAJECTORIES, options), entry_of(TRAJECTORIES, options)
    if entry.shipped:
        cycle: Cycle = make(options, base, repeated)
        lasts_s = cycle.lasts_s or float(getattr(options, "cycle_s", 0.0))
    else:
        cycle, lasts_s = sampled(entry, lambda: make(options, base, repeated), options)
    if options.pointing is not None and cycle.pointing is not None:
        raise ValueError("the waypoints say where to point, and so does `pointing`")
    trajectory = Trajectory(options.kind, _pointed(cycle, options.pointing), lasts_s, repeated)
    if repeated > 1 and trajectory.why_open:
        raise ValueError(f"it cannot be gone along {repeated} times: {trajectory.why_open}")
    if not trajectory.duration_s <= LONGEST_S:
        raise ValueError(f"all cycles together take longer than {LONGEST_S:g} s")
    return trajectory


def _pointed(cycle: Cycle, pointing: Pointing | None) -> Cycle:
    """The cycle, with the law after which the tip points; without one as it is."""
    if pointing is None:
        return cycle
    if isinstance(pointing, FixedPointing):
        fixed = np.array(pointing.direction)
        fixed /= np.linalg.norm(fixed)
        return replace(cycle, pointing=lambda _: (fixed.copy(), np.zeros(3)))
    point, sign = np.array(pointing.point_mm), 1.0 if pointing.kind == "away_from" else -1.0

    def at(t_s: float) -> Motion:
        place, velocity = cycle.at(t_s)
        way = sign * (place - point)
        far_mm = max(float(np.sqrt(way @ way)), _NEAREST_MM)
        direction = way / far_mm
        aside = sign * velocity - (direction @ velocity) * sign * direction
        return direction, aside / far_mm

    return replace(cycle, pointing=at)


# A cycle of a package. All of it is worked out before it is followed, at rest and off the loop:
# whatever is wrong with it is known then, and nothing of the package runs while a robot moves.


_SAMPLE_S = 0.01
"""A smooth path at 10 Hz of its own, 10 mm wide, is off by 2 micrometres in between."""
_FEWEST, _MOST = 200, 100_000
_ASIDE_S = 1e-9
"""From a corner, into the leg that is meant."""
_TOLD_WITHIN = 0.25
"""Of a velocity: what it may differ from how the places change. A path at 10 Hz is off by 0.03."""
_TOLD_WITHIN_MM_S = 1.0
_LEAP = 1e-3
"""mm, or of a direction; far more than the 2 ns take between the ends of two legs."""
_JUDGED_S = (1e-6, 0.05)
"""Legs between which what a place and a velocity say can be compared."""


def sampled(entry: Entry, make: Callable[[], object], options: Pointed) -> tuple[Cycle, float]:
    """What a package makes, as cubics between samples that were looked at, and its length in s.

    Raises KindError, with the package's name, for whatever it does wrong.
    """
    try:
        cycle = make()
        if not isinstance(cycle, Cycle):
            raise TypeError(f"it made no Cycle, but {cycle!r:.60}")
        lasts_s = cycle.lasts_s or float(getattr(options, "cycle_s", 0.0))
        if not 0.0 < lasts_s <= LONGEST_S:
            raise ValueError(f"a cycle cannot last {lasts_s:g} s")
        corners = np.asarray(cycle.corners_s, np.float64).ravel()
        inner = corners[(corners > 0.0) & (corners < lasts_s)]
        count = min(max(int(lasts_s / _SAMPLE_S), _FEWEST), _MOST)
        times = np.union1d(np.linspace(0.0, lasts_s, count + 1), inner)
        path = _cubics(times, cycle.at)
        pointing = None if cycle.pointing is None else _cubics(times, cycle.pointing, unit=True)
    except (Exception, SystemExit) as error:  # whatever a package does
        raise KindError(f"{entry} failed: {described(error)}") from error
    return Cycle(path, corners, pointing), lasts_s


def _cubics(
    times: Vector, at: Callable[[float], Motion], unit: bool = False
) -> Callable[[float], Motion]:
    """Hermite's cubics through (n,) times, whose velocities may jump there. unit: of directions."""
    ends = np.stack([times[:-1] + _ASIDE_S, times[1:] - _ASIDE_S], axis=1)
    motions = np.array([[_checked_motion(at(float(t)), t, unit) for t in leg] for leg in ends])
    _check_velocities(times, motions, _TOLD_WITHIN if unit else _TOLD_WITHIN_MM_S)
    begins_s: list[float] = times[:-1].tolist()

    def between(t_s: float) -> Motion:
        leg = max(bisect_right(begins_s, t_s) - 1, 0)
        lasts_s = times[leg + 1] - times[leg]
        s = (t_s - times[leg]) / lasts_s
        (p, v), (q, w) = motions[leg]
        v, w = lasts_s * v, lasts_s * w
        bend, twist = 3.0 * (q - p) - 2.0 * v - w, v + w - 2.0 * (q - p)
        place = p + s * (v + s * (bend + s * twist))
        velocity = (v + s * (2.0 * bend + s * 3.0 * twist)) / lasts_s
        if not unit:
            return place, velocity
        length = max(float(np.sqrt(place @ place)), _SHORTEST)
        direction = place / length
        return direction, (velocity - (direction @ velocity) * direction) / length

    return between


def _check_velocities(times: Vector, motions: Vector, least: float) -> None:
    """Raises ValueError where places and velocities contradict each other: the cubics between them
    would run to and fro, unseen by who looks at the samples.

    motions: (n − 1, 2, 2, 3) places and velocities at both ends of each leg. A corner that was not
    declared lies in one leg, which is then no faster than its ends; a contradiction in two.
    """
    leaps = np.linalg.norm(motions[1:, 0, 0] - motions[:-1, 1, 0], axis=1)
    if leaps.max(initial=0.0) > _LEAP:
        worst = int(np.argmax(leaps))
        raise ValueError(f"at {times[worst + 1]:g} s its places leap by {leaps[worst]:.3g}")
    lasts_s = np.diff(times)
    moves = (motions[:, 1, 0] - motions[:, 0, 0]) / lasts_s[:, None]
    told = motions[:, :, 1].mean(axis=1)
    fast = np.linalg.norm(moves, axis=1)
    fastest_end = np.linalg.norm(motions[:, :, 1], axis=2).max(axis=1)
    off = least + _TOLD_WITHIN * np.maximum(fast, np.linalg.norm(told, axis=1))
    wrong = np.linalg.norm(moves - told, axis=1) > off
    wrong[:-1] &= wrong[1:]
    wrong[-1] = False
    wrong |= fast > least + 2.0 * fastest_end
    wrong &= (lasts_s > _JUDGED_S[0]) & (lasts_s < _JUDGED_S[1])
    if wrong.any():
        leg = int(np.flatnonzero(wrong)[0])
        says, does = (", ".join(f"{v:.4g}" for v in one[leg]) for one in (told, moves))
        raise ValueError(
            f"at {times[leg]:g} s it gives a velocity of ({says}) per second, and its places "
            f"change by ({does})"
        )


def _checked_motion(motion: Motion, t_s: float, unit: bool) -> tuple[Vector, Vector]:
    place, velocity = (np.asarray(one, np.float64) for one in motion)
    if place.shape != (3,) or velocity.shape != (3,):
        raise ValueError(f"at {t_s:g} s it gives shapes {place.shape} and {velocity.shape}")
    if not (np.isfinite(place).all() and np.isfinite(velocity).all()):
        raise ValueError(f"at {t_s:g} s it gives what is not a number")
    if not unit and np.abs(place).max() > FARTHEST_MM:
        raise ValueError(f"at {t_s:g} s it is farther away than {FARTHEST_MM:g} mm")
    if unit and not 0.99 < float(np.linalg.norm(place)) < 1.01:
        raise ValueError(f"at {t_s:g} s its direction is no unit vector")
    return place, velocity
