"""How much later than its axes the body moves: pneumatics, tubes and filters take their time.

A motion of the tip that is put down to what the axes do at the same time is put down to the wrong
thing wherever the axes turn. Here the tip's motions are explained by those of the axes some time
before, with a Jacobian that changes linearly over the travel, and the time that explains them best
is the lag.
"""

import numpy as np

from daemon.learning.samples.dataset import Frames, sound_frames
from drivers.pose import Vector

_LAGS_S = np.arange(0.0, 0.401, 0.025)
_SPAN_S = 0.1
"""Length of the motions that are explained."""
_GAP_S = 0.1
_ROWS_AT_MOST = 6000
_ROWS_PER_FEATURE = 5
_RIDGE = 1e-6


def body_lag_s(frames: Frames, travel: Vector) -> float:
    """Seconds, 0 or more; 0 where there are too few frames to tell.

    Frames that are not finite, out of order, or where the tip or an axis cannot have gone since the
    one before count as missing.
    """
    frames = sound_frames(frames, travel)
    t_s = (frames.t_ns - frames.t_ns[:1].sum()) * 1e-9
    ends_s = _ends(t_s)
    features = len(travel) * (1 + len(travel))
    if len(ends_s) < _ROWS_PER_FEATURE * features:
        return 0.0
    moved = _moved(t_s, frames.tip_mm, ends_s)
    left = [_unexplained(t_s, frames.u / travel, ends_s - lag_s, moved) for lag_s in _LAGS_S]
    return _lowest(np.array(left))


def _ends(t_s: Vector) -> Vector:
    """(k,) times at which a motion ends, with no gap anywhere near before."""
    if len(t_s) < 2:
        return np.zeros(0)
    before_s = _SPAN_S + float(_LAGS_S[-1])
    gaps = np.flatnonzero(np.diff(t_s) > _GAP_S)
    begins_s = np.concatenate([t_s[:1], t_s[gaps + 1]])
    sound_since = begins_s[np.searchsorted(begins_s, t_s, side="right") - 1]
    ends = t_s[t_s - sound_since >= before_s]
    return np.asarray(ends[:: 1 + len(ends) // _ROWS_AT_MOST])


def _moved(t_s: Vector, values: Vector, ends_s: Vector) -> Vector:
    """(k, columns) what `values` changed by in the motions that end then."""
    columns = [
        np.interp(ends_s, t_s, column) - np.interp(ends_s - _SPAN_S, t_s, column)
        for column in values.T
    ]
    return np.stack(columns, axis=1)


def _unexplained(t_s: Vector, shares: Vector, ends_s: Vector, moved: Vector) -> float:
    """Mean square of the tip's motion that the axes' motions do not explain, mm²."""
    steps = _moved(t_s, shares, ends_s)
    at = np.stack([np.interp(ends_s, t_s, column) for column in shares.T], axis=1)
    at -= at.mean(axis=0)
    products = (steps[:, :, None] * at[:, None, :]).reshape(len(steps), -1)
    features = np.hstack([steps, products])
    gram = features.T @ features
    gram += _RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram))
    solution = np.linalg.solve(gram, features.T @ moved)
    return float(((moved - features @ solution) ** 2).mean())


def _lowest(left: Vector) -> float:
    """Where the parabola through the lowest value and its neighbours has its lowest point."""
    best = int(np.argmin(left))
    if best in (0, len(left) - 1):
        return float(_LAGS_S[best])
    before, here, after = left[best - 1 : best + 2].tolist()
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(_LAGS_S[best] + shift * (_LAGS_S[1] - _LAGS_S[0]))
