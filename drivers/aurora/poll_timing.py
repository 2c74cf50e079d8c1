"""When to ask for the next frame: just after it is there, so that its reply is young.

Nobody says when a frame is ready; asking shows it. A reply that repeats the last frame was asked
for too early, a new one late enough. So requests keep the device's rhythm and creep earlier a
little every frame; a repeated frame shows the edge, and the rhythm steps back behind it.
"""

_SLOWEST_CREEP_NS = 5_000
"""Per frame. Twice what 100 ppm between the clocks makes of 25 ms: the edge cannot run away."""
_GUARD_NS = 500_000
"""Smallest step back, so that in any jitter at most one frame in a hundred is asked for twice."""


class PollTiming:
    """Decides when requests go out. Where the rhythm is not known, they go back to back.

    That is the case at first, and stays so where the line is too slow for repeated frames, or
    where the device holds a reply until it has a new frame: there is nothing to gain then.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._planned_ns: int | None = None
        self._creep_ns = 0
        self._repeat_sent_ns: int | None = None

    def next_request_ns(self, now_ns: int) -> int:
        """When the next request is to go out; not before now."""
        if self._planned_ns is None or self._repeat_sent_ns is not None:
            return now_ns
        return max(self._planned_ns, now_ns)

    def repeated(self, sent_ns: int) -> None:
        """The request sent then brought the last frame once more."""
        if self._planned_ns is not None and self._repeat_sent_ns is None:
            self._planned_ns += max(2 * self._creep_ns, _GUARD_NS)
            self._creep_ns = max(self._creep_ns // 2, _SLOWEST_CREEP_NS)
        self._repeat_sent_ns = sent_ns

    def fresh(self, sent_ns: int, frames: int) -> None:
        """The request sent then brought a new frame, `frames` after the last one."""
        repeat_sent_ns, self._repeat_sent_ns = self._repeat_sent_ns, None
        if repeat_sent_ns is None:
            if self._planned_ns is not None:
                self._planned_ns += frames * self._period_ns - self._creep_ns
            return
        planned_ns = self._planned_ns
        if planned_ns is not None and planned_ns > repeat_sent_ns:
            self._planned_ns = planned_ns + frames * self._period_ns
            return
        # The frame became ready between these two requests: start from the later one.
        too_late_ns = sent_ns - (repeat_sent_ns if planned_ns is None else planned_ns)
        self._creep_ns = min(max(too_late_ns // 8, _SLOWEST_CREEP_NS), self._period_ns // 8)
        self._planned_ns = sent_ns + self._period_ns
