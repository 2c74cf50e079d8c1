"""The emulated tracker's rhythm: when it measures, and how it numbers what it measured."""

from drivers.aurora.codec.tracking_data import FRAME_MODULUS
from sim_backends.devices.device import DeviceClock

TICKS_PER_S = 320
NORMAL_PERIOD_NS = 25_000_000
FAST_PERIOD_NS = 15_000_000


class FrameGrid:
    """Frames since tracking was started, on the device's own clock. The counter runs from
    power-up, or from a start that sets it to zero."""

    def __init__(self, clock: DeviceClock) -> None:
        self._clock = clock
        self._zero_ns = self._start_ns = 0
        self._offset_ticks = 0
        self.period_ns = NORMAL_PERIOD_NS

    @property
    def is_fast(self) -> bool:
        """66 Hz instead of 40 Hz."""
        return self.period_ns == FAST_PERIOD_NS

    def power_up(self, t_ns: int) -> None:
        """The counter starts anew. t_ns: host time."""
        self._zero_ns = self._clock.device_ns(t_ns)
        self._offset_ticks = 0

    def start(self, t_ns: int, fast: bool, from_zero: bool) -> None:
        """Tracking starts; the first frame comes a period later. t_ns: host time."""
        self._start_ns = self._clock.device_ns(t_ns)
        self.period_ns = FAST_PERIOD_NS if fast else NORMAL_PERIOD_NS
        if from_zero:
            self.power_up(t_ns)

    def jump(self, ticks: int) -> None:
        """The counter jumps."""
        self._offset_ticks += ticks

    def host_ns(self, index: int) -> int:
        """Host time of frame `index` since the start, from 1."""
        return self._clock.host_ns(self._start_ns + index * self.period_ns)

    def number(self, index: int) -> int:
        """Its number."""
        since_zero_ns = self._start_ns + index * self.period_ns - self._zero_ns
        return (since_zero_ns * TICKS_PER_S // 10**9 + self._offset_ticks) % FRAME_MODULUS
