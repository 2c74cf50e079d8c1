"""The emulated tracker on a wire within this process: for virtual time, with true breaks."""

import asyncio
import errno

import numpy as np

from drivers.byte_stream import ByteReceiver, ByteStream, StreamError, StreamOpener
from drivers.clock import Clock
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.devices.aurora.wire import heard
from sim_backends.devices.device import Pump

_OPENING_BAUD_RATE = 9600
_BREAK_S = 0.3


def aurora_stream_opener(device: EmulatedAurora, clock: Clock) -> StreamOpener:
    """Opens the line to the device; one client at a time, as on a real port."""
    wire = _Wire(device, clock)

    async def open_stream(receiver: ByteReceiver) -> ByteStream:
        return wire.open(receiver)

    return open_stream


class _Wire:
    """The cable and its plug."""

    def __init__(self, device: EmulatedAurora, clock: Clock) -> None:
        self.device = device
        self.clock = clock
        self.pump: Pump | None = None
        self.client: _Stream | None = None
        self._random = np.random.default_rng(0)
        self._plugged_in = True
        device.port.output = self._carry
        device.on_hang_up = self._unplug
        device.on_injected = self.touch

    def open(self, receiver: ByteReceiver) -> "_Stream":
        if not self._plugged_in:
            raise StreamError(errno.ENOENT, "the emulated port is unplugged", "wait")
        if self.client is not None:
            raise StreamError(errno.EBUSY, "the emulated port is in use", "end the other client")
        if self.pump is None:
            self.pump = Pump(self.device, self.clock)
        self.client = _Stream(self, receiver)
        return self.client

    def touch(self) -> None:
        if self.pump is not None:
            self.pump.touch()

    def _carry(self, data: bytes, baud_rate: int) -> None:
        if self.client is not None:
            audible = heard(data, baud_rate, self.client.baud_rate, self._random)
            self.client.receiver.bytes_received(audible, self.clock.now_ns())

    def _unplug(self, duration_s: float) -> None:
        self._plugged_in = False
        asyncio.get_running_loop().call_later(duration_s, self._plug_in)
        client, self.client = self.client, None
        if client is not None:
            client.receiver.stream_lost(OSError(errno.EIO, "the emulated port was unplugged"))

    def _plug_in(self) -> None:
        self._plugged_in = True


class _Stream:
    """ByteStream of one client."""

    def __init__(self, wire: _Wire, receiver: ByteReceiver) -> None:
        self._wire = wire
        self.receiver = receiver
        self.baud_rate = _OPENING_BAUD_RATE

    def write(self, data: bytes) -> None:
        if self._wire.client is self:
            self._wire.device.receive(data, self.baud_rate, self._wire.clock.now_ns())
            self._wire.touch()

    def set_baud_rate(self, baud_rate: int) -> None:
        self.baud_rate = baud_rate

    def discard_input(self) -> None:
        """Nothing waits anywhere: bytes are handed over when they come."""

    async def send_break(self) -> None:
        if self._wire.client is self:
            self._wire.device.line_break(self._wire.clock.now_ns())
            self._wire.touch()
        await asyncio.sleep(_BREAK_S)

    def close(self) -> None:
        if self._wire.client is self:
            self._wire.client = None
