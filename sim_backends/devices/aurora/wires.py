"""The emulated tracker on a wire within this process: for virtual time, with true breaks."""

import asyncio
import errno
from pathlib import Path

import numpy as np

from drivers.byte_stream import ByteReceiver, ByteStream, StreamError, StreamOpener
from drivers.clock import Clock
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.devices.aurora.port import heard
from sim_backends.devices.device import Pump
from sim_backends.devices.pty import Pty

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


# The emulated tracker on a pseudo-terminal: for real clients, ours or anybody's.
#
# A pty has no break: a client that flushes at 9600 baud after a command that was not answered is
# taken to send one, which is what clients do before they break.


_BREAK_BAUD_RATE = 9600


class PtyAurora:
    """Runs the device in the running event loop until closed. `link_path` leads to the pty, also
    after it was unplugged and plugged in again."""

    def __init__(self, device: EmulatedAurora, clock: Clock, link_path: Path | None = None) -> None:
        self._device = device
        self._clock = clock
        self._link_path = link_path
        self._pump = Pump(device, clock)
        self._random = np.random.default_rng(0)
        self._loop = asyncio.get_running_loop()
        self._pty: Pty | None = None
        self._return: asyncio.TimerHandle | None = None
        device.port.output = self._send
        device.on_hang_up = self._unplug
        device.on_injected = self._pump.touch
        self._plug_in()

    @property
    def path(self) -> Path | None:
        """The pty itself; None while unplugged."""
        return None if self._pty is None else self._pty.path

    def close(self) -> None:
        """Take everything away."""
        if self._return is not None:
            self._return.cancel()
        self._pump.stop()
        self._pull()

    def _plug_in(self) -> None:
        self._pty = Pty(self._receive, self._flushed, self._link_path)

    def _unplug(self, duration_s: float) -> None:
        self._pull()
        self._return = self._loop.call_later(duration_s, self._plug_in)

    def _pull(self) -> None:
        if self._pty is not None:
            self._pty.close()
            self._pty = None

    def _receive(self, data: bytes) -> None:
        if self._pty is not None:
            self._device.receive(data, self._pty.client_baud_rate, self._clock.now_ns())
            self._pump.touch()

    def _flushed(self) -> None:
        if self._pty is None or self._pty.client_baud_rate != _BREAK_BAUD_RATE:
            return
        self._pump.touch()  # what was sent before may have arrived unseen
        if self._device.port.left_unanswered:
            self._device.line_break(self._clock.now_ns())
            self._pump.touch()

    def _send(self, data: bytes, baud_rate: int) -> None:
        if self._pty is not None:
            strict = self._device.config.strict_baud_rate
            listening_at = self._pty.client_baud_rate if strict else baud_rate
            self._pty.write(heard(data, baud_rate, listening_at, self._random))
