"""A body's hysteresis, followed step by step: what of the axes' motion shows at the tip.

Pre-training tells the share h that the body which it explored holds back where axes turn
(`stop_operators`); a worn one has twice as much friction. Of what its axes told, the tip makes

    Δp = g J Δu - g h J ΔS

with S what sticks, g a gain, and both passed through dead time and lag. Over short spans g and g h
are told apart by least squares: on a way without turns the stops slip and ΔS is nothing, after a
turn it is Δu. Small motions to and fro tell most of it, before the body has gone anywhere.

Play between axes and body is lost besides (`play`): what is told here is without it.
"""

from collections import deque
from math import exp
from typing import Final

import numpy as np

from daemon.control.lag.body_lag import BodyLag, Underway
from daemon.control.lag.play import Play
from daemon.learning.forward.stop_operators import HeldBack, StopOperators
from drivers.pose import Vector

_TURNS_S: Final = 0.1
"""Time constant after which an axis goes the other way: a tracker's noise turns it to and fro."""
_MOVES: Final = 1e-6
"""Of the travel, in a step: less is none."""


class Hysteresis:
    """Takes the axes' targets, and what the tip makes of them."""

    def __init__(self, held_back: HeldBack) -> None:
        """held_back: as pre-training told it; if it did not, only play is looked for."""
        travel, share = held_back.travel, held_back.share
        self.share = 0.0 if share is None else share
        self._travel = travel
        self._stops = StopOperators()
        self._play = Play(travel)
        self._jacobian = np.zeros((3, len(self._travel)))
        """(3, m) of the last step."""
        self._targets: Vector | None = None
        self._sticks = np.zeros(len(self._travel))
        """(m,) S, mm or rad."""
        self._stuck = np.zeros(len(self._travel))
        """... and by how much more it is since the last step."""
        self._forth = np.full(len(self._travel), 0.5)
        self._told_mm = np.zeros(3), np.zeros(3)
        """(3,) in the last step, and (3,) of it that stuck."""
        self._estimate = None if share is None else _Estimate(share)
        self._probed: list[tuple[float, float, tuple[Vector, Vector], Vector]] = []

    @property
    def shown(self) -> Vector:
        """(m,) share of the next motion of each axis that will show at the tip."""
        return np.asarray(1.0 - self.share * self._stops.sticking(self._forth))

    def free(self, u: Vector) -> Vector:
        """(m,) where the axes of a body that holds nothing back would be with its tip as with these
        at (m,)."""
        return np.asarray(u - self.share * self._sticks - self._play.within)

    def with_what_is_lost(self, step: Vector) -> Vector:
        """(m,) a step of the axes, and what of it play would take."""
        return self._play.with_what_is_lost(step)

    def follow(self, targets: Vector, dt_s: float) -> None:
        """The axes were told to go to (m,)."""
        moved = np.zeros(len(targets)) if self._targets is None else targets - self._targets
        self._targets = targets
        told = np.abs(moved) > _MOVES * self._travel
        share = 1.0 - exp(-dt_s / _TURNS_S)
        self._forth = self._forth + share * told * ((moved > 0.0) - self._forth)
        sticks = self._stops.follow(targets / self._travel) * self._travel
        self._stuck, self._sticks = sticks - self._sticks, sticks
        self._play.follow(moved)

    def moved_mm(self, told_mm: Vector, jacobian: Vector) -> Vector:
        """(3,) that the tip makes of the last step, which by (3, m) the Jacobian were (3,)."""
        told_mm = told_mm - self._play.lost_mm(jacobian)
        self._told_mm, self._jacobian = (told_mm, jacobian @ self._stuck), jacobian
        return np.asarray(told_mm - self.share * self._told_mm[1])

    def break_off(self) -> None:
        """What comes next does not go on from here. What was found stays."""
        if self._estimate is not None:
            self._estimate.break_off()
        self._play.forget_probe()
        self._probed = []

    def learn(self, t_s: float, dt_s: float, tip_mm: Vector, lag: BodyLag) -> None:
        """The tip is at (3,) after the last step."""
        if self._estimate is not None:
            self._estimate.add(t_s, dt_s, self._told_mm, tip_mm, lag)
            self.share = self._estimate.share

    def see_probe(self, t_s: float, dt_s: float, tip_mm: Vector) -> None:
        """The same, of motions by which the lag is looked for."""
        self._probed.append((t_s, dt_s, self._told_mm, tip_mm))
        free_mm = self._told_mm[0] - self.share * self._told_mm[1]
        self._play.see_probe(t_s, dt_s, free_mm, self._jacobian, tip_mm)

    def end_probe(self, lag: BodyLag) -> None:
        """The lag is known now."""
        self._play.end_probe(lag)
        if self._estimate is not None:
            for t_s, dt_s, told_mm, tip_mm in self._probed:
                self._estimate.add(t_s, dt_s, told_mm, tip_mm, lag)
            self.share = self._estimate.share
        self.break_off()


_SPAN_S: Final = 0.4
_USUAL_STEP_S: Final = 0.025
_MOVED_MM: Final = 0.3
"""As for the lag (`body_lag`): spans with less tell nothing but noise, and one is longer than that
and shorter than a turn."""
_MEMORY_S: Final = 60.0
"""Of motion: friction is the body's, not the place's. With 12 s a slow body's star settles a tenth
worse."""
_GAIN_MM2: Final = 50.0
"""As much motion with a gain of 1 is taken for seen before anything is, as for the gains."""
_SHARE_MM2: Final = 200.0
"""... and so much that sticks, by the share of pre-training: half a second of a path that turns.
Small motions make eight times that, of a body with a second's lag three times. With 1000 the shares
of a worn and a slow arm come to be 0.2 and 0.27 and not 0.25 and 0.3, with 50 hardly more."""
_MOST: Final = 0.5
"""A body has no more; what seems more is something else."""


class _Estimate:
    def __init__(self, share: float) -> None:
        self.share = share
        self._before = share
        self._free, self._stuck = Underway(), Underway()
        self._span: deque[tuple[float, Vector, Vector, Vector]] = deque()
        """Time, what has arrived of what was told and of what stuck, and the tip."""
        self._sums = np.zeros(5)
        """aa, ab, bb, ac and bc in mm², a being what was told, b what stuck, c what came."""

    def break_off(self) -> None:
        self._span.clear()
        self._free.begin()
        self._stuck.begin()

    def add(
        self, t_s: float, dt_s: float, told_mm: tuple[Vector, Vector], tip_mm: Vector, lag: BodyLag
    ) -> None:
        arrived = []
        for underway, moved_mm in zip((self._free, self._stuck), told_mm, strict=True):
            underway.tell(t_s, dt_s, moved_mm, lag.lag_s, lag.dead_share)
            arrived.append(underway.told_mm - underway.left_mm)
        span = self._span
        span.append((t_s, arrived[0], arrived[1], tip_mm))
        if t_s - span[0][0] < _SPAN_S:
            return
        while t_s - span[1][0] >= _SPAN_S:
            span.popleft()
        (_, *began), (_, *ended) = span[0], span[-1]
        told, stuck, came = (end - begin for begin, end in zip(began, ended, strict=True))
        if max(told @ told, came @ came) < _MOVED_MM**2:
            return
        products = np.array([told @ told, told @ stuck, stuck @ stuck, told @ came, stuck @ came])
        self._sums = exp(-dt_s / _MEMORY_S) * self._sums + dt_s / _USUAL_STEP_S * products
        self.share = self._found()

    def _found(self) -> float:
        aa, ab, bb, ac, bc = self._sums.tolist()
        aa, ac = aa + _GAIN_MM2, ac + _GAIN_MM2
        bb, bc = bb + _SHARE_MM2, bc - _SHARE_MM2 * self._before
        determinant = aa * bb - ab * ab  # positive: more than Cauchy and Schwarz ask for
        gain, held = (bb * ac - ab * bc) / determinant, (ab * ac - aa * bc) / determinant
        return min(max(held / gain, 0.0), _MOST) if gain > 0.0 else self._before
