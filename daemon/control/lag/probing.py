"""Small motions that show how late the body answers, before anything is followed.

What is told is a few steps of the tip, out, across and back in each direction of space, in a tenth
of a second, with rests between them that differ. A path tells a lag badly: on a circle a hysteresis
that turns looks like lag, and so does a gain that is not known. Steps tell it well, since gains
change how far the tip goes and hysteresis whether it comes back, and neither when.

Nothing is fed back. In the end the axes go back to where they were, and the tip with them.

The first direction tells what the others are needed for. A short lag has to be known better than
one direction alone tells it, which is 0.02 s off: of a prompt body one more is gone, twice as fast.
None is where a long lag is as the model has it, which was learnt on such a body.

What comes of them tells as well whether the Jacobian by which they were made is this body's at all.
"""

from typing import Final

import numpy as np

from daemon.control.lag.lagged_axes import LaggedAxes
from drivers.pose import Vector

AMPLITUDE_MM: Final = 5.0
"""Some twenty times a tracker's noise."""
_PLACES: Final = ((1.0, 0.65), (-1.0, 0.9), (0.0, 0.55))
"""In each direction, in amplitudes, and how many seconds there."""
_APPROACH_PER_S: Final = 8.0
"""Of what is missing there: who asks for all of it at once has axes that go as fast as they can
when they are to stop, and go beyond."""
_REST_S: Final = 1.1
"""At the end: what was told last shows, too."""
_ONE_S: Final = sum(seconds for _, seconds in _PLACES)
_GONE_S: Final = 3 * _ONE_S
PROBING_S: Final = _GONE_S + _REST_S
PROMPT_LAG_S: Final = 0.25
"""A body that is no later than this is prompt ..."""
_TIMES_AS_FAST: Final = 2.0
"""... and has answered when half of the time is over. Three times as fast its axes make it look
0.015 s later."""
PROMPT_S: Final = _ONE_S + (_ONE_S + _REST_S) / _TIMES_AS_FAST
"""How long it takes then ..."""
ALIKE_S: Final = _ONE_S + _REST_S
"""... and where a long lag is as the model has it."""
_ALIKE: Final = 0.15
"""Share of a long lag by which that of the model may differ: of the same body, empty or loaded, it
is 1 to 12 % off."""
_SPAN_S: Final = 0.4
"""Of the motions in which what was told is held against what came."""
_USUAL_STEP_S: Final = 0.025
"""Between spans of which each counts as one."""
_RIGHT_MM2: Final = 20.0
"""As much motion, in each direction, as is taken for seen to come as told: 0.3 mm of noise in a
span, sixteen of which overlap."""
_ASIDE: Final = 0.75
"""Cosine of the angle by which what comes in a direction may be aside of what was told ..."""
_LITTLE: Final = 0.6
"""... and share of it that comes along it: below both the Jacobian is of another body. Where models
are of other bodies than these late ones, with loads, hysteresis and play, 0.8 and more come where
it is as far aside, and none is aside where as little comes. An arm that is turned by sixty degrees
makes 0.3 at a cosine of 0.5. Where an exploration told nothing of the body nothing comes along what
was told, or it goes backwards."""
_CAME: Final = 0.2
"""Of a motion that is told, that comes at least where it says anything: a tip that is held fast, or
a play that keeps all of it, says nothing of the Jacobian."""


class Probing:
    """Says where the tip should be by now, from where it was when probing began."""

    def __init__(self) -> None:
        self._elapsed_s = 0.0
        self._made_mm = np.zeros(3)
        self._asked = False
        self._pace = 1.0

    @property
    def done(self) -> bool:
        return self._elapsed_s >= PROBING_S

    @property
    def returns(self) -> bool:
        """Whether the axes shall go back to where they were."""
        return self._elapsed_s >= _GONE_S

    @property
    def asks(self) -> bool:
        """Whether the first direction has just been gone. Once."""
        asks = not self._asked and self._elapsed_s >= _ONE_S
        self._asked = self._asked or asks
        return asks

    def answer(self, lag_s: float | None, known_s: float) -> None:
        """lag_s: as the first direction told it, if it did. known_s: as the model has it."""
        if lag_s is None:
            return
        if lag_s <= PROMPT_LAG_S:
            self._elapsed_s += _ONE_S
            self._pace = _TIMES_AS_FAST
        elif abs(lag_s - known_s) <= _ALIKE * lag_s:
            self._elapsed_s = _GONE_S

    @property
    def note(self) -> str:
        """What it is doing; empty when it is done."""
        if self.done:
            return ""
        return f"finds how late the body is: {self._elapsed_s:.0f} of {PROBING_S:.0f} s"

    def begin(self) -> None:
        """Motion begins. What was interrupted is made anew."""
        if not self.done:
            self._elapsed_s = 0.0
            self._made_mm = np.zeros(3)
            self._asked, self._pace = False, 1.0

    def made(self, moved_mm: Vector) -> None:
        """(3,) was told since the last step."""
        self._made_mm = self._made_mm + moved_mm

    def step(self, dt_s: float) -> Vector:
        """(3,) mm to ask for in this step."""
        missing = place_mm(self._elapsed_s) - self._made_mm
        self._elapsed_s += self._pace * dt_s
        return np.asarray(min(_APPROACH_PER_S * dt_s, 1.0) * missing)


class ProbedMotion:
    """What was told in small motions, as a Jacobian has it, and what came of it."""

    def __init__(self) -> None:
        self._told_mm = np.zeros(3)
        self._seen: list[tuple[float, Vector, Vector]] = []
        """Times, (3,) all that was told by then, and (3,) where the tip was."""

    def see(self, t_s: float, moved_mm: Vector, tip_mm: Vector, believed: bool) -> None:
        """(3,) was told since the last step, and the tip is at (3,), if that is believed."""
        self._told_mm = self._told_mm + moved_mm
        if believed:
            self._seen.append((t_s, self._told_mm, tip_mm))

    def contradicts(self, lag_s: float, dead_share: float) -> bool:
        """Whether the tip went, in some direction, and elsewhere than it was told to.

        lag_s, dead_share: how late the body is. Looked at are the principal directions of what was
        told. What came of them is found by least squares, with a prior that it is what was told.
        """
        if not self._seen:
            return False
        told, came = self._spans(lag_s, dead_share)
        along_mm2, directions = np.linalg.eigh(told.T @ told)
        answers = (came.T @ told + _RIGHT_MM2 * np.eye(3)) @ directions / (along_mm2 + _RIGHT_MM2)
        sizes = np.linalg.norm(answers, axis=0)
        along = (answers * directions).sum(axis=0)
        aside = (along < _ASIDE * sizes) & (along < _LITTLE)
        return bool((aside & (sizes > _CAME)).any())

    def _spans(self, lag_s: float, dead_share: float) -> tuple[Vector, Vector]:
        """(n, 3) mm each of what was told and had arrived, and of what came."""
        shows = LaggedAxes(np.ones(3))
        times = np.array([t_s for t_s, _, _ in self._seen])
        arrived = np.array([shows.after(t, told, lag_s, dead_share) for t, told, _ in self._seen])
        tips = np.array([tip_mm for _, _, tip_mm in self._seen])
        before = np.searchsorted(times, times - _SPAN_S, side="right") - 1
        whole = before >= 0
        counts = np.sqrt(np.diff(times, prepend=times[:1])[whole, None] / _USUAL_STEP_S)
        return counts * (arrived - arrived[before])[whole], counts * (tips - tips[before])[whole]


def place_mm(elapsed_s: float) -> Vector:
    """(3,) from where probing began."""
    offset = np.zeros(3)
    for direction in range(3):
        for amplitudes, seconds in _PLACES:
            if elapsed_s < seconds:
                offset[direction] = amplitudes * AMPLITUDE_MM
                return offset
            elapsed_s -= seconds
    return offset
