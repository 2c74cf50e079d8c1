"""Scripted actuation, so that a tracker has something to see before any daemon is there."""

from collections.abc import Callable, Sequence

import numpy as np

from config.axis import Axis
from sim_backends.plants.plant import FloatArray

Play = Callable[[float], FloatArray]
"""(m,) positions in mm or rad at a time in s."""

_SWAY_PERIOD_S = 8.0
_SWAY_SHARE = 0.4
_REST_S = 1.0  # until the drives have booted: incremental encoders count from there
_GENTLE_START_S = 2.0


def sway(axes: Sequence[Axis]) -> Play:
    """Neighbouring axes go up and down one after the other by a third of a turn, gently begun.

    Chambers or tendons at 120° then make the body circle.
    """
    low, high = np.array([axis.travel for axis in axes]).T
    phases = 2 * np.pi / 3 * np.arange(len(axes))

    def positions(t_s: float) -> FloatArray:
        swing = 0.5 * (1 - np.cos(2 * np.pi * t_s / _SWAY_PERIOD_S - phases))
        gently = np.clip((t_s - _REST_S) / _GENTLE_START_S, 0.0, 1.0)
        rest = np.clip(0.0, low, high)
        return np.asarray(rest + gently * _SWAY_SHARE * (high - rest) * swing)

    return positions


PLAYS: dict[str, Callable[[Sequence[Axis]], Play]] = {"sway": sway}
