"""Whether the axes are fast enough for a path, asked before anything moves.

The path is gone along in thought, as the controller would lead the axes along it by what it knows
of the robot. Where an axis had to be faster than it may be, the others take over what they can; if
that is not all the tip stays behind, and with speed to spare it comes up again. The axes are too
slow for a path along which the tip would come to be too far behind. A short haste is none.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil, sqrt
from typing import Final, Protocol, runtime_checkable

import numpy as np

from daemon.reference.trajectories import Trajectory
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

BEHIND_MM: Final = 4.0
"""What a tip may be behind for a moment: some corners are followed no better. A model whose speeds
are a tenth too high makes 3 mm of 30 mm at the limit. On a path that a soft arm follows to 2 mm six
explorations have it 0 to 3.7 mm behind."""
_PLACE_MM: Final = 3.0
"""After so much of the path the model is asked anew: a Jacobian changes by some per cent."""
_LONG_S: Final = 0.2
_FEWEST, _MOST = 2000, 20_000
"""Of equal pieces of a cycle, none longer than that: as many as are looked at."""
_AT_ONCE: Final = 20
_LEFT_MM: Final = 1.0
"""... where a path is said to be one that can be followed."""
_FASTEST_MM_S: Final = 1e4
"""Of a tip that nothing is known to slow down."""
_ROUNDS: Final = 3
"""What is behind at the end of a cycle is behind at the beginning of the next."""
_UNHURRIED: Final = 0.5
"""Of the axes' speed, on the way to a path: a body may be half as willing as the one that was
learnt, and what its tip comes to be off by is to be made up for."""
_WAY_PLACES: Final = 7
"""Looked at on the way to a path: it is asked for in the step with which motion begins, which takes
a millisecond longer for it. An odd number: the tip is fastest in the middle."""


@dataclass(frozen=True)
class Foresight:
    """How a controller would lead the axes, as far as it knows before anything moves."""

    begin: Callable[[Vector], Vector | None]
    """(m,) axes with which the tip is at (3,) mm; None: it was never near there."""
    jacobian: Callable[[Vector, Vector], Vector | None]
    """(3, m) mm per mm or rad with the tip at (3,) mm and axes at (m,); None: not known there."""
    velocity: Callable[[Vector, Vector, Vector], Vector]
    """(m,) per second for (3, m), (3,) mm/s of the tip and (m,) axes, whatever these can do."""


@runtime_checkable
class HasForesight(Protocol):
    """A controller that may know, before anything moves, how it would lead the axes."""

    @property
    def foresight(self) -> Foresight | None:
        """None: it knows nothing yet."""
        ...


@dataclass(frozen=True)
class _Paces:
    """Of n short pieces of a path, each as long in time."""

    dt_s: float
    tip_mm_s: Vector
    """(n,)"""
    axes: Vector
    """(n, m) per second, what is asked of the axes; 0: nobody knows."""
    shares: Vector
    """(n,) of what the axes may do, that of the one with the most to do."""

    def behind_mm(self, rounds: int, longer: float = 1.0) -> Vector:
        """(n,) how far the tip comes to be behind in the last of so many cycles, if each takes so
        many times as long."""
        asked = (self.shares > 0.0) & (self.tip_mm_s > 0.0)
        known = np.maximum.accumulate(np.where(asked, np.arange(len(asked)), -1))
        able = (self.tip_mm_s / np.where(asked, self.shares, 1.0))[known]
        able = np.where(known < 0, np.inf, able)
        gained = np.maximum(self.tip_mm_s / longer - able, -_FASTEST_MM_S) * self.dt_s * longer
        total = np.cumsum(np.tile(gained, rounds))
        behind = total - np.minimum(np.minimum.accumulate(total), 0.0)
        return np.asarray(behind[-len(asked) :])


Way = Callable[[float], tuple[Vector, Vector]]
"""(3,) mm and (3,) mm/s of the tip, so many seconds after it begins."""


def unhurried_s(way: Way, duration_s: float, foresight: Foresight, axes: AxisRanges) -> float:
    """How long a way should take that would take `duration_s`, for the axes' sake: no less, and as
    far as is known of it so long that no axis has to go faster for it than half of what it can."""
    u, hurry, dt_s = foresight.begin(way(0.0)[0]), 0.0, duration_s / _WAY_PLACES
    for k in range(_WAY_PLACES):
        tip_mm, velocity = way((k + 0.5) * dt_s)
        jacobian = None if u is None else foresight.jacobian(tip_mm, u)
        if u is None or jacobian is None:
            break
        asked = foresight.velocity(jacobian, velocity, u)
        for_the_way = asked - foresight.velocity(jacobian, np.zeros(3), u)
        hurry = max(hurry, float((np.abs(for_the_way) / axes.max_velocity).max()))
        u = u + dt_s * asked
    return duration_s * max(hurry / _UNHURRIED, 1.0)


def speed_looks(
    trajectory: Trajectory, foresight: Foresight, axes: AxisRanges
) -> Iterator[str | None]:
    """Why the axes are too slow for the trajectory, as a sentence, in pieces of a millisecond.

    The first that is not None is the answer; without one they are fast enough, or nobody knows.
    """
    count = int(min(max(trajectory.cycle_s / _LONG_S, _FEWEST), _MOST))
    times = np.linspace(0.0, trajectory.cycle_s, count + 1)
    points, asked = np.zeros((count + 1, 3)), np.zeros((count, axes.count))
    points[0] = trajectory.in_cycle(0.0)[0]
    dt_s, since_mm = float(times[1]), np.inf
    u: Vector | None = None
    jacobian: Vector | None = None
    for k in range(count):
        points[k + 1] = trajectory.in_cycle(times[k + 1])[0]
        way = points[k + 1] - points[k]
        if since_mm >= _PLACE_MM:
            since_mm = 0.0
            u = foresight.begin(points[k]) if u is None else u
            jacobian = None if u is None else foresight.jacobian(points[k], u)
        since_mm += sqrt(way @ way)
        if u is None or jacobian is None:
            u = None
        else:
            asked[k] = foresight.velocity(jacobian, way / dt_s, u)
            u = u + dt_s * asked[k]
        if k % _AT_ONCE == 0:
            yield None
    speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / dt_s
    shares = (np.abs(asked) / axes.max_velocity).max(axis=1)
    yield _answer(trajectory, points, _Paces(dt_s, speeds, asked, shares), axes)


def _answer(trajectory: Trajectory, points: Vector, paces: _Paces, axes: AxisRanges) -> str | None:
    rounds = min(trajectory.cycles, _ROUNDS)
    behind_mm = paces.behind_mm(rounds)
    last = int(np.argmax(behind_mm))
    if not behind_mm[last] > BEHIND_MM:
        return None
    caught_up = np.flatnonzero(behind_mm[:last] <= 0.0)
    first = int(caught_up[-1]) + 1 if caught_up.size else 0
    worst = first + int(np.argmax(paces.shares[first : last + 1]))
    axis = int(np.argmax(np.abs(paces.axes[worst]) / axes.max_velocity))
    longer = _longer(paces, rounds)
    slower_mm_s = float(paces.tip_mm_s.max()) / longer
    place, unit = ", ".join(f"{value:.0f}" for value in points[worst]), axes.units[axis]
    return (
        f"at {worst * paces.dt_s:.1f} s the {trajectory.kind} trajectory is at ({place}) mm, at "
        f"{paces.tip_mm_s[worst]:.3g} mm/s, and {axes.names[axis]} would have to go "
        f"{abs(paces.axes[worst, axis]):.3g} {unit}/s, where {axes.max_velocity[axis]:g} is the "
        f"most, by what the controller knows of the robot: the tip would come to be "
        f"{behind_mm[last]:.3g} mm of its way behind. Up to {slower_mm_s:.3g} mm/s it can be "
        f"followed: let a cycle take {longer * trajectory.cycle_s:.4g} s instead of "
        f"{trajectory.cycle_s:.4g}"
    )


def _longer(paces: _Paces, rounds: int) -> float:
    """How many times as long a cycle has to take, to the next hundredth."""
    most = max(1.0, float(paces.shares.max()))
    low, high = 1.0, most
    while high - low > 0.005 * low:
        middle = 0.5 * (low + high)
        enough = paces.behind_mm(rounds, middle).max() <= _LEFT_MM
        low, high = (low, middle) if enough else (middle, high)
    return ceil(100.0 * high) / 100.0
