"""Kalman filters of three values and their rates: constant velocity, white acceleration.

The three are alike and know nothing of each other, so one variance speaks for all of them.
"""

import numpy as np
from filterpy.kalman import KalmanFilter

from drivers.pose import Vector

_EYE3 = np.eye(3)
_VALUE = np.arange(3)
_RATE = np.arange(3, 6)


def constant_velocity(noise_variance: float) -> KalmanFilter:
    """A filter of three values and their rates, of which the values are measured."""
    made = KalmanFilter(dim_x=6, dim_z=3)
    made.H = np.hstack([_EYE3, np.zeros((3, 3))])
    made.R = noise_variance * _EYE3
    made.inv = _inverse_of_multiple_of_identity
    return made


def begin(made: KalmanFilter, variance: float, rate_variance: float) -> None:
    """Forget the past: values and rates zero, as uncertain as this."""
    made.x = np.zeros((6, 1))
    made.P = np.diag([variance] * 3 + [rate_variance] * 3)


def advance(made: KalmanFilter, dt_s: float, acceleration_variance: float) -> None:
    """Set transition and process noise for a prediction over `dt_s`.

    The acceleration is white and constant over a step: Q = σ² g gᵀ with g = (dt²/2, dt).
    """
    made.F[_VALUE, _RATE] = dt_s
    made.Q[_VALUE, _VALUE] = 0.25 * dt_s**4 * acceleration_variance
    made.Q[_VALUE, _RATE] = made.Q[_RATE, _VALUE] = 0.5 * dt_s**3 * acceleration_variance
    made.Q[_RATE, _RATE] = dt_s**2 * acceleration_variance


def value_variance(made: KalmanFilter, ahead_s: float, acceleration_variance: float) -> float:
    """Variance of one value, extrapolated."""
    p = made.P
    known = p[0, 0] + 2.0 * ahead_s * p[0, 3] + ahead_s**2 * p[3, 3]
    return float(known + 0.25 * ahead_s**4 * acceleration_variance)


def _inverse_of_multiple_of_identity(matrix: Vector) -> Vector:
    """For filterpy, which would ask LAPACK: the matrix is a variance times one."""
    return np.asarray(_EYE3 / matrix[0, 0])
