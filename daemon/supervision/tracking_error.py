"""Whether the tip gets to its reference, or whoever leads it there does not know how.

An error is explained where the reference itself has only just gone on: of a tip that comes late by
some time it is the way that the reference went meanwhile. What is left is to be worked off. A clock
runs while the tip does not come nearer, twice as fast while it goes away, and back while it comes.
So a load that is hung on makes a large error and no alarm. A tip that swings about its reference
comes nearer half of the time, and is told by swings that do not get smaller. A tip that goes
away from its reference by its own motion, for longer than it goes on after a reference that has
turned round, and not slower and slower as a load pushes it, is led the wrong way: the clock is not
waited for.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from config.robot import Robot

SHARE_OF_WORKSPACE: Final = 0.03
"""Of its diagonal: 7 mm in the soft arm's, 10 mm in the tendon arm's. Both arms' shipped
trajectories are followed within 2 to 3 mm where a model was learnt, and within this where not."""
WITHOUT_WORKSPACE_MM: Final = 8.0
"""Where the file says nothing of how large the robot is: for an arm of 0.2 m."""
_LATE_NS: Final = 1_000_000_000
"""What a body may come late: with a dead time of 0.25 s and a lag of 0.5 s, and what hysteresis and
creep add to it, the tip is where its reference was 0.95 s ago."""
_OVER_NS: Final = 500_000_000
"""The tip's way is measured over this: of its noise of 0.2 mm, 0.5 mm/s are left."""
_GOES_AWAY: Final = 2.0
"""So much faster the clock runs at most: a tip that goes away halves what is waited. Chosen."""
_LED_AWAY_NS: Final = 800_000_000
"""So long in one go: a tip that is 0.95 s late goes on for half of that after a reference that has
turned round."""
_NOT_SLOWER: Final = 0.75
"""In the second half of that time it goes so much of what it went in the first. A load pushes a
body with a lag of 0.5 s there 0.45 of it; who is led goes as fast, or faster."""
_LED_AWAY_OVER_NS: Final = 250_000_000
"""The tip's own motion is measured over this: of its noise of 0.2 mm, 1 mm/s are left."""
_AWAY_MM_S: Final = 2.0
"""Below, it stands."""
_SWING_SHARE: Final = 0.6
"""An error that falls to this share of its peak has ended a swing."""
_NOT_SMALLER: Final = 0.95
"""Of the swing before: of peaks of 8 mm, 0.4 mm, which is twice the noise."""
_SWINGS: Final = 4
"""So many in a row of which none is smaller than the one before: the first may be a load's."""
_SWING_WITHIN_NS: Final = 2_500_000_000
"""From peak to peak, half a period: a body with a dead time of 0.25 s and a lag of 0.5 s swings
within 1.5 s. Loads that are hung on and taken off, and corners of trajectories, take longer."""
_OF_THE_REFERENCE: Final = 0.5
"""A rise is the reference's own if this went so much of it meanwhile: set-points that jump."""
_LONGEST_STEP_NS: Final = 100_000_000
"""A step after a gap counts as this long: nothing was seen meanwhile."""

Place = Sequence[float]


class _Seen(NamedTuple):
    t_ns: int
    tip_mm: Place
    reference_way_mm: float
    """That the reference has gone since the beginning."""


class _Away(NamedTuple):
    """When the tip began to go away from its reference, and how far it was from it."""

    t_ns: int
    error_mm: float


class TrackingError:
    """Judges one motion after the other; `begin` comes before each."""

    def __init__(self, allowed_mm: float, patience_s: float) -> None:
        """allowed_mm: beyond what the reference's own motion explains. patience_s: so long the
        error may be larger with the tip no nearer; who comes nearer by the error's own size in this
        time is right in time."""
        if not (0.0 < allowed_mm < math.inf and 0.0 < patience_s < math.inf):
            raise ValueError(f"not {allowed_mm} mm and {patience_s} s")
        self.allowed_mm = allowed_mm
        self._patience_s = patience_s
        self._seen: deque[_Seen] = deque()
        self._reference_mm: Place | None = None
        self._way_mm = 0.0
        self._waited_s = 0.0
        self._swings = _Swings()
        self._away: _Away | None = None

    @classmethod
    def of(cls, robot: Robot) -> "TrackingError":
        """As the robot file has it."""
        settings, box = robot.supervision, robot.workspace
        allowed_mm = settings.tracking_error_mm
        if allowed_mm is None and box is None:
            allowed_mm = WITHOUT_WORKSPACE_MM
        elif allowed_mm is None:
            assert box is not None
            sides = [high - low for low, high in (box.x_mm, box.y_mm, box.z_mm)]
            allowed_mm = SHARE_OF_WORKSPACE * math.hypot(*sides)
        return cls(allowed_mm, settings.tracking_patience_s)

    def begin(self) -> None:
        """Motion begins, or nothing is expected of it: what was before does not count."""
        self._seen.clear()
        self._reference_mm = None
        self._way_mm = self._waited_s = 0.0
        self._swings = _Swings()
        self._away = None

    def hinder(self) -> None:
        """No progress was possible in this step: the clock stands still."""
        self._seen.clear()
        self._away = None
        self._reference_mm = None

    def look(self, t_ns: int, tip_mm: Place, reference_mm: Place) -> str:
        """A frame in which the tip was seen. Returns what is wrong; empty: nothing is."""
        if not all(map(math.isfinite, (*tip_mm, *reference_mm))):
            return ""  # who measures and who proposes such things is held for that
        dt_s = self._remember(t_ns, tip_mm, reference_mm)
        error_mm = math.dist(tip_mm, reference_mm)
        if self._led_away(t_ns, error_mm, reference_mm):
            return f"the tip goes away from its reference, {error_mm:.0f} mm by now"
        allowed_mm = self.allowed_mm + self._explained_mm()
        if self._swings.go_on(t_ns, error_mm, allowed_mm, self._way_mm):
            peaks = ", ".join(f"{peak:.0f}" for peak in self._swings.peaks_mm)
            return f"the tip swings about its reference, {peaks} mm, one after the other"
        if error_mm <= allowed_mm:
            self._waited_s = max(self._waited_s - dt_s, 0.0)
            return ""
        expected_mm_s = error_mm / self._patience_s
        lacks = 1.0 - self._progress_mm_s(tip_mm, reference_mm) / expected_mm_s
        self._waited_s = max(self._waited_s + dt_s * min(max(lacks, -1.0), _GOES_AWAY), 0.0)
        if self._waited_s < self._patience_s:
            return ""
        return f"the tip is {error_mm:.0f} mm from its reference and does not come nearer"

    def _remember(self, t_ns: int, tip_mm: Place, reference_mm: Place) -> float:
        """Returns the seconds since the frame before."""
        if self._reference_mm is not None:
            self._way_mm += math.dist(reference_mm, self._reference_mm)
        self._reference_mm = reference_mm
        before_ns = self._seen[-1].t_ns if self._seen else t_ns
        self._seen.append(_Seen(t_ns, tip_mm, self._way_mm))
        while t_ns - self._seen[0].t_ns > _LATE_NS:
            self._seen.popleft()
        return min(max(t_ns - before_ns, 0), _LONGEST_STEP_NS) * 1e-9

    def _led_away(self, t_ns: int, error_mm: float, reference_mm: Place) -> bool:
        """Whether it is the tip that goes, far enough, for too long, and does not slow down."""
        lately_mm = error_mm - self._distance_mm(t_ns - _LED_AWAY_OVER_NS, reference_mm)
        if lately_mm < _AWAY_MM_S * _LED_AWAY_OVER_NS * 1e-9:
            self._away = None
            return False
        if self._away is None:
            self._away = _Away(t_ns, error_mm - lately_mm)
        if t_ns - self._away.t_ns < _LED_AWAY_NS:
            return False
        half_mm = self._distance_mm(t_ns - _LED_AWAY_NS // 2, reference_mm)
        first_mm = half_mm - self._distance_mm(t_ns - _LED_AWAY_NS, reference_mm)
        second_mm = error_mm - half_mm
        far_mm = min(first_mm + second_mm, error_mm - self._away.error_mm)
        return far_mm >= self.allowed_mm and second_mm >= _NOT_SLOWER * first_mm

    def _distance_mm(self, t_ns: int, reference_mm: Place) -> float:
        """From where the tip was then to where the reference is now."""
        seen = next(seen for seen in self._seen if seen.t_ns >= t_ns)
        return math.dist(seen.tip_mm, reference_mm)

    def _explained_mm(self) -> float:
        return self._way_mm - self._seen[0].reference_way_mm

    def _progress_mm_s(self, tip_mm: Place, reference_mm: Place) -> float:
        """How fast the tip has come nearer to where its reference is now."""
        now_ns = self._seen[-1].t_ns
        before = next(seen for seen in self._seen if now_ns - seen.t_ns <= _OVER_NS)
        if before.t_ns == now_ns:
            return 0.0
        nearer_mm = math.dist(before.tip_mm, reference_mm) - math.dist(tip_mm, reference_mm)
        return nearer_mm / ((now_ns - before.t_ns) * 1e-9)


class _Swings:
    """The peaks of an error that comes and goes."""

    def __init__(self) -> None:
        self.peaks_mm: list[float] = []
        """Of the swings that followed one another, each no smaller than the one before."""
        self._rises = False
        self._turn_mm = math.inf
        """The largest of a rising error, the smallest of a falling one."""
        self._turn_ns = 0
        self._last_ns = 0
        self._low_mm = self._way_at_low_mm = 0.0

    def go_on(self, t_ns: int, error_mm: float, allowed_mm: float, way_mm: float) -> bool:
        """Take an error. Returns whether the swings have shown that they do not end.

        way_mm: that the reference has gone so far.
        """
        if self._rises:
            self._rising(t_ns, error_mm, way_mm)
        elif error_mm < self._turn_mm:
            self._turn_mm, self._way_at_low_mm = error_mm, way_mm
        elif error_mm > allowed_mm and error_mm * _SWING_SHARE > self._turn_mm:
            self._low_mm, self._rises = self._turn_mm, True
            self._turn_mm, self._turn_ns = error_mm, t_ns
        return len(self.peaks_mm) == _SWINGS

    def _rising(self, t_ns: int, error_mm: float, way_mm: float) -> None:
        if error_mm > self._turn_mm:
            self._turn_mm, self._turn_ns = error_mm, t_ns
        elif error_mm < _SWING_SHARE * self._turn_mm:
            self._rises = False
            risen_mm, gone_mm = self._turn_mm - self._low_mm, way_mm - self._way_at_low_mm
            if gone_mm < _OF_THE_REFERENCE * risen_mm:
                self._add(self._turn_mm)
            self._turn_mm, self._way_at_low_mm = error_mm, way_mm

    def _add(self, peak_mm: float) -> None:
        follows = self._turn_ns - self._last_ns <= _SWING_WITHIN_NS
        if not (follows and self.peaks_mm and peak_mm >= _NOT_SMALLER * self.peaks_mm[-1]):
            self.peaks_mm = []
        self.peaks_mm.append(peak_mm)
        self._last_ns = self._turn_ns
