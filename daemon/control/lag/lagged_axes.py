"""The axes as the tip shows them: the tip of a body that answers late is paired with them.

How late the body answers is known from when its axes were told to move to when its tip was seen
to. They are measured later than they are told, and go on their way meanwhile: by a frame of the
tracker, and by what their drives take. On a slow tracker's line that is a tenth of a second, and
most of a prompt body's lag. So it is measured as well,

    Σ Δu* · (u* - u) Δt / Σ |Δu*|²

with u* the targets and u where the axes were measured, and only the rest comes after that.
"""

from collections import deque
from math import exp
from typing import Final

import numpy as np

from daemon.control.lag.body_lag import parts
from drivers.pose import Vector

_USUAL_TRAVEL: Final = 0.02
"""Motion, in shares of the axes' range, in which they count as measured at once before any is seen:
as much as they go in the first second on a path, which then tells."""


class LaggedAxes:
    """Takes m axes frame by frame; gives them passed through the body's dead time and lag.

    From one frame to the next they go evenly. On a slow tracker's line frames are as far apart as
    the dead time is long: axes that leapt from frame to frame would show none of a motion in one of
    them, and twice as much in the next.
    """

    def __init__(self, scale: Vector) -> None:
        """scale: (m,) range of each axis."""
        self.late_s = 0.0
        """How much later than told they are measured."""
        self._scale = scale
        self._told = _USUAL_TRAVEL**2
        self._behind_s = 0.0
        """Sums of |Δu*|², and of Δu* (u* - u) Δt."""
        self._targets: tuple[float, Vector] | None = None
        """When they were seen last, and (m,) what they had been told by then."""
        self._kept: deque[tuple[float, Vector]] = deque()
        self._shown: tuple[float, Vector, Vector] | None = None
        """When, (m,) what came out of the dead time then, and (m,) what shows of it."""

    def break_off(self) -> None:
        """What comes next does not go on from here."""
        self._targets = self._shown = None
        self._kept.clear()

    def see(self, t_s: float, u: Vector, targets: Vector) -> None:
        """At `t_s` they were measured at (m,), and had been told to go to (m,)."""
        targets, last = targets / self._scale, self._targets
        self._targets = t_s, targets
        if last is None:
            return
        told = targets - last[1]
        travelled2 = float(told @ told)
        behind_s = float(told @ (targets - u / self._scale)) * (t_s - last[0])
        if not travelled2 + abs(behind_s) < 1.0:  # nor where a number is missing
            return
        kept = 1.0 - travelled2  # all that was seen counts as one whole range, at most
        self._told = kept * self._told + travelled2
        self._behind_s = kept * self._behind_s + behind_s
        self.late_s = max(self._behind_s / self._told, 0.0)

    def after(self, t_s: float, u: Vector, lag_s: float, dead_share: float) -> Vector:
        """(m,) what shows of axes that were measured at `u` at `t_s`.

        lag_s: from when they are told to go until the tip goes. dead_share: how much of it is dead
        time.
        """
        dead_s, first_order_s = parts(max(lag_s - self.late_s, 0.0), dead_share)
        self._kept.append((t_s, u))
        due = self._at(t_s - dead_s)
        shown = due
        if self._shown is not None and t_s > self._shown[0] and first_order_s > 0.0:
            then_s, due_then, shown_then = self._shown
            # What a first-order lag leaves of even motion: it is behind by its time.
            behind = first_order_s / (t_s - then_s) * (due - due_then)
            kept = exp(-(t_s - then_s) / first_order_s)
            shown = due - behind + kept * (shown_then - due_then + behind)
        self._shown = t_s, due, np.asarray(shown)
        return self._shown[2]

    def _at(self, t_s: float) -> Vector:
        """(m,) where they were then; where they were seen first, if that was later."""
        kept = self._kept
        while len(kept) > 1 and kept[1][0] <= t_s:
            kept.popleft()
        if len(kept) == 1 or t_s <= kept[0][0]:
            return kept[0][1]
        (before_s, before), (after_s, after) = kept[0], kept[1]
        return np.asarray(before + (t_s - before_s) / (after_s - before_s) * (after - before))
