"""How often frames come, how old they are when they do, and how long a control step lasts."""

from bisect import bisect_left
from collections import deque
from statistics import median
from typing import Final

_RATE_OVER_NS: Final = 2_000_000_000
_AGES_KEPT: Final = 100
_STEPS_KEPT: Final = 9
_SLOWER: Final = 1.5
"""Times a frame's period: what is less comes of a frame that was lost now and then."""
_LONGEST_STEP_NS: Final = 200_000_000
"""Five a second: slower than that nothing is to be controlled."""


class StepPeriod:
    """How long a control step lasts: until the next frame, as frames have come of late.

    A tracker measures evenly, and a slow line brings only some of its frames: nine in a second at
    9600 baud. Axes that were told steps for one frame's time would stand still for most of it.
    """

    def __init__(self, frame_ns: int) -> None:
        """frame_ns: from one measurement of the tracker to the next."""
        self.period_ns = frame_ns
        self._frame_ns = frame_ns
        self._steps_ns: deque[int] = deque(maxlen=_STEPS_KEPT)

    def add(self, step_ns: int) -> None:
        """So long after the last one a frame was measured."""
        if step_ns <= 0:
            return
        self._steps_ns.append(step_ns)
        usual_ns = sorted(self._steps_ns)[len(self._steps_ns) // 2]
        slow = usual_ns > _SLOWER * self._frame_ns and len(self._steps_ns) == _STEPS_KEPT
        self.period_ns = min(usual_ns, _LONGEST_STEP_NS) if slow else self._frame_ns


class FrameStatistics:
    """Over the frames of the last two seconds."""

    def __init__(self) -> None:
        self._times_ns: deque[int] = deque()
        self._ages_ns: deque[int] = deque(maxlen=_AGES_KEPT)

    def add(self, measured_ns: int, received_ns: int) -> None:
        """A frame came. They come in the order of being measured."""
        self._times_ns.append(measured_ns)
        while self._times_ns[0] < measured_ns - _RATE_OVER_NS:
            self._times_ns.popleft()
        self._ages_ns.append(received_ns - measured_ns)

    def rate_hz(self, now_ns: int) -> float:
        """Frames per second."""
        times_ns = self._times_ns
        first = bisect_left(times_ns, now_ns - _RATE_OVER_NS)
        recent = len(times_ns) - first
        if recent < 2:
            return 0.0
        return (recent - 1) * 1e9 / (times_ns[-1] - times_ns[first])

    def latency_s(self) -> float | None:
        """From measurement to the loop, the median."""
        return median(self._ages_ns) * 1e-9 if self._ages_ns else None
