"""Play between an axis and the body: where an axis turns, its first tenths of a millimetre come to
nothing.

A worn nut has 0.1 to 0.3 mm of it (backlash). Friction inside a body (`hysteresis`) holds a share
of a motion back until it slips, over millimetres; play holds all of it back, and is soon over. With
P the place of an axis within a play of half-width b, between -b and b, its tip makes of what was
told

    Δp = g J (Δu - ΔP)

Six axes that turn at once, as where a load is hung on, keep back some millimetres of the tip.

Small motions to and fro, before anything is followed, tell b: by least squares over short spans,
with a gain along each axis of space, since J is never exact, and a shift in time, since play looks
like lag: 0.12 mm of it like 0.02 s of a prompt body's, and 0.15 mm like 0.05 s of a slow one's,
whose axes go half as fast. Then the lag is looked for once more, without what play takes, and so is
how much of it is dead time, which play makes look like less. About two thirds of b are found, and
next to nothing where there is none.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from daemon.control.lag import lag_kernels as kernels
from daemon.control.lag.body_lag import DEAD_SHARES, BodyLag, Underway
from drivers.pose import Vector

_LOOKED_FOR: Final = 3e-3
"""Half-width of the play that motions are compared with, as a share of an axis' travel: 0.15 mm of
an arm's cylinders, 0.09 mm of tendons. With 0.06 to 0.2 mm b comes out the same within a tenth."""
_GAIN_MM2: Final = 5.0
"""As much motion with a gain of 1 is taken for seen before anything is: small motions along one
axis of space alone tell nothing of the others."""
_MOST: Final = 6e-3
"""A share of the travel, beyond which it is something else."""
_SPAN_S: Final = 0.2
"""Of the motions that are compared: as long as play lasts."""
_LOOKS_LIKE_S: Final = 0.06
"""Play looks like this much more lag at most. What is found shorter than that without it, is so for
friction and creep, which small motions do not tell from play: an arm that was late by 0.82 s by
0.22 s."""
_TAKEN_UP: Final = 2.0
"""What an axis has to go within its play is asked for besides, as far as it is no more than so many
times the step. All of it at once would be a jerk wherever noise turns an axis; once or eight
times the step make no difference to how soon a load is made up for."""


class SmallMotion(NamedTuple):
    """A step of the small motions, and where the tip was after it."""

    t_s: float
    dt_s: float
    told_mm: Vector
    """(3,) that the tip makes of it by the Jacobian, without what friction holds back."""
    within_mm: Vector
    """(3,) of that within the play that is looked for."""
    tip_mm: Vector


class Play:
    """Of m axes. They rest in the middle of it where they are seen first."""

    def __init__(self, travel: Vector) -> None:
        """travel: (m,) mm or rad."""
        self.share = 0.0
        """b as a share of the travel."""
        self._travel = travel
        self._within = np.zeros(len(travel))
        """(m,) P, mm or rad ..."""
        self._moved_within = np.zeros(len(travel))
        """... and how far it moved in the last step."""
        self._compared = np.zeros(len(travel))
        self._compared_moved = np.zeros(len(travel))
        """The same in the play that is looked for."""

    @property
    def within(self) -> Vector:
        """(m,) how far the axes are ahead of what they move."""
        return self._within

    def follow(self, moved: Vector) -> None:
        """The axes were told to go (m,) further."""
        play, looked_for = self.share * self._travel, _LOOKED_FOR * self._travel
        self._within, self._moved_within = kernels.within_play(self._within, moved, play)
        compared = kernels.within_play(self._compared, moved, looked_for)
        self._compared, self._compared_moved = compared

    def lost_mm(self, jacobian: Vector) -> Vector:
        """(3,) of the last step that is not of the tip. jacobian: (3, m)."""
        return np.asarray(jacobian @ self._moved_within)

    def with_what_is_lost(self, step: Vector) -> Vector:
        """(m,) to ask of the axes where what they move shall go (m,) further."""
        return kernels.with_play(step, self._within, self.share * self._travel, _TAKEN_UP)

    def within_mm(self, jacobian: Vector) -> Vector:
        """(3,) of the last step that is within the play that is looked for. jacobian: (3, m)."""
        return np.asarray(jacobian @ self._compared_moved)

    def learn(self, motions: Sequence[SmallMotion], lag: BodyLag) -> None:
        """How much play there is, now that small motions were made and the lag is known, which play
        made look longer."""
        found = _found(motions, lag)
        if found is None or not found > 0.0:
            return
        self.share = min(found, _MOST)
        without = _lag_without(motions, self.share / _LOOKED_FOR)
        if without is not None:
            least_s = lag.lag_s - _LOOKS_LIKE_S
            lag.lag_s = min(lag.lag_s, max(without.lag_s, least_s))
            lag.dead_share = without.dead_share


def _found(told: Sequence[SmallMotion], lag: BodyLag) -> float | None:
    """b as a share of the travel, as small motions tell it; it may come out below none. None: they
    tell nothing."""
    t_s = np.array([one.t_s for one in told])
    ends = np.flatnonzero(t_s - t_s[:1] >= _SPAN_S)
    if not len(ends) or not (np.diff(t_s) > 0.0).all():
        return None
    begins = np.searchsorted(t_s, t_s[ends] - _SPAN_S, side="right") - 1
    arrived = _arrived(told, [one.told_mm for one in told], lag)
    within = _arrived(told, [one.within_mm for one in told], lag)
    tip_mm = np.array([one.tip_mm for one in told])
    series = (arrived, within, tip_mm, np.gradient(arrived, t_s, axis=0))
    gone, lost, came, faster = (one[ends] - one[begins] for one in series)
    along = [np.where(np.arange(3) == axis, gone, 0.0) for axis in range(3)]
    terms = np.stack([*along, lost, faster]).reshape(5, -1)
    products, seen = terms @ terms.T, terms @ came.ravel()
    products[:3, :3] += _GAIN_MM2 * np.eye(3)
    seen[:3] += _GAIN_MM2
    if not np.isfinite(seen).all() or np.linalg.matrix_rank(products) < len(terms):
        return None
    solution = np.linalg.solve(products, seen)
    gain = float(solution[:3].mean())
    if not gain > 0.0:
        return None
    return _LOOKED_FOR * float(-solution[3]) / gain


def _lag_without(told: Sequence[SmallMotion], times: float) -> BodyLag | None:
    """By small motions without so many times what is within the play that is looked for. None:
    they tell nothing."""
    lag, sum_mm = BodyLag(dead_shares=DEAD_SHARES), np.zeros(3)
    for one in told:
        sum_mm = sum_mm + one.told_mm - times * one.within_mm
        lag.add(one.t_s, one.dt_s, sum_mm, one.tip_mm)
    return lag if lag.settle() else None


def _arrived(told: Sequence[SmallMotion], moved_mm: Sequence[Vector], lag: BodyLag) -> Vector:
    """(n, 3) mm of (3,) each that have arrived after each step."""
    underway, arrived = Underway(), list[Vector]()
    for one, moved in zip(told, moved_mm, strict=True):
        underway.tell(one.t_s, one.dt_s, moved, lag.lag_s, lag.dead_share)
        arrived.append(underway.told_mm - underway.left_mm)
    return np.array(arrived)


def warm_up() -> None:
    """Compile the kernels, or load them from numba's cache: a second once, then hundredths."""
    play = Play(np.ones(3))
    play.follow(np.ones(3))
    play.with_what_is_lost(np.ones(3))
