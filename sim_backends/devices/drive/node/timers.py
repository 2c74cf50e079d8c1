"""The drive's timers, and its own idea of how long a second is."""

from collections.abc import Callable
from typing import Final

from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.events import Timer
from sim_backends.devices.device import DeviceClock

_GRACE_NS: Final = 20_000_000


class Timers:
    """Makes timers that can all be stopped at once, as by a loss of power."""

    def __init__(self, bus: CanBus, clock: DeviceClock) -> None:
        self._bus = bus
        self._queue = bus.queue
        self._timers: list[Timer] = []
        self._host_per_device = 1.0 / (1.0 + clock.error_ppm * 1e-6)

    def timer(self, action: Callable[[int], None]) -> Timer:
        """A timer that belongs to the drive for good."""
        timer = self._queue.timer(action)
        self._timers.append(timer)
        return timer

    def watch(self, action: Callable[[int], None]) -> Timer:
        """A timer for what does not come from outside.

        When this process itself has stood still, what was sent meanwhile may be waiting to be
        read: then there is a little more time. No real drive is starved by its neighbours.
        """

        def due(t_ns: int) -> None:
            if self._bus.has_stood_still:
                timer.set(self._bus.advances_to_ns + _GRACE_NS)
            else:
                action(t_ns)

        timer = self.timer(due)
        return timer

    def release(self, timer: Timer) -> None:
        """The timer is needed no longer."""
        timer.cancel()
        self._timers.remove(timer)

    def cancel_all(self) -> None:
        """Nothing is due any more."""
        for timer in self._timers:
            timer.cancel()

    def now_ns(self) -> int:
        """The present, as far as the bus has got."""
        return self._bus.now_ns

    def host_ns(self, device_s: float) -> int:
        """How long `device_s` seconds of the drive's clock are in host time."""
        return round(device_s * 1e9 * self._host_per_device)
