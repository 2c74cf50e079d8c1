"""Watches the devices: keeps the last frame, counts rates."""

from daemon.loop.frame_statistics import FrameStatistics
from drivers.aurora.frame import TrackerFrame
from drivers.clock import Clock


class Observer:
    """Hears of every frame."""

    def __init__(self, clock: Clock) -> None:
        self.frame: TrackerFrame | None = None
        self.frames = 0
        self._clock = clock
        self._bits: dict[str, tuple[int, int]] = {}
        self._statistics = FrameStatistics()

    def on_frame(self, frame: TrackerFrame) -> None:
        self.frame = frame
        self.frames += 1
        self._statistics.add(frame.t_ns, frame.received_ns)

    def frame_rate_hz(self) -> float:
        """Frames per second over the last two seconds."""
        return self._statistics.rate_hz(self._clock.now_ns())

    def age_s(self) -> float | None:
        """Age of the newest frame."""
        return None if self.frame is None else (self._clock.now_ns() - self.frame.t_ns) * 1e-9

    def latency_s(self) -> float | None:
        """From measurement to the driver, the median of the last frames."""
        return self._statistics.latency_s()

    def bus_load(self, bus: str, bitrate_bit_s: int, bits: int) -> float:
        """Share of `bus` that was used since this was last asked, from its bits so far."""
        now_ns = self._clock.now_ns()
        then_ns, before = self._bits.get(bus, (now_ns, bits))
        self._bits[bus] = (now_ns, bits)
        if now_ns == then_ns:
            return 0.0
        return (bits - before) / ((now_ns - then_ns) * 1e-9 * bitrate_bit_s)
