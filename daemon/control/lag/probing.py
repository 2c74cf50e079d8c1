"""Small motions that show how late the body answers, before anything is followed.

What is told is a few steps of the tip, out, across and back in each direction of space, in a tenth
of a second, with rests between them that differ. A path tells a lag badly: on a circle a hysteresis
that turns looks like lag, and so does a gain that is not known. Steps tell it well, since gains
change how far the tip goes and hysteresis whether it comes back, and neither when.

Nothing is fed back. In the end the axes go back to where they were, and the tip with them.

The first direction tells what the others are needed for. A short lag has to be known better than
one direction alone tells it, which is 0.02 s off: of a prompt body one more is gone, twice as fast.
None is where a long lag is as the model has it, which was learnt on such a body.
"""

from typing import Final

import numpy as np

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
