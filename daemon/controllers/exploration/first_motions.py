"""What the first motions of an unknown body show of how late it is, and the motions themselves.

In babbling axes turn round all the time, and a body that is half a second late goes one way while
its axes already go the other: taken for prompt it tells a Jacobian that is quite another one. But
over a span the tip's motion is a linear function of that of the axes as they show, passed through
dead time and lag. For many of these at once it is fitted by least squares; those that leave least
unexplained are the body's. Then the motions can be looked at again.
"""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from daemon.control.controller import Observation
from daemon.control.lag.body_lag import DEAD_SHARES, LONGEST_S, parts
from daemon.control.lag.lagged_axes import LaggedAxes
from drivers.pose import Vector

_SPACING_S: Final = 0.05
_SPAN_S: Final = 0.8
"""Of the motions that are compared: of a late body only long ones are much more than noise."""
_RIDGE: Final = 1e-6
"""Of the axes' motion: what they hardly make tells nothing."""
_CLEARLY: Final = 0.7
"""Share of what is left unexplained by as late a body as was expected, that is left by another
before it is believed ..."""
_EXPLAINED: Final = 0.6
"""... and of all motion, that may be left at most: a load or a push moves the tip as well."""
_KEPT_AT_MOST: Final = 4000
"""Frames: the last forty seconds of a fast tracker's."""


class BodysLag(NamedTuple):
    """How late the tip comes after the axes as they are measured."""

    lag_s: float
    """The sum of dead time and lag."""
    dead_share: float
    """How much of it is dead time."""


class _Shown(NamedTuple):
    """By k candidates."""

    t_s: float
    due: Vector
    """(k, m) what came out of the dead time by then ..."""
    shown: Vector
    """(k, m) ... and what shows of it."""
    tip_mm: Vector
    """(3,)"""


class FirstMotions:
    """Takes what is seen while nothing is known yet; before the first motion all stood still.

    When they are over they are asked how late the body is. Where that is otherwise than expected
    they are given again, a little at a time, with the axes as such a body shows them.
    """

    def __init__(self, scale: Vector, expected_s: float) -> None:
        """scale: (m,) range of each axis. expected_s: as late the body is taken to be until its
        motions say otherwise."""
        axes = len(scale)
        self._scale = scale
        self.lag = self.expected = BodysLag(expected_s, DEAD_SHARES[0])
        """As the motions have told it, and as it was expected."""
        self.told = False
        """Whether nothing is to be asked or given again."""
        self.explained = 0.0
        """Share of the tip's motion, squared, that is the axes', as they were asked last: the rest
        is noise, or something else that moves it."""
        self._again: deque[Observation | None] | None = None
        self._shown = LaggedAxes(scale)
        lags_s = np.arange(0.0, LONGEST_S + 1e-9, _SPACING_S)
        candidates = [BodysLag(float(lag), share) for share in DEAD_SHARES for lag in lags_s]
        self._candidates = [self.expected, *candidates]
        self._dead_s, first_order_s = np.array([parts(*one) for one in self._candidates]).T
        self._first_order_s = np.maximum(first_order_s, 1e-9)
        self._longest_dead_s = float(self._dead_s.max())
        self._axes: deque[tuple[float, Vector]] = deque()
        """Of the longest dead time."""
        self._spans: deque[_Shown] = deque()
        """Of one span."""
        self._squares = np.zeros((len(self._candidates), axes, axes))
        self._products = np.zeros((len(self._candidates), axes, 3))
        self._whole_mm2 = 0.0
        self._frames: deque[Observation | None] = deque(maxlen=_KEPT_AT_MOST)
        """None: what comes next does not go on from what came before."""

    def break_off(self) -> None:
        """What comes next does not go on from here."""
        self._axes.clear()
        self._spans.clear()
        self._frames.append(None)

    def go_on(self) -> None:
        """More of them come."""
        self.told, self._again = False, None

    def see(self, observation: Observation) -> None:
        """Take a frame."""
        if not (np.isfinite(observation.u).all() and np.isfinite(observation.tip_mm).all()):
            return
        self._frames.append(observation)
        if observation.believed:
            t_s = 1e-9 * observation.t_ns
            self._add(t_s, observation.u / self._scale, observation.tip_mm)

    def ask(self) -> bool:
        """Whether all is to be given again."""
        before, self.lag = self.lag, self._found()
        self.told = before == self.lag == self.expected
        if not self.told:
            self._again = deque(self._frames)
            self._shown.break_off()
        return not self.told

    def share_explained(self) -> float:
        """Of the tip's motion until now, squared, the axes' share."""
        self._found()
        return self.explained

    @property
    def asked(self) -> bool:
        """Whether they were asked since the last of them."""
        return self.told or self._again is not None

    def next_again(self) -> Observation | None:
        """The next frame, `u` as it shows; None: what comes does not go on from what came."""
        assert self._again is not None
        observation = self._again.popleft() if self._again else None
        self.told = not self._again
        if observation is None:
            self._shown.break_off()
        elif observation.believed:
            shown = self._shown.after(1e-9 * observation.t_ns, observation.u, *self.lag)
            return observation._replace(u=shown)
        return observation

    def _found(self) -> BodysLag:
        """What explains best what was seen, if that is clear; else what was expected."""
        moved = np.trace(self._squares, axis1=1, axis2=2) / len(self._scale)
        ridge = (_RIDGE * moved + 1e-12)[:, None, None] * np.eye(len(self._scale))
        slopes = np.linalg.solve(self._squares + ridge, self._products)
        left = self._whole_mm2 - (slopes * self._products).sum(axis=(1, 2))
        best = int(np.argmin(left))
        self.explained = 1.0 - float(left[best] / max(self._whole_mm2, 1e-9))
        clear = left[best] < _CLEARLY * left[0] and left[best] < _EXPLAINED * self._whole_mm2
        return self._candidates[best] if clear else self.expected

    def _add(self, t_s: float, u: Vector, tip_mm: Vector) -> None:
        """At `t_s` the axes were at (m,), in shares of their ranges, and the tip was at (3,)."""
        spans = self._spans
        if spans and t_s <= spans[-1].t_s:
            return
        self._axes.append((t_s, u))
        while len(self._axes) > 1 and self._axes[1][0] <= t_s - self._longest_dead_s:
            self._axes.popleft()
        due = self._due(t_s)
        shown = due
        if spans:
            last = spans[-1]
            dt_s = t_s - last.t_s
            behind = (self._first_order_s / dt_s)[:, None] * (due - last.due)
            kept = np.exp(-dt_s / self._first_order_s)[:, None]
            shown = due - behind + kept * (last.shown - last.due + behind)
        spans.append(_Shown(t_s, due, shown, tip_mm))
        while len(spans) > 1 and spans[1].t_s <= t_s - _SPAN_S:
            spans.popleft()
        first = spans[0]
        if first.t_s <= t_s - _SPAN_S:
            made, came = shown - first.shown, tip_mm - first.tip_mm
            self._squares += made[:, :, None] * made[:, None, :]
            self._products += made[:, :, None] * came
            self._whole_mm2 += float(came @ came)

    def _due(self, t_s: float) -> Vector:
        """(k, m) where the axes were before each dead time, where they went evenly from one frame
        to the next; before the first frame they stood."""
        times = np.array([seen_s for seen_s, _ in self._axes])
        axes = np.array([u for _, u in self._axes])
        if len(times) == 1:
            return np.tile(axes[0], (len(self._dead_s), 1))
        at_s = np.maximum(t_s - self._dead_s, times[0])
        low = np.clip(np.searchsorted(times, at_s) - 1, 0, len(times) - 2)
        between = (at_s - times[low]) / (times[low + 1] - times[low])
        return np.asarray(axes[low] + between[:, None] * (axes[low + 1] - axes[low]))
