"""The tip's task as one vector: where it is, in mm, and, where it points as well, its direction.

A direction is the unit vector along the tip's axis. So that both may stand in one vector, it is
multiplied by a length: what turning by one radian counts for, in mm. Three numbers of a direction
are two degrees of freedom: a change along the direction itself does not exist.
"""

from typing import Final

import numpy as np

from daemon.control.controller import Observation
from drivers.pose import Vector, length

POSITION: Final = 3
"""Coordinates of a task without a direction ..."""
POSE: Final = 6
"""... and of one with it."""
_DIRECTION_FREEDOM: Final = 2


def tip_axis(quaternion: Vector) -> Vector:
    """(3,) the z axis of a frame that is turned by (4,), scalar first."""
    w, x, y, z = quaternion.tolist()
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])


def rank_of(coordinates: int) -> int:
    """Degrees of freedom of a task of so many coordinates."""
    return POSITION if coordinates == POSITION else POSITION + _DIRECTION_FREEDOM


def points(observation: Observation) -> bool:
    """Whether the tip shall point somewhere, and is seen to."""
    return observation.reference_direction is not None and observation.tip_direction is not None


def task_of(observation: Observation, coordinates: int, mm_per_rad: float) -> Vector | None:
    """(3,) mm of the tip, or (6,) with its direction; None: that is not seen."""
    if coordinates == POSITION:
        return observation.tip_mm
    if observation.tip_direction is None:
        return None
    return np.concatenate([observation.tip_mm, mm_per_rad * observation.tip_direction])


def turn_between(one: Vector, other: Vector) -> Vector:
    """(3,) rad: the way from one direction to another on the sphere, where `one` is.

    As long as the angle between them. Opposite directions have no shortest way: there it is zero.
    """
    along = float(one @ other)
    aside = other - along * one
    sine = float(np.sqrt(aside @ aside))
    return np.asarray(aside * (float(np.arctan2(sine, along)) / sine if sine > 1e-12 else 1.0))


def within(vector: Vector, most: float) -> Vector:
    """The vector, as a whole no longer than `most`."""
    long = length(vector)
    return vector if long <= most else np.asarray(vector * (most / long))


def angle_between(one: Vector, other: Vector) -> float:
    """rad between two directions, however long they are."""
    x, y, z = np.cross(one, other).tolist()
    return float(np.arctan2((x * x + y * y + z * z) ** 0.5, float(one @ other)))
