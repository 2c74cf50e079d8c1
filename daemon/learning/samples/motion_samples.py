"""From tracker frames to motions that are worth learning from.

Between two frames there is mostly noise, so a sample spans a motion: it ends when the tip or the
axes have gone far enough (Ho 2018 took one every 0.6 mm), and begins where the last one ended. What
is doubtful never becomes a sample: a tip that moves by itself, one that does not move at all, one
that is too fast, and whatever came shortly before such a thing was noticed.
"""

from collections import deque
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector

_NS_PER_S = 1e9
_FROZEN_FRAMES = 3
"""In a row, in which the axes move and the tip does not: by chance that happens once. Chosen."""
_AVERAGED_AT_MOST = 8
_GAP_STEPS = 3.0
"""Of a slow tracker: its frames are a gap_s apart by themselves."""
_USUAL_OF = 8
"""The shortest of the last so many steps is the usual one. Of fewer nothing is usual yet."""
_MOST_AVERAGED_SHARE = 0.5
_MAY_BE_ZERO = ("lag_s", "shortest_s", "averaged_share", "confirm_s")
_TINY = 1e-12


@dataclass(frozen=True)
class SamplingSettings:
    """When a motion is a sample. Shares are of each axis' travel."""

    tip_mm: float = 1.0
    """A sample ends when the tip has gone so far ..."""
    travel_share: float = 0.05
    """... or the axes, all together, have: some motions leave the tip where it is."""
    lag_s: float = 0.0
    """How much later than its axes the body moves."""
    averaged_share: float = 0.5
    """Each end of a motion is the mean of so much of its frames: a slow one has many of them. Noise
    that is left in Δp makes the gains that are learnt from it too small."""
    shortest_s: float = 0.0
    """No motion ends sooner, however fast it is: where the lag is only known roughly, a motion that
    takes less time than it is unsure by tells of the lag, and not of the axes."""
    longest_s: float = 1.0
    """A motion that took longer is none: it stood still, or only crept. A new one begins."""
    gap_s: float = 0.1
    """Without a frame for longer, and for three steps of a slow tracker, everything begins anew."""
    fastest_mm_s: float = 150.0
    """A tip that is faster from one frame to the next was measured wrongly, or pushed."""
    most_mm: float = 1000.0
    """A tip that goes further than this for the axes' whole travel is not moved by them alone."""
    frozen_mm: float = 0.01
    """A tip that goes less than this from frame to frame, while the axes move, is not measured."""
    confirm_s: float = 0.3
    """So long must everything go on to be sound before a sample is given."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            lowest = 0.0 if name in _MAY_BE_ZERO else _TINY
            if not lowest <= value < np.inf:
                raise ValueError(f"{name} must not be {value}")
        if self.averaged_share > _MOST_AVERAGED_SHARE:
            raise ValueError(f"averaged_share must not be above {_MOST_AVERAGED_SHARE}")

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, settings: dict[str, Any]) -> Self:
        """From what `to_dict` gave. ValueError for what it does not know."""
        try:
            return cls(**settings)
        except TypeError as error:
            raise ValueError(f"no sampling settings: {error}") from None


def longest_step_s(t_s: Vector, gap_s: float) -> float:
    """Without a frame for longer there is a gap. t_s: (n,) of frames, in the order of time."""
    usual_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
    return max(gap_s, _GAP_STEPS * usual_s)


class _Frame(NamedTuple):
    t_ns: int
    tip_mm: Vector
    u: Vector
    """Those that caused this tip."""


class _Waiting(NamedTuple):
    sample: MotionSample
    began_ns: int
    ended_ns: int


class MotionSampler:
    """Takes frames as they come, believed ones only. For one robot."""

    def __init__(self, settings: SamplingSettings, travel: Vector) -> None:
        """travel: (m,) of the axes, in their own units."""
        self.began_ns = 0
        """When the motion began that the last sample given is of."""
        self._settings = settings
        self._travel = np.array(travel, dtype=np.float64)
        self._shortest_ns = round(settings.shortest_s * _NS_PER_S)
        self._longest_ns = round(settings.longest_s * _NS_PER_S)
        self._gap_ns = round(settings.gap_s * _NS_PER_S)
        self._confirm_ns = round(settings.confirm_s * _NS_PER_S)
        self._lag_ns = round(settings.lag_s * _NS_PER_S)
        self._axes_frames: deque[tuple[int, Vector]] = deque()
        self._last: _Frame | None = None
        self._steps_ns: deque[int] = deque(maxlen=_USUAL_OF)
        self._recent: deque[_Frame] = deque(maxlen=_AVERAGED_AT_MOST)
        self._begin: _Frame | None = None
        self._since_begin = 0
        self._still = 0
        self._waiting: deque[_Waiting] = deque()

    def add(self, t_ns: int, tip_mm: Vector, u: Vector) -> MotionSample | None:
        """Take (3,) mm and (m,) axes at `t_ns`; a sample that is ready by now, or None."""
        if not (np.isfinite(tip_mm).all() and np.isfinite(u).all()):
            self.break_off()
            return None
        if self._last is not None and t_ns <= self._last.t_ns:
            return None
        if self._doubtful(t_ns, tip_mm, u):
            self.break_off()
        self._last = _Frame(t_ns, np.array(tip_mm), np.array(u))
        earlier = self._axes_at_cause(self._last)
        if earlier is None:
            return None
        self._recent.append(_Frame(t_ns, self._last.tip_mm, earlier))
        self._go_on()
        return self._ready(t_ns)

    def break_off(self) -> None:
        """What comes next has nothing to do with what came before, which may have been wrong."""
        self._last = self._begin = None
        self._still = 0
        self._axes_frames.clear()
        self._recent.clear()
        self._waiting.clear()

    def _doubtful(self, t_ns: int, tip_mm: Vector, u: Vector) -> bool:
        """Whether this frame cannot follow the last one."""
        last, settings = self._last, self._settings
        if last is None:
            return False
        dt_ns = t_ns - last.t_ns
        self._steps_ns.append(dt_ns)
        moved_mm = float(np.linalg.norm(tip_mm - last.tip_mm))
        stood = moved_mm < settings.frozen_mm
        self._still = self._still + 1 if stood and (u != last.u).any() else 0
        usual_ns = min(self._steps_ns) if len(self._steps_ns) == _USUAL_OF else 0
        return (
            dt_ns > max(self._gap_ns, _GAP_STEPS * usual_ns)
            or moved_mm > settings.fastest_mm_s * dt_ns / _NS_PER_S
            or self._still >= _FROZEN_FRAMES
        )

    def _axes_at_cause(self, frame: _Frame) -> Vector | None:
        """(m,) where the axes were when they caused this tip; None: that is not known yet."""
        if not self._lag_ns:
            return frame.u
        frames, cause_ns = self._axes_frames, frame.t_ns - self._lag_ns
        frames.append((frame.t_ns, frame.u))
        while len(frames) > 1 and frames[1][0] <= cause_ns:
            frames.popleft()
        (t0, u0), (t1, u1) = frames[0], frames[min(1, len(frames) - 1)]
        if t0 > cause_ns:
            return None
        return u0 if t0 == cause_ns else u0 + (cause_ns - t0) / (t1 - t0) * (u1 - u0)

    def _go_on(self) -> None:
        """The motion has come one frame further."""
        begin, settings = self._begin, self._settings
        self._since_begin += 1
        here = self._here()
        if begin is None or here.t_ns - begin.t_ns > self._longest_ns:
            self._begin_at(here)
            return
        delta_tip, delta_u = here.tip_mm - begin.tip_mm, here.u - begin.u
        moved_mm = float(np.linalg.norm(delta_tip))
        share = float(np.linalg.norm(delta_u / self._travel))
        if moved_mm < settings.tip_mm and share < settings.travel_share:
            return
        if here.t_ns - begin.t_ns < self._shortest_ns:
            return
        if moved_mm <= settings.most_mm * share:
            sample = MotionSample(begin.tip_mm, begin.u, delta_u, delta_tip)
            self._waiting.append(_Waiting(sample, begin.t_ns, here.t_ns))
        self._begin_at(here)

    def _here(self) -> _Frame:
        """Where tip and axes are: the mean of the last frames, but none of the beginning's."""
        count = round(self._settings.averaged_share * self._since_begin)
        count = min(count, len(self._recent))
        if count <= 1:
            return self._recent[-1]
        frames = list(self._recent)[-count:]
        tip_mm = np.mean([frame.tip_mm for frame in frames], axis=0)
        u = np.mean([frame.u for frame in frames], axis=0)
        return _Frame(frames[-1].t_ns, tip_mm, u)

    def _begin_at(self, here: _Frame) -> None:
        self._begin, self._since_begin = here, 0

    def _ready(self, t_ns: int) -> MotionSample | None:
        if not self._waiting or t_ns - self._waiting[0].ended_ns < self._confirm_ns:
            return None
        ready = self._waiting.popleft()
        self.began_ns = ready.began_ns
        return ready.sample
