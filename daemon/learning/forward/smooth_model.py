"""A quadratic of the axes for where the tip is: what seconds of motion tell of a body.

Local models need hundreds of samples each, because each knows nothing of its neighbours. A body of
few bending segments answers smoothly over the middle of its travel, and a quadratic in all axes
makes a Jacobian that changes linearly from place to place: 27 coefficients for six axes and a
coordinate, which half a minute tells better than local models know it after five. Motions that the
quadratic makes up are then learnt by the local models, which go on from there.

A tip follows its axes late: by a dead time and a first-order lag. Axes are passed through both
before they are put beside the tip; a delay alone would do for a lag of a tenth of a second, and
leave five times as much unexplained for one of eight tenths.
"""

import numpy as np
from numpy.typing import NDArray

from daemon.learning.samples.dataset import Frames, sound_frames
from daemon.learning.samples.motion import DEAD_SHARE, Mask, MotionTable
from daemon.learning.samples.motion_samples import longest_step_s
from drivers.pose import Vector

LineNumbers = NDArray[np.int64]
Rows = NDArray[np.intp]

_GAP_S = 0.1
_SPAN_S = 0.5
"""Of the motions that are explained: longer than noise, shorter than creep."""
_RIDGE = 2e-3
"""Of the mean square of a motion of an axis."""
_LAGS_S = np.arange(0.0, 1.601, 0.1)
_FINE_S = np.arange(-0.08, 0.081, 0.02)


def axes_shown(t_s: Vector, u: Vector, lag_s: float) -> Vector:
    """(n, m) of (n, m) axes, what shows of them at the tip that late. They stood before they began
    to move, and in gaps."""
    dead_s = DEAD_SHARE * lag_s
    due = np.stack([np.interp(t_s - dead_s, t_s, column) for column in u.T], axis=1)
    first_order_s = lag_s - dead_s
    if first_order_s <= 0.0:
        return due
    dt_s = np.diff(t_s, prepend=t_s[:1])
    shares = -np.expm1(-dt_s / first_order_s)
    shares[dt_s > longest_step_s(t_s, _GAP_S)] = 1.0
    shown = due.copy()
    for k in range(1, len(shown)):
        shown[k] = shown[k - 1] + shares[k] * (due[k] - shown[k - 1])
    return shown


class SmoothModel:
    """Tip and axes of a body: p = p₀ + A x + x B x in each coordinate."""

    def __init__(self, frames: Frames, shown: Vector, travel: Vector, known: Mask) -> None:
        """shown: (n, m) axes as the frames' tips show them. travel: (m,) of the axes. known: (n,)
        of which frames it may learn."""
        self._middle = shown.mean(axis=0)
        self._half = 0.5 * travel
        self._upper = np.triu_indices(len(travel))
        x, features = self._features(shown)
        begins, ends = _spans((frames.t_ns - frames.t_ns[0]) * 1e-9, known)
        moved = features[ends] - features[begins]
        seen = frames.tip_mm[ends] - frames.tip_mm[begins]
        gram = moved.T @ moved
        axes = x.shape[1]
        ridge = _RIDGE * float(np.trace(gram[:axes, :axes])) / axes
        gram += max(ridge, 1e-12) * np.eye(len(gram))
        self._coefficients = np.linalg.solve(gram, moved.T @ seen)
        self._begin_mm = (frames.tip_mm - features @ self._coefficients)[known].mean(axis=0)
        self.motions = len(begins)
        """That it was found by."""
        self.left_mm2 = float(((seen - moved @ self._coefficients) ** 2).mean())
        """Mean square of what it leaves of them unexplained, by coordinate."""

    @property
    def coefficients(self) -> int:
        """Of each coordinate."""
        return len(self._coefficients)

    def tip_mm(self, u: Vector) -> Vector:
        """(n, 3) for (n, m) axes, at rest."""
        return np.asarray(self._begin_mm + self._features(u)[1] @ self._coefficients)

    def _features(self, u: Vector) -> tuple[Vector, Vector]:
        """(n, m) axes in halves of their travel, and (n, k) those with all of their products."""
        x = np.asarray((u - self._middle) / self._half)
        first, second = self._upper
        return x, np.hstack([x, x[:, first] * x[:, second]])


def smooth_model(frames: Frames, lines: LineNumbers, travel: Vector, lag_s: float) -> SmoothModel:
    """Of a body that is so late, from some of the lines."""
    frames = sound_frames(frames, travel)
    return SmoothModel(frames, _shown(frames, lag_s), travel, np.isin(frames.line, lines))


def shown_lag_s(frames: Frames, travel: Vector) -> float:
    """The lag, as a sum of dead time and first-order lag, that leaves least unexplained."""
    frames = sound_frames(frames, travel)
    everything = np.ones(len(frames), np.bool_)

    def left(lag_s: float) -> float:
        return SmoothModel(frames, _shown(frames, lag_s), travel, everything).left_mm2

    roughly = float(min(_LAGS_S, key=left))
    return float(min(np.maximum(roughly + _FINE_S, 0.0), key=left))


def imagined(model: SmoothModel, seen: MotionTable, count: int, seed: int) -> MotionTable:
    """Motions as the model makes them: anywhere as far as any axis was seen, and not only where
    all of them were together. An inverse goes to such places at once, and a quadratic is a better
    guess there than what is known elsewhere."""
    random = np.random.default_rng(seed)
    middle = random.uniform(seen.u.min(axis=0), seen.u.max(axis=0), (count, seen.axes))
    one, other = random.integers(0, len(seen), (2, count))
    shares = random.normal(0.0, np.sqrt(0.5), (2, count, 1))
    delta_u = shares[0] * seen.delta_u[one] + shares[1] * seen.delta_u[other]
    begin, end = (model.tip_mm(middle + side * delta_u) for side in (-0.5, 0.5))
    return MotionTable(
        begin, middle - 0.5 * delta_u, delta_u, end - begin, np.zeros(count, np.int64)
    )


def _shown(frames: Frames, lag_s: float) -> Vector:
    return axes_shown((frames.t_ns - frames.t_ns[0]) * 1e-9, frames.u, lag_s)


def _spans(t_s: Vector, known: Mask) -> tuple[Rows, Rows]:
    """(k,) rows of frames that motions begin and end at, with no gap between them."""
    ends = np.arange(len(t_s))
    begins = np.searchsorted(t_s, t_s - _SPAN_S, side="left")
    gaps = np.cumsum(np.diff(t_s, prepend=t_s[:1]) > longest_step_s(t_s, _GAP_S))
    others = np.cumsum(~known)
    whole = (gaps[begins] == gaps) & (others[begins] == others) & known[begins]
    kept = whole & (t_s - t_s[0] >= _SPAN_S)
    return begins[kept], ends[kept]
