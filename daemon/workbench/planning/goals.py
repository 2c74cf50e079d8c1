"""Places of the axes that bring the tip where it is wanted: several, as many as the body has.

The model's mean shape is inverted by damped least squares (Levenberg and Marquardt) from several
beginnings, since a body that has more axes than a tip has coordinates comes there in many ways, and
of these one may touch what another keeps away from.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np

from daemon.workbench.planning.body_in_place import CLOSE_SHARE, BodyInPlace
from safety.risk.model.mixture import FloatArray

TOLERANCE_MM: Final = 1.0
"""Less than the model's own error, of the mean."""
TOLERANCE_RAD: Final = radians(3.0)
_MM_PER_RAD: Final = 100.0
"""What an error of direction counts."""
_MM_PER_REACH: Final = 60.0
"""What it counts to be further from the training than may be, of the model's reach."""
_ITERATIONS: Final = 25
_STEP: Final = 1e-3
"""In the network's inputs, for differences."""
_DAMPING: Final = 1.0
_LEAST_DAMPING: Final = 1e-6
"""A body that has more axes than a tip has coordinates is nowhere determined without any."""
_LONGEST: Final = 0.4
"""In the network's inputs: a step of the search goes no farther."""
_APART: Final = 0.15
"""In the network's inputs: places nearer to each other are one."""


@dataclass(frozen=True)
class TipGoal:
    """Where the tip is wanted."""

    place_mm: FloatArray
    """(3,)."""
    direction: FloatArray | None = None
    """(3,) unit vector along the tip's axis. None: anywhere."""

    def off(self, tip: FloatArray) -> FloatArray:
        """(3,) or (6,) by which a (6,) tip misses it, mm."""
        place = tip[:3] - self.place_mm
        if self.direction is None:
            return np.asarray(place)
        return np.concatenate([place, _MM_PER_RAD * (tip[3:] - self.direction)])

    def reached(self, tip: FloatArray) -> bool:
        """Whether a (6,) tip is there."""
        off = self.off(tip)
        turned = np.linalg.norm(off[3:]) / _MM_PER_RAD
        return bool(np.linalg.norm(off[:3]) <= TOLERANCE_MM and turned <= TOLERANCE_RAD)


@dataclass(frozen=True, eq=False)
class Found:
    """What was found for a goal."""

    places: list[FloatArray]
    """(m,) each; empty: there is none."""
    nearest_u: FloatArray
    """(m,) where the tip comes nearest."""
    nearest_mm: float
    """By which it misses the place there."""


def places_for(
    body: BodyInPlace, goal: TipGoal, beginnings: Iterable[FloatArray], most: int
) -> Found:
    """At most so many, from (m,) beginnings, of which the first are tried first."""
    places: list[FloatArray] = []
    nearest: tuple[float, FloatArray] | None = None
    for beginning in beginnings:
        u = _solved(body, goal, beginning)
        off_mm = float(np.linalg.norm(_off(body, goal, u)))
        if nearest is None or off_mm < nearest[0]:
            nearest = off_mm, u
        scaled = u * body.model.scale
        new = all(np.linalg.norm(scaled - one * body.model.scale) > _APART for one in places)
        if new and goal.reached(body.tip(u)) and body.allowed(u):
            places.append(u)
            if len(places) == most:
                break
    assert nearest is not None
    miss = float(np.linalg.norm(goal.off(body.tip(nearest[1]))[:3]))
    return Found(places, nearest[1], miss)


def _solved(body: BodyInPlace, goal: TipGoal, beginning: FloatArray) -> FloatArray:
    """(m,) where the tip misses the goal least, near a beginning and within travel."""
    scale, ranges = body.model.scale, body.ranges
    u, damping = beginning.copy(), _DAMPING
    off = _off(body, goal, u)
    for _ in range(_ITERATIONS):
        if np.linalg.norm(off) < 0.1 * TOLERANCE_MM:
            break
        slopes = np.array(list(_slopes(body, goal, u))).T
        for _ in range(5):
            square = slopes.T @ slopes + damping * np.eye(scale.size)
            step = -np.linalg.solve(square, slopes.T @ off)
            length = float(np.linalg.norm(step))
            step *= min(1.0, _LONGEST / max(length, 1e-12))
            there = np.clip(u + step / scale, ranges.lowest, ranges.highest)
            missed = _off(body, goal, there)
            if missed @ missed < off @ off:
                u, off, damping = there, missed, max(0.3 * damping, _LEAST_DAMPING)
                break
            damping *= 4.0
        else:
            break
    return u


def _off(body: BodyInPlace, goal: TipGoal, u: FloatArray) -> FloatArray:
    """What is to be made small: the miss, and how much too strange (m,) u is to the model, mm."""
    strange = max(0.0, body.closeness(u) - 0.95 * CLOSE_SHARE)
    return np.append(goal.off(body.tip(u)), _MM_PER_REACH * strange)


def _slopes(body: BodyInPlace, goal: TipGoal, u: FloatArray) -> Iterator[FloatArray]:
    """Of the miss, by each of the network's inputs."""
    for axis, scale in enumerate(body.model.scale):
        ends = []
        for way in (_STEP, -_STEP):
            there = u.copy()
            there[axis] += way / scale
            ends.append(_off(body, goal, there))
        yield (ends[0] - ends[1]) / (2.0 * _STEP)
