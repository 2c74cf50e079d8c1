"""What a late cycle was spent on: our own parts, the collector, the disk, or somebody else."""

import gc
import resource
from typing import Any

from drivers.clock import Clock


class TimeSpent:
    """Where the time since the last cycle has gone."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._parts: dict[str, int] = {}
        self._usage = resource.getrusage(resource.RUSAGE_SELF)
        self._collecting_since_ns = 0

    def begin(self) -> None:
        """A cycle begins."""
        self._parts.clear()

    def add(self, part: str, duration_ns: int) -> None:
        """Some part of the loop took this long."""
        self._parts[part] = self._parts.get(part, 0) + duration_ns

    def explanation(self, late_ns: int) -> str:
        """What made a cycle `late_ns` late, as far as can be told."""
        usage, before = resource.getrusage(resource.RUSAGE_SELF), self._usage
        self._usage = usage
        late = f"{late_ns * 1e-6:.1f} ms late: "
        longest = max(self._parts.items(), key=lambda part: part[1], default=("", 0))
        if longest[1] > late_ns // 2:
            return f"{late}{longest[0]} took {longest[1] * 1e-6:.1f} ms"
        faults = usage.ru_majflt - before.ru_majflt
        if faults:
            return f"{late}{faults} pages had to be fetched from disk"
        if usage.ru_nivcsw > before.ru_nivcsw:
            return f"{late}other programs had the processor"
        return f"{late}the machine did not wake us"

    def watch_collector(self) -> None:
        """Count garbage collections too, from now on."""
        gc.callbacks.append(self._collecting)

    def close(self) -> None:
        """Leave the collector alone."""
        if self._collecting in gc.callbacks:
            gc.callbacks.remove(self._collecting)

    def _collecting(self, phase: str, info: dict[str, Any]) -> None:
        del info
        now_ns = self._clock.now_ns()
        if phase == "start":
            self._collecting_since_ns = now_ns
        else:
            self.add("garbage collection", now_ns - self._collecting_since_ns)
