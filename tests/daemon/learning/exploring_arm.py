"""An arm of two arcs that explores: motions and receptive fields to test learning on."""

from functools import cache

import numpy as np

from daemon.controllers.constant_curvature import arc
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings, typical_steps
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

AXES = 6
TRAVEL_MM = 20.0
SCALE = np.r_[100.0, 100.0, 100.0, np.full(AXES, TRAVEL_MM)]
"""What places count in: mm of the tip, and the axes' travel."""
_SEGMENT_MM = 70.0
_BENDING_RAD_MM = 0.08
_STRETCH = 0.4
_CHAMBER_RAD = np.radians([90.0, 210.0, 330.0])
_AROUND = np.stack([np.cos(_CHAMBER_RAD), np.sin(_CHAMBER_RAD)])
_STEP_MM = 1.0
_DITHER_MM = 0.15
_ACTIVATED = 0.1
"""A field is made where no other one is as active as this."""


def tip_mm(u: Vector) -> Vector:
    """(3,) of (6,) pistons in mm, 0 to 20."""
    ends, turns = [], []
    for chambers in (u[:3], u[3:]):
        bending = _BENDING_RAD_MM * (_AROUND @ chambers)
        length_mm = _SEGMENT_MM + _STRETCH * float(chambers.sum())
        end, turn = arc(np.array([bending[0], bending[1], length_mm]))
        ends.append(end)
        turns.append(turn)
    result: Vector = ends[0] + turns[0] @ ends[1]
    return result


@cache
def exploration(count: int, seed: int = 0) -> tuple[MotionSample, ...]:
    """Motions along straight lines between random waypoints, with dither."""
    random = np.random.default_rng(seed)
    u = random.uniform(0.0, TRAVEL_MM, AXES)
    goal = random.uniform(0.0, TRAVEL_MM, AXES)
    tip = tip_mm(u)
    samples: list[MotionSample] = []
    while len(samples) < count:
        way = goal - u
        if np.linalg.norm(way) < 2.0 * _STEP_MM:
            goal = random.uniform(0.0, TRAVEL_MM, AXES)
            continue
        delta = _STEP_MM * way / np.linalg.norm(way) + random.normal(0.0, _DITHER_MM, AXES)
        then = tip_mm(u + delta)
        samples.append(MotionSample(tip, u, delta, then - tip))
        u, tip = u + delta, then
    return tuple(samples)


def fields_over(
    samples: tuple[MotionSample, ...], sharpness: float, most: int | None = None
) -> ReceptiveFields:
    """Fields of metric `sharpness` · 1, over all samples, or only the first `most` of them."""
    places = np.array([np.r_[sample.tip_mm, sample.u] for sample in samples]) / SCALE
    farthest = -2.0 * np.log(_ACTIVATED) / sharpness
    nearest = np.full(len(places), np.inf)
    centres: list[Vector] = []
    for index, place in enumerate(places):
        if nearest[index] > farthest and len(centres) != most:
            centres.append(place)
            np.minimum(nearest, np.sum((places - place) ** 2, axis=1), out=nearest)
    metrics = np.tile(sharpness * np.eye(len(SCALE)), (len(centres), 1, 1))
    return ReceptiveFields(np.array(centres), metrics, SCALE)


def settings_for(samples: tuple[MotionSample, ...], **options: object) -> LocalControllerSettings:
    """The defaults, with the scales of `samples` and some options."""
    tip_step_mm, axis_steps = typical_steps(samples)
    return LocalControllerSettings(tip_step_mm, axis_steps, **options)  # type: ignore[arg-type]
