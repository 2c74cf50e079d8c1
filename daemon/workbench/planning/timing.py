"""When a path is where: as fast as the axes, the tip and the room round the body allow.

Along a path of many small straight pieces the speed is bounded from velocities, accelerations and
clearance at each place, and then, forwards and backwards, by how fast it may change (Bobrow,
Dubowsky and Gibson 1985, with half of each axis' acceleration for bends and half for speeding up).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from config.robot import Robot
from daemon.workbench.planning.body_in_place import BodyInPlace
from safety.risk.model.mixture import FloatArray

_VELOCITY_SHARE: Final = 0.8
"""Of what an axis can do: a controller needs the rest to correct."""
_ACCELERATION_SHARE: Final = 0.5
_ROOM_MM: Final = 10.0
"""With less clearance it goes slower, in proportion."""
_SLOWEST: Final = 0.25
"""Of the speed with room, however little room there is."""
_LEAST: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Speeds:
    """What may not be exceeded on the way."""

    tip_mm_s: float
    velocity: FloatArray
    """(m,) of the axes, mm/s or rad/s."""
    acceleration: FloatArray
    """(m,) mm/s² or rad/s²."""

    @classmethod
    def of(cls, robot: Robot, tip_mm_s: float) -> "Speeds":
        """What a plan takes of a robot's axes."""
        return cls(
            tip_mm_s,
            _VELOCITY_SHARE * np.array([axis.max_velocity for axis in robot.axes]),
            _ACCELERATION_SHARE * np.array([axis.max_acceleration for axis in robot.axes]),
        )


def times_along(
    body: BodyInPlace, places: FloatArray, clearances_mm: FloatArray, speeds: Speeds
) -> FloatArray:
    """(k,) s at which to be at each of (k, m) places, from 0, at rest at both ends.

    clearances_mm: (k,) at each of them.
    """
    tips = np.array([body.tip(u)[:3] for u in places])
    return timed(places, tips, clearances_mm, speeds)


def timed(
    places: FloatArray, tips_mm: FloatArray, clearances_mm: FloatArray, speeds: Speeds
) -> FloatArray:
    """The same with (k, 3) tips that are known. The path's parameter is the number of the place.

    It is at rest only at its ends: of two places there is one more between, where it may move.
    """
    if len(places) == 2:
        finer = _with_middle(places), _with_middle(tips_mm), _with_middle(clearances_mm)
        return timed(*finer, speeds)[::2]
    by_place = _longest_beside(np.abs(np.diff(places, axis=0)))
    bends = np.gradient(np.gradient(places, axis=0), axis=0)
    tip_by_place = _longest_beside(np.linalg.norm(np.diff(tips_mm, axis=0), axis=1))
    room = np.clip(clearances_mm / _ROOM_MM, _SLOWEST, 1.0)
    by_velocity = (speeds.velocity / np.maximum(by_place, _LEAST)).min(axis=1)
    by_tip = speeds.tip_mm_s / np.maximum(tip_by_place, _LEAST)
    half = 0.5 * speeds.acceleration
    by_bend = np.sqrt((half / np.maximum(np.abs(bends), _LEAST)).min(axis=1))
    rate = np.minimum(np.minimum(by_velocity, by_tip) * room, by_bend)
    faster = (half / np.maximum(by_place, _LEAST)).min(axis=1)
    rate[0] = rate[-1] = 0.0
    for k in range(1, len(rate)):
        most = np.sqrt(rate[k - 1] ** 2 + 2.0 * min(faster[k - 1], faster[k]))
        rate[k] = min(rate[k], most)
    for k in range(len(rate) - 2, -1, -1):
        most = np.sqrt(rate[k + 1] ** 2 + 2.0 * min(faster[k + 1], faster[k]))
        rate[k] = min(rate[k], most)
    lasts = 2.0 / np.maximum(rate[1:] + rate[:-1], _LEAST)
    return np.concatenate([[0.0], np.cumsum(lasts)])


def _with_middle(two: FloatArray) -> FloatArray:
    """(3, …) of (2, …)."""
    return np.asarray(np.stack([two[0], two.mean(axis=0), two[1]]))


def _longest_beside(steps: FloatArray) -> FloatArray:
    """(k, …) of each place the longer of the (k − 1, …) steps to it and from it: between two places
    nothing is then faster than at both of them."""
    nothing = np.zeros_like(steps[:1])
    before, after = np.concatenate([nothing, steps]), np.concatenate([steps, nothing])
    return np.asarray(np.maximum(before, after))
