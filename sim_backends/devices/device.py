"""What every emulated device is to the loop that keeps it alive, and the clock it lives by."""

import asyncio
from dataclasses import dataclass
from typing import Protocol

from drivers.clock import Clock


class Device(Protocol):
    """An emulated device without I/O: it lives when told what time it is."""

    def advance(self, t_ns: int) -> int | None:
        """Do all that is due up to host time `t_ns`, in order.

        Returns when it must be called again at the latest; None: only after an input.
        """
        ...


@dataclass(frozen=True)
class DeviceClock:
    """A crystal of its own: some parts per million off, and started at some other moment."""

    error_ppm: float = 0.0
    started_at_ns: int = 0

    def device_ns(self, host_ns: int) -> int:
        """Device time at host time `host_ns`."""
        since = host_ns - self.started_at_ns
        return since + round(since * self.error_ppm * 1e-6)

    def host_ns(self, device_ns: int) -> int:
        """The first host time at which the device's clock shows `device_ns` or more."""
        guess = self.started_at_ns + round(device_ns / (1.0 + self.error_ppm * 1e-6))
        while self.device_ns(guess) < device_ns:
            guess += 1
        return guess


class Pump:
    """Keeps a device in step with the event loop's clock, without a task and without polling."""

    def __init__(self, device: Device, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self.awaited = True
        """Whether somebody minds when the device does what is due."""
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._due_ns: int | None = None

    def touch(self) -> None:
        """Let the device catch up with the clock: after an input, and when its own time comes."""
        due_ns = self._device.advance(self._clock.now_ns())
        if (timer := self._timer) is not None:
            if due_ns == self._due_ns and not timer.cancelled():
                return
            timer.cancel()
        self._timer = self._due_ns = None
        if due_ns is not None and self.awaited:
            wait_s = max(0, due_ns - self._clock.now_ns()) * 1e-9
            self._due_ns = due_ns
            self._timer = self._loop.call_at(self._loop.time() + wait_s, self._wake)

    def await_device(self, awaited: bool) -> None:
        """False: nobody minds when the device does what is due; the next touch is soon enough."""
        self.awaited = awaited
        self.touch()

    def stop(self) -> None:
        """Leave the device alone from now on."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._due_ns = None

    def _wake(self) -> None:
        self._timer = self._due_ns = None
        self.touch()
