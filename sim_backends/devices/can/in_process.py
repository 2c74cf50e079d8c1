"""The bus without a socket: a link of the master's in the same process, for virtual time."""

import asyncio
import errno
import os
from collections.abc import Iterator, Sequence

from drivers.can.conditions import DOWN, QUEUE_FULL
from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG, conditions_of_error_frame
from drivers.can.link import FrameReceiver, LinkError
from drivers.clock import Clock
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.port import ControllerState, Port
from sim_backends.devices.can.socket_server import (
    DEFAULT_QUEUE_FRAMES,
    DEFAULT_RESTART_S,
    error_frame,
)
from sim_backends.devices.device import Pump

_NOT_DATA = EXTENDED_FLAG | REMOTE_FLAG


class InProcessLink:
    """A `CanLink` that is a node of its own on the modelled bus.

    `frame_received` is told when a frame's last bit was on the bus. Raises LinkError while the
    adapter is pulled out.
    """

    def __init__(
        self,
        bus: CanBus,
        pump: Pump,
        clock: Clock,
        receiver: FrameReceiver,
        *,
        queue_frames: int = DEFAULT_QUEUE_FRAMES,
        restart_s: float | None = DEFAULT_RESTART_S,
    ) -> None:
        if not bus.plugged:
            raise LinkError("the CAN adapter is not there", "plug it in")
        self._bus = bus
        self._pump = pump
        self._clock = clock
        self._receiver = receiver
        self._full = self._was_off = self._touch_due = False
        self._open = True
        self._loop = asyncio.get_running_loop()
        self._port = bus.attach("master", queue_frames)
        self._port.restart_after_ns = None if restart_s is None else round(restart_s * 1e9)
        self._port.on_state = self._state_changed
        self._port.listen({}, self._frame)
        self._port.connect(bus.up)
        bus.adapters.append(self)
        pump.touch()

    def send(self, can_id: int, data: bytes) -> bool:
        if not self._open or not self._bus.up:
            return False
        port = self._port
        if port.state is ControllerState.OFF:
            return True  # the kernel takes such frames too, and drops them
        if port.full:
            self._pump.touch()  # the bus may have sent some by now
            if port.full:
                self._tell_full(True)
                return False
        port.send(can_id, data, self._clock.now_ns())
        if self._pump.awaited and not self._touch_due and not self._bus.advancing:
            # Once for all frames that are sent in this turn of the loop.
            self._touch_due = True
            self._loop.call_soon(self._touch)
        if self._full:
            self._tell_full(False)
        return True

    def send_all(self, frames: Sequence[tuple[int, bytes]]) -> int:
        port = self._port
        if self._pump.awaited or self._full or port.capacity - port.pending < len(frames):
            return self._send_one_by_one(frames)
        # The ordinary cycle: there is room for all, and nobody waits for them.
        if not self._open or not self._bus.up:
            return 0
        if port.state is not ControllerState.OFF:
            port.send_all(frames, self._clock.now_ns())
        return len(frames)

    def read_in_cycle(self, on: bool) -> None:
        self._pump.await_device(not on)

    def drain(self) -> None:
        self._pump.touch()

    def close(self) -> None:
        if self._open:
            self._open = False
            self._pump.await_device(True)
            self._bus.adapters.remove(self)
            self._bus.detach(self._port)
            self._pump.touch()

    # As an adapter

    def ports(self) -> Iterator[Port]:
        return iter((self._port,))

    def set_up(self, up: bool) -> None:
        self._port.connect(up)
        self._receiver.condition_seen(DOWN, not up, "" if up else "ENETDOWN")

    def set_plugged(self, plugged: bool) -> None:
        if not plugged:
            self.close()
            self._receiver.link_lost(OSError(errno.ENODEV, os.strerror(errno.ENODEV)))

    def _send_one_by_one(self, frames: Sequence[tuple[int, bytes]]) -> int:
        for taken, (can_id, data) in enumerate(frames):
            if not self.send(can_id, data):
                return taken
        return len(frames)

    def _touch(self) -> None:
        self._touch_due = False
        self._pump.touch()

    def _frame(self, can_id: int, data: bytes, t_ns: int) -> None:
        if not can_id & _NOT_DATA:
            self._receiver.frame_received(can_id, data, t_ns)

    def _state_changed(self, state: ControllerState, _t_ns: int) -> None:
        can_id, data = error_frame(self._port, self._was_off)
        self._was_off = state is ControllerState.OFF
        for condition, present, detail in conditions_of_error_frame(can_id, data):
            self._receiver.condition_seen(condition, present, detail)

    def _tell_full(self, full: bool) -> None:
        if full != self._full:
            self._full = full
            self._receiver.condition_seen(QUEUE_FULL, full, "ENOBUFS" if full else "")
