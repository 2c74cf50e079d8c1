"""How often frames come, and how old they are when they do."""

from bisect import bisect_left
from collections import deque
from statistics import median
from typing import Final

_RATE_OVER_NS: Final = 2_000_000_000
_AGES_KEPT: Final = 100


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
