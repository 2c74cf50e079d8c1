"""A body's hysteresis, followed step by step: what of the axes' motion shows at the tip.

Pre-training tells the share h that the body which it explored holds back where its axes turn
(`stop_operators`); a worn one has twice as much friction. So several shares are followed at once.
With each the body's free axes v go another way, and the tip should go

    Δp = g J Δv

passed through dead time and lag, g a gain along each axis of space. The share with whose motions,
over short spans, the tip's agree best is the body's. A way without turns tells little of it, small
motions to and fro tell more, as far as the Jacobian is right, and a path that turns tells all.

Play between axes and body is lost besides (`play`): what is told here is without it.
"""

from collections import deque
from collections.abc import Sequence
from math import exp
from typing import Final

import numpy as np

from daemon.control.lag import lag_kernels as kernels
from daemon.control.lag.body_lag import BodyLag, Underway
from daemon.control.lag.play import Play, SmallMotion
from daemon.learning.forward.stop_operators import HeldBack, StopOperators, stretched
from drivers.pose import Vector

_SHARES: Final = np.arange(0.0, 1.3, 0.2)
"""(k,) that are followed. A body has no more; what seems more is something else."""
_TURNS_S: Final = 0.1
"""Time constant after which an axis goes the other way: a tracker's noise turns it to and fro."""
_MOVES: Final = 1e-6
"""Of the travel, in a step: less is none."""


class Hysteresis:
    """Takes the axes' targets, and what the tip makes of them."""

    def __init__(self, held_back: HeldBack) -> None:
        """held_back: as pre-training told it; if it did not, only play is looked for."""
        self._lowest, self._travel = held_back.lowest, held_back.travel
        self._ratios = np.divide.outer(self._travel, self._travel)
        self._estimate = None if held_back.share is None else _Estimate(held_back.share)
        self._stops = StopOperators(_SHARES)
        self._play = Play(self._travel)
        axes = len(self._travel)
        self._jacobian = np.zeros((3, axes))
        """(3, m) of the last step."""
        self._targets: Vector | None = None
        self._free: Vector | None = None
        """(k, m) by each share, mm or rad ..."""
        self._moved = np.zeros((len(_SHARES), axes))
        """... and how far they went in the last step."""
        self._forth = np.full(axes, 0.5)
        self._probed: list[tuple[SmallMotion, Vector]] = []
        """... and (k, 3) mm that were told by each share."""

    @property
    def share(self) -> float:
        """h; 0 where nobody knows."""
        return 0.0 if self._estimate is None else self._estimate.share

    @property
    def needed(self) -> Vector:
        """(m, m) how far the axes have to go for the body's free ones to go on."""
        if self._estimate is None:
            return np.eye(len(self._travel))
        low, between = _place(self.share)
        matrices = [self._stops.needed(self._forth, number) for number in (low, low + 1)]
        needed = matrices[0] + between * (matrices[1] - matrices[0])
        return np.asarray(needed * self._ratios)

    def free(self, u: Vector) -> Vector:
        """(m,) where the axes of a body that holds nothing back would be with its tip as with these
        at (m,)."""
        if self._estimate is None or self._targets is None:
            return np.asarray(u - self._play.within)
        held = self._targets - self._by_share(self._free)
        return np.asarray(u - held - self._play.within)

    def with_what_is_lost(self, step: Vector) -> Vector:
        """(m,) a step of the axes, and what of it play would take."""
        return self._play.with_what_is_lost(step)

    def follow(self, targets: Vector, dt_s: float) -> None:
        """The axes were told to go to (m,)."""
        moved = np.zeros(len(targets)) if self._targets is None else targets - self._targets
        self._targets = targets
        self._play.follow(moved)
        if self._estimate is None:
            self._moved[:] = moved
            return
        stretch = stretched(moved / self._travel)
        self._forth = kernels.turned(self._forth, stretch, 1.0 - exp(-dt_s / _TURNS_S), _MOVES)
        free = self._stops.follow((targets - self._lowest) / self._travel) * self._travel
        free = free + self._lowest
        self._moved = np.zeros_like(free) if self._free is None else free - self._free
        self._free = free

    def moved_mm(self, jacobian: Vector) -> Vector:
        """(3,) that the tip makes of the last step by (3, m) the Jacobian."""
        self._jacobian = jacobian
        return np.asarray(jacobian @ self._by_share(self._moved) - self._play.lost_mm(jacobian))

    def break_off(self) -> None:
        """What comes next does not go on from here. What was found stays."""
        if self._estimate is not None:
            self._estimate.break_off()
        self._probed = []

    def learn(
        self, t_s: float, dt_s: float, tip_mm: Vector, lag: BodyLag, on_path: bool = False
    ) -> None:
        """The tip is at (3,) after the last step. on_path: of a path that will be repeated."""
        if self._estimate is None:
            return
        weight = 1.0 if on_path else _ON_THE_WAY
        self._estimate.add(t_s, dt_s, self._by_shares_mm(), tip_mm, lag, weight)

    def see_probe(self, t_s: float, dt_s: float, tip_mm: Vector) -> None:
        """The same, of motions by which the lag is looked for."""
        jacobian = self._jacobian
        within_mm = self._play.within_mm(jacobian)
        motion = SmallMotion(t_s, dt_s, self.moved_mm(jacobian), within_mm, tip_mm)
        self._probed.append((motion, self._by_shares_mm()))

    def end_probe(self, lag: BodyLag) -> None:
        """The lag is known now."""
        self._play.learn([motion for motion, _ in self._probed], lag)
        if self._estimate is not None:
            self._estimate.add_small(self._probed, lag)
        self.break_off()

    def _by_shares_mm(self) -> Vector:
        """(k, 3) that the tip makes of the last step by each share."""
        return np.asarray(self._moved @ self._jacobian.T - self._play.lost_mm(self._jacobian))

    def _by_share(self, values: Vector | None) -> Vector:
        """(m,) of (k, m) values of all shares: those of the one that was found."""
        assert values is not None
        low, between = _place(self.share)
        return np.asarray(values[low] + between * (values[low + 1] - values[low]))


def _place(share: float) -> tuple[int, float]:
    """The last of `_SHARES` before it, and how far it is to the next one."""
    place = share / (_SHARES[1] - _SHARES[0])
    low = min(int(place), len(_SHARES) - 2)
    return low, place - low


_SPAN_S: Final = 0.4
_USUAL_STEP_S: Final = 0.025
_MOVED_MM: Final = 0.3
"""As for the lag (`body_lag`): spans with less tell nothing but noise, and one is longer than that
and shorter than a turn."""
_MEMORY_S: Final = 60.0
"""Of motion: friction is the body's, not the place's."""
_GAIN_MM2: Final = 50.0
"""As much motion with a gain of 1 is taken for seen before anything is, as for the gains ..."""
_SMALL_GAIN_MM2: Final = 1000.0
"""... and of small motions. In those nothing slips, so that a body which holds back and one with a
smaller gain look alike. Near where it began a model is right to a tenth, and tells them apart: of a
slow arm small motions tell 0.54 so, and 0.45 with gains as free as on a path."""
_PRIOR_MM2: Final = 20.0
"""What a share that is one more than that of pre-training has to explain besides."""
_ON_THE_WAY: Final = 0.1
"""What is seen on the way to a path counts so many times what is seen on one. It begins far from
where was explored, and there a Jacobian that is wrong looks like a body that holds back less than
it does: a slow arm's rectangle begins a tenth farther off where it counts like a path."""


class _Estimate:
    def __init__(self, share: float) -> None:
        self.share = min(share, float(_SHARES[-1]))
        self._prior_mm2 = _PRIOR_MM2 * (_SHARES - share) ** 2
        self._underway = Underway()
        self._span: deque[tuple[float, Vector, Vector]] = deque()
        """Time, (k, 3) what has arrived of what was told by each share, and the tip."""
        self._small_sums = np.zeros((3, len(_SHARES), 3))
        """xx, xz and zz in mm² by share and coordinate of small motions: x being what was told, z
        what came more."""
        self._sums = np.zeros((3, len(_SHARES), 3))
        """The same, of all others."""

    def break_off(self) -> None:
        self._span.clear()
        self._underway.begin()

    def add_small(self, probed: Sequence[tuple[SmallMotion, Vector]], lag: BodyLag) -> None:
        """Motions, and (k, 3) mm that were told in each by each share."""
        steps = [(motion.t_s, motion.dt_s, told, motion.tip_mm) for motion, told in probed]
        seen = [one for step in steps if (one := self._seen(*step, lag)) is not None]
        if seen:
            self._small_sums = self._small_sums + np.sum(seen, axis=0)
            self.share = self._found()

    def add(
        self, t_s: float, dt_s: float, told_mm: Vector, tip_mm: Vector, lag: BodyLag, weight: float
    ) -> None:
        products = self._seen(t_s, dt_s, told_mm, tip_mm, lag)
        if products is not None:
            kept = exp(-dt_s / _MEMORY_S)
            self._small_sums = kept * self._small_sums
            self._sums = kept * self._sums + weight * products
            self.share = self._found()

    def _seen(
        self, t_s: float, dt_s: float, told_mm: Vector, tip_mm: Vector, lag: BodyLag
    ) -> Vector | None:
        """(3, k, 3) xx, xz and zz of the span that ends now. None: nothing moved in it."""
        self._underway.tell(t_s, dt_s, told_mm, lag.lag_s, lag.dead_share)
        span = self._span
        span.append((t_s, self._underway.told_mm - self._underway.left_mm, tip_mm))
        if t_s - span[0][0] < _SPAN_S:
            return None
        while t_s - span[1][0] >= _SPAN_S:
            span.popleft()
        (_, *began), (_, *ended) = span[0], span[-1]
        told, came = (end - begin for begin, end in zip(began, ended, strict=True))
        if max(float((told**2).sum(axis=1).max()), float(came @ came)) < _MOVED_MM**2:
            return None
        more = came - told
        return dt_s / _USUAL_STEP_S * np.array([told * told, told * more, more * more])

    def _found(self) -> float:
        left = _unexplained(self._small_sums, _SMALL_GAIN_MM2)
        left = left + _unexplained(self._sums, _GAIN_MM2) + self._prior_mm2
        best = int(np.argmin(left))
        if best in (0, len(left) - 1):
            return float(_SHARES[best])
        before, here, after = left[best - 1 : best + 2].tolist()
        shift = 0.5 * (before - after) / max(before - 2.0 * here + after, 1e-9)
        return float(_SHARES[best] + shift * (_SHARES[1] - _SHARES[0]))


def _unexplained(sums: Vector, gain_mm2: float) -> Vector:
    """(k,) mm² of motion that each share leaves, with its best gains."""
    xx, xz, zz = sums
    return np.asarray((zz - xz**2 / (xx + gain_mm2)).sum(axis=1))


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: a second once, then hundredths."""
    hysteresis = Hysteresis(HeldBack(0.5, np.zeros(3), np.ones(3)))
    for place in (0.1, 0.2):
        hysteresis.follow(np.full(3, place), 1.0)
