"""A node's CAN controller: its transmit queue, its error counters, and what it listens to."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from heapq import heappush
from typing import Final, Protocol

from sim_backends.devices.can.events import EventQueue

# How much the bus carries.


@dataclass(frozen=True)
class BusStatistics:
    """What the bus has seen since it began."""

    t_ns: int
    frames: int
    error_frames: int
    busy_ns: int

    def load_since(self, earlier: "BusStatistics") -> float:
        """Share of the time since `earlier` in which the bus was busy, 0 to 1."""
        return (self.busy_ns - earlier.busy_ns) / max(1, self.t_ns - earlier.t_ns)


Frame = tuple[int, bytes]
"""`(can_id, data)`: what a node sends."""

FrameHandler = Callable[[int, bytes, int], None]
"""`(can_id, data, t_ns)`: a frame has come in; its last bit was on the bus at `t_ns`."""


class ControllerState(IntEnum):
    """Fault confinement (ISO 11898-1, 12): how much a controller trusts itself."""

    ACTIVE = 0
    WARNING = 1
    PASSIVE = 2
    OFF = 3


WARNING_ERRORS: Final = 96
PASSIVE_ERRORS: Final = 128
OFF_ERRORS: Final = 256

_MAX_LATE_FRAMES: Final = 4096

StateHandler = Callable[[ControllerState, int], None]
"""`(state, t_ns)`: the controller's state has changed."""


class Wire(Protocol):
    """What a port needs of the bus that it is on."""

    now_ns: int
    queue: EventQueue

    def offer(self, port: "Port", can_id: int, data: bytes) -> None:
        """Let a frame compete for the bus."""
        ...

    def flush(self, port: "Port") -> None:
        """Forget what the port still has to send."""
        ...

    def rebuild(self) -> None:
        """Work out anew who hears what."""
        ...


class Port:
    """Where a node meets the bus. Made by `CanBus.attach`."""

    def __init__(self, bus: Wire, name: str, capacity: int, mailboxes: bool) -> None:
        self._bus = bus
        self.name = name
        self.capacity = capacity
        self.fifo: deque[Frame] | None = None if mailboxes else deque()
        """Frames behind the one that competes for the bus; None where all of them compete."""
        self.pending = 0
        self.competing = False
        """Whether a frame of a fifo competes for the bus or is on it; those behind it wait."""
        self.on_bus = True
        """Powered, connected and not bus-off: hears frames and acknowledges them."""
        self.wrong_bit_rate = False
        """Its bits are not the others': hears nothing, and nothing that it sends is understood."""
        self.listens_only = False
        """Does not acknowledge, and never sends."""
        self.blocked = False
        """Has refused a frame since there was last space."""
        self.state = ControllerState.ACTIVE
        self.transmit_errors = self.receive_errors = 0
        self.least_transmit_errors = 0
        """What the transmit error counter does not fall below, by a fault."""
        self.restart_after_ns: int | None = None
        """Restarts by itself so long after bus-off; None: only when told."""
        self.restart_timer = bus.queue.timer(lambda _: self.restart())
        self.handlers: Mapping[int, FrameHandler] = {}
        self.listener: FrameHandler | None = None
        self.on_state: StateHandler | None = None
        self.on_space: Callable[[int], None] | None = None
        self.sent = 0
        self.refused = 0
        """Frames that found the transmit queue full, or the controller off the bus."""
        self.receive_delay_ns = 0
        """How late frames come out of an adapter, by a fault."""
        self._late_frames = 0
        self.received_lost = 0
        """Frames that were on the bus but never reached the node."""

    def send(self, can_id: int, data: bytes, t_ns: int) -> bool:
        """Queue a frame that is ready at `t_ns`, now or later. False: the queue has no room."""
        if self.pending >= self.capacity or not self.on_bus:
            self.refused += 1
            self.blocked = True
            return False
        self.pending += 1
        bus = self._bus
        if t_ns <= bus.now_ns:
            bus.offer(self, can_id, data)
        else:
            queue = bus.queue
            queue.number = number = queue.number + 1
            heappush(queue.heap, (t_ns, number, None, self, can_id, data))
        return True

    def send_all(self, frames: Sequence[Frame], t_ns: int) -> None:
        """The same for several at once, in order."""
        bus, fifo = self._bus, self.fifo
        free = self.capacity - self.pending if self.on_bus else 0
        if fifo is None or t_ns > bus.now_ns or not 0 < len(frames) <= free:
            for can_id, data in frames:
                self.send(can_id, data, t_ns)
            return
        self.pending += len(frames)
        fifo.extend(frames)
        if not self.competing:
            can_id, data = fifo.popleft()
            bus.offer(self, can_id, data)

    def listen(
        self, handlers: Mapping[int, FrameHandler], everything: FrameHandler | None = None
    ) -> None:
        """Hear from now on the identifiers of `handlers`, each its own, or everything.

        Keys carry the kernel's flags: a handler of remote frames has REMOTE_FLAG in its key.
        """
        self.handlers = handlers
        self.listener = everything
        self._bus.rebuild()

    @property
    def full(self) -> bool:
        """Whether the transmit queue has no room; `on_space` tells when it has again."""
        if self.pending < self.capacity:
            return False
        self.blocked = True
        return True

    def deliver_late(self, can_id: int, data: bytes, t_ns: int) -> None:
        """Hand a frame to the listener after `receive_delay_ns`."""
        if self._late_frames >= _MAX_LATE_FRAMES:
            self.received_lost += 1
            return
        self._late_frames += 1
        late = _LateFrame(self, can_id, data)
        queue = self._bus.queue
        queue.number += 1
        heappush(queue.heap, (t_ns + self.receive_delay_ns, queue.number, late))

    def late_frame_due(self, can_id: int, data: bytes, t_ns: int) -> None:
        """A frame that was delivered late is out."""
        self._late_frames -= 1
        if self.listener is not None and self.on_bus:
            self.listener(can_id, data, t_ns)

    def connect(self, on_bus: bool) -> None:
        """Come onto the bus with clean counters, or leave it; frames not sent yet are forgotten."""
        self.on_bus = on_bus
        self.restart_timer.cancel()
        self.transmit_errors = self.receive_errors = 0
        self.state = ControllerState.ACTIVE
        self._bus.flush(self)
        self._bus.rebuild()

    def restart(self) -> None:
        """Come back from bus-off."""
        if self.state is ControllerState.OFF:
            self.connect(True)
            if self.on_state is not None:
                self.on_state(ControllerState.ACTIVE, self._bus.now_ns)

    def count_errors(self, transmit: int = 0, receive: int = 0) -> None:
        """Change the error counters, and the state with them (ISO 11898-1, 12.1.4)."""
        self.transmit_errors = max(self.least_transmit_errors, self.transmit_errors + transmit)
        self.receive_errors = min(max(0, self.receive_errors + receive), PASSIVE_ERRORS)
        worst = max(self.transmit_errors, self.receive_errors)
        if worst < WARNING_ERRORS:
            state = ControllerState.ACTIVE
        elif worst < PASSIVE_ERRORS:
            state = ControllerState.WARNING
        elif worst < OFF_ERRORS:
            state = ControllerState.PASSIVE
        else:
            state = ControllerState.OFF
        if state is not self.state:
            self._change_state(state)

    def _change_state(self, state: ControllerState) -> None:
        self.state = state
        now_ns = self._bus.now_ns
        if state is ControllerState.OFF:
            self.on_bus = False
            self._bus.flush(self)
            self._bus.rebuild()
            if self.restart_after_ns is not None:
                self.restart_timer.set(now_ns + self.restart_after_ns)
        if self.on_state is not None:
            self.on_state(state, now_ns)


class _LateFrame:
    """A frame on its way out of a slow adapter."""

    __slots__ = ("_can_id", "_data", "_port")

    def __init__(self, port: Port, can_id: int, data: bytes) -> None:
        self._port = port
        self._can_id = can_id
        self._data = data

    def fire(self, t_ns: int) -> None:
        self._port.late_frame_due(self._can_id, self._data, t_ns)


# What every way into the bus from outside has in common.


class Adapter(Protocol):
    """An adapter: what can be set up and down, and pulled out."""

    def ports(self) -> Iterable[Port]:
        """The controllers behind it."""
        ...

    def set_up(self, up: bool) -> None:
        """The interface has been set up or down."""
        ...

    def set_plugged(self, plugged: bool) -> None:
        """The adapter has been plugged in or pulled out."""
        ...
