"""How well the loop keeps its time, and what a late cycle was spent on."""

import gc
import resource
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.host.periodic_timer import Tick
from drivers.clock import Clock

# What a late cycle was spent on: our own parts, the collector, the disk, or somebody else.


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


_KEPT: Final = 2048
_RATE_OVER_NS: Final = 2_000_000_000


class Timekeeping:
    """Lateness of the bus cycles and length of the control steps, over the last few seconds."""

    def __init__(self, period_ns: int, spent: TimeSpent) -> None:
        self.missed = 0
        """Cycles that were skipped."""
        self.last_gap_ns = 0
        """Between the last two cycles."""
        self.last_overrun = ""
        self.spent = spent
        self._period_ns = period_ns
        self._last_ns: int | None = None
        self._lateness, self._cycle_times = _Kept(), _Kept()
        self._lengths, self._step_times = _Kept(), _Kept()

    def cycle_begins(self, tick: Tick, now_ns: int) -> None:
        """A bus cycle was due at `tick.due_ns` and begins now."""
        late_ns = now_ns - tick.due_ns
        self._lateness.add(late_ns)
        self._cycle_times.add(now_ns)
        self.missed += tick.skipped
        if self._last_ns is not None:
            self.last_gap_ns = now_ns - self._last_ns
            if tick.skipped or late_ns > self._period_ns // 2:
                overrun_ns = late_ns + tick.skipped * self._period_ns
                self.last_overrun = self.spent.explanation(overrun_ns)
        self._last_ns = now_ns
        self.spent.begin()

    def step_ended(self, began_ns: int, on_bus_ns: int, now_ns: int) -> None:
        """A frame had come at `began_ns`, its targets were on the bus, and all was told by now."""
        self._lengths.add(on_bus_ns - began_ns)
        self._step_times.add(now_ns)
        self.spent.add("control step", now_ns - began_ns)

    def forgive(self) -> None:
        """What was late until now was late on purpose."""
        self._last_ns, self.last_gap_ns = None, 0

    @property
    def cycles(self) -> int:
        return self._cycle_times.count

    @property
    def steps(self) -> int:
        return self._step_times.count

    def lateness_s(self) -> tuple[float, float, float]:
        """Median, 99th percentile and maximum of the kept cycles' lateness."""
        return _percentiles(self._lateness.values())

    def step_s(self) -> tuple[float, float, float]:
        """Median, 99th percentile and maximum of the kept steps' lengths."""
        return _percentiles(self._lengths.values())

    def cycle_rate_hz(self, now_ns: int) -> float:
        """Bus cycles per second, over the last two seconds."""
        return _rate(self._cycle_times.values(), now_ns)

    def step_rate_hz(self, now_ns: int) -> float:
        """Control steps per second, over the last two seconds."""
        return _rate(self._step_times.values(), now_ns)


class _Kept:
    """The last numbers of a stream, without allocation."""

    def __init__(self) -> None:
        self.count = 0
        self._ring = np.zeros(_KEPT, np.int64)

    def add(self, value: int) -> None:
        self._ring[self.count % _KEPT] = value
        self.count += 1

    def values(self) -> NDArray[np.int64]:
        return self._ring[: min(self.count, _KEPT)]


def _percentiles(values_ns: NDArray[np.int64]) -> tuple[float, float, float]:
    if not len(values_ns):
        return 0.0, 0.0, 0.0
    median, high = np.percentile(values_ns, (50, 99))
    return float(median) * 1e-9, float(high) * 1e-9, float(values_ns.max()) * 1e-9


def _rate(times_ns: NDArray[np.int64], now_ns: int) -> float:
    recent: Any = np.count_nonzero(times_ns > now_ns - _RATE_OVER_NS)
    return int(recent) * 1e9 / _RATE_OVER_NS
