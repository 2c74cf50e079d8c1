"""The tip along a whole recording, each place told by what was measured before it and after it.

The filter in the loop knows the past alone: where the tip speeds up or turns, its velocity comes
late, and its place has the noise of few measurements. Afterwards neither need be so. The same model
of the tip's motion, constant velocity with white acceleration, is run forward as a Kalman filter
and then backward (Rauch, Tung and Striebel 1965, "Maximum likelihood estimates of linear dynamic
systems"). By filterpy, which takes a second to come: for what is done with recordings, and nothing
that a running robot waits for.
"""

from typing import NamedTuple

import numpy as np
from filterpy.common import Q_discrete_white_noise, kinematic_state_transition
from filterpy.kalman import KalmanFilter, rts_smoother
from numpy.typing import NDArray

from config.control import PoseFilterSettings
from drivers.pose import Vector

_NS_PER_S = 1e9


class RecordedPath(NamedTuple):
    """n places of the tip."""

    tip_mm: Vector
    """(n, 3)"""
    velocity_mm_s: Vector
    """(n, 3)"""
    std_mm: Vector
    """(n,) standard deviation of one coordinate."""


def recorded_path(
    t_ns: NDArray[np.int64], measured_mm: Vector, settings: PoseFilterSettings
) -> RecordedPath:
    """What was measured, (n, 3) at (n,) times in order, smoothed.

    measured_mm: only what was believed. Across a gap that the filter in the loop does not bridge
    either (`predict_for_s`) nothing is concluded. Raises ValueError for times that do not grow.
    """
    if len(t_ns) != len(measured_mm) or (np.diff(t_ns) <= 0).any():
        raise ValueError("the frames of a recording are not in order")
    after_gap = np.flatnonzero(np.diff(t_ns) > settings.predict_for_s * _NS_PER_S) + 1
    parts = [
        _stretch(t_s, stretch_mm, settings)
        for t_s, stretch_mm in zip(
            np.split((t_ns - t_ns[:1].sum()) / _NS_PER_S, after_gap),
            np.split(measured_mm, after_gap),
            strict=True,
        )
    ]
    return RecordedPath(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _stretch(t_s: Vector, measured_mm: Vector, settings: PoseFilterSettings) -> RecordedPath:
    """Without a gap. The state is (x, vx, y, vy, z, vz)."""
    if not len(t_s):
        return RecordedPath(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    steps_s = np.diff(t_s, prepend=t_s[0])
    models = {float(dt_s): motion_model(float(dt_s), settings) for dt_s in np.unique(steps_s)}
    moves, noises = zip(*(models[float(dt_s)] for dt_s in steps_s), strict=True)
    kalman = first_state(measured_mm[0], settings)
    means, covariances = np.empty((len(t_s), 6)), np.empty((len(t_s), 6, 6))
    means[0], covariances[0] = kalman.x, kalman.P
    for k in range(1, len(t_s)):
        kalman.predict(F=moves[k], Q=noises[k])
        kalman.update(measured_mm[k])
        means[k], covariances[k] = kalman.x, kalman.P
    means, covariances, _, _ = rts_smoother(means, covariances, moves, noises)
    return RecordedPath(means[:, ::2], means[:, 1::2], np.sqrt(covariances[:, 0, 0]))


def motion_model(dt_s: float, settings: PoseFilterSettings) -> tuple[Vector, Vector]:
    """(6, 6) how the state goes on in a step, and (6, 6) what the acceleration adds to it."""
    move = np.kron(np.eye(3), kinematic_state_transition(1, dt_s))
    variance = settings.acceleration_mm_s2**2
    return move, np.asarray(Q_discrete_white_noise(2, dt_s, variance, block_size=3))


def first_state(measured_mm: Vector, settings: PoseFilterSettings) -> KalmanFilter:
    """The filter when it begins: at a measured place, with a velocity that is not known."""
    kalman = KalmanFilter(dim_x=6, dim_z=3)
    kalman.H = np.kron(np.eye(3), [[1.0, 0.0]])
    kalman.R *= settings.position_noise_mm**2
    speed_mm_s = settings.acceleration_mm_s2 * settings.predict_for_s
    kalman.P = np.diag([settings.position_noise_mm**2, speed_mm_s**2] * 3)
    kalman.x = np.ravel(np.column_stack([measured_mm, np.zeros(3)]))
    return kalman
