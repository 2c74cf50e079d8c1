"""Frames of an arm of two arcs that goes along random lines: quick to make, and its truth is known.

The robot is the shipped soft arm, so that files of this arm fit a real robot file.
"""

import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from config.loader import load_robot
from config.robot import Robot
from config.tasks.controllers import ConstantCurvature
from daemon.controllers.constant_curvature import ArcKinematics
from daemon.learning.samples.dataset import Dataset, Frames
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

ROBOT: Robot = load_robot(Path(__file__).parents[3] / "config" / "robots" / "soft_arm.yaml").robot
RANGES = AxisRanges.of(ROBOT)
FRAME_S = 0.025
_BORE_MM2 = np.full(6, np.pi / 4.0 * 25.0**2)
_SPEED_MM_S = 9.0
_DITHER_MM = 1.5
_SHARE = 0.5

ARM = ArcKinematics(ConstantCurvature(kind="constant_curvature"), RANGES, _BORE_MM2)


@cache
def arm_frames(lines: int, seed: int = 1, noise_mm: float = 0.05, lag_s: float = 0.0) -> Frames:
    """In the middle half of the travel. lag_s: how much later than its axes the arm moves."""
    random = np.random.default_rng(seed)
    ends = 25.0 + 25.0 * _SHARE * random.uniform(-1.0, 1.0, (lines + 1, 6))
    u, line = _along(ends)
    t_s = FRAME_S * np.arange(len(u))
    u = u + _DITHER_MM * np.sin(2.0 * np.pi * t_s[:, None] / (2.0 + 0.3 * np.arange(6)))
    late = np.stack([np.interp(t_s - lag_s, t_s, axis) for axis in u.T], axis=1)
    tips = np.array([ARM.tip(at)[0] for at in late])
    tips += noise_mm * random.normal(size=tips.shape)
    return Frames(np.round(1e9 * t_s).astype(np.int64), tips, u, line)


def arm_dataset(
    lines: int, seed: int = 1, noise_mm: float = 0.05, lag_s: float = 0.0, robot: Robot = ROBOT
) -> Dataset:
    """The same, as a file has it."""
    return Dataset.of(arm_frames(lines, seed, noise_mm, lag_s), robot, {"seed": seed})


def another_robot() -> Robot:
    """With a longer first axis."""
    first = ROBOT.axes[0].model_copy(update={"travel_mm": (0.0, 60.0)})
    return ROBOT.model_copy(update={"axes": [first, *ROBOT.axes[1:]]})


def without(frames: Frames, first: int, last: int) -> Frames:
    """A piece is missing."""
    keep = np.ones(len(frames), dtype=bool)
    keep[first:last] = False
    parts = {name: getattr(frames, name)[keep] for name in ("t_ns", "tip_mm", "u", "line")}
    return replace(frames, **parts)


def _along(ends: Vector) -> tuple[Vector, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    places, numbers = [], []
    for number, (start, end) in enumerate(itertools.pairwise(ends)):
        count = max(2, int(np.abs(end - start).max() / (_SPEED_MM_S * FRAME_S)))
        share = np.arange(count)[:, None] / count
        places.append(start + share * (end - start))
        numbers.append(np.full(count, number))
    return np.concatenate(places), np.concatenate(numbers).astype(np.int64)
