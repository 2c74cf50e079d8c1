"""The modelled CAN bus: who sends when, how long it takes, who hears it, and what goes wrong.

Time is simulated, in events: the bus lives when told what time it is, and all that happens on it
happens at its own time however late it is told. Two nodes that send the same identifier at once
send one after the other here; on a real bus they would destroy each other's frames.
"""

from heapq import heapify, heappop, heappush

import numpy as np

from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG, STANDARD_ID_MASK
from sim_backends.devices.can.events import NEVER_NS, EventQueue
from sim_backends.devices.can.frame_length import frame_bits, wire_bits
from sim_backends.devices.can.port import (
    Adapter,
    BusStatistics,
    ControllerState,
    FrameHandler,
    Port,
)

# Error flag of the one who noticed, the echo of the others, delimiter, interframe space.
_ERROR_FRAME_BITS = 6 + 6 + 8 + 3

_Entry = tuple[int, int, Port, int, bytes]
"""A frame that competes for the bus: the lowest goes first. Priority, number, then the frame."""


class CanBus:
    """A CAN bus. A `Device`: `advance` does all that is due, and says when it must be called next.

    slack_ns: how much later than it happened the world outside may learn of a frame, like the
    125 µs of a USB adapter. With slack the bus needs to be called less often; the times it tells
    stay exact.
    """

    def __init__(self, bit_rate_bit_s: int, seed: int = 0, slack_ns: int = 0) -> None:
        self.bit_ns = 1_000_000_000 // bit_rate_bit_s
        self.bit_rate_bit_s = bit_rate_bit_s
        self.slack_ns = slack_ns
        self.now_ns = 0
        self.queue = EventQueue()
        self.adapters: list[Adapter] = []
        self.up = True
        """Whether the interfaces of the adapters are set up."""
        self.plugged = True
        """Whether the adapters are plugged in."""
        self.random = np.random.default_rng(seed)
        self.corrupt_probability = 0.0
        self.drop_probability = 0.0
        self.nobody_acknowledges = False
        self._ports: list[Port] = []
        self._receivers: dict[int, tuple[tuple[Port, FrameHandler], ...]] = {}
        self._listeners: tuple[tuple[Port, FrameHandler], ...] = ()
        self._competing: list[_Entry] = []
        self._sending: _Entry | None = None
        self._bus_ns = NEVER_NS  # end of the frame on the bus, or start of the next
        self._stalled_since_ns: int | None = None
        self._acknowledged = False
        self._troubled = False  # whether a frame may fail, so that trouble costs only then
        self._failed = False
        self._errors_counted = False  # whether any counter is not zero
        self.advancing = False
        """Whether it is under way, so that what is done to it needs no call of its own."""
        self.standstill_ns: int | None = None
        """A longer time without `advance` means that this process was not run; None: nothing is."""
        self.advances_to_ns = 0
        """Where the `advance` that is under way will end."""
        self.has_stood_still = False
        """Whether it makes up for more than the loop can ever leave it alone."""
        self._frames = self._error_frames = self._busy_ns = 0
        frame_bits(0, b"")  # compiled now, and not when the first frame is sent

    # Nodes

    def attach(self, name: str, capacity: int, *, mailboxes: bool = False) -> Port:
        """A new node, on the bus at once.

        capacity: frames it can queue. With mailboxes they all compete for the bus, like those of
        a drive; otherwise they leave in order, like those of an operating system.
        """
        port = Port(self, name, capacity, mailboxes)
        self._ports.append(port)
        self.rebuild()
        return port

    def detach(self, port: Port) -> None:
        """The node is gone."""
        port.connect(False)
        self._ports.remove(port)
        self.rebuild()

    def rebuild(self) -> None:
        """Work out anew who hears what and whether frames can fail, after any change of these."""
        hearing = [port for port in self._ports if port.on_bus and not port.wrong_bit_rate]
        listeners = tuple(
            (port, port.deliver_late if port.receive_delay_ns else port.listener)
            for port in hearing
            if port.listener is not None
        )
        heard: dict[int, list[tuple[Port, FrameHandler]]] = {}
        for port in hearing:
            for can_id, handler in port.handlers.items():
                heard.setdefault(can_id, []).append((port, handler))
        self._listeners = listeners
        self._receivers = {can_id: (*handlers, *listeners) for can_id, handlers in heard.items()}
        talking = sum(not port.listens_only for port in hearing)
        self._acknowledged = talking > 1 and not self.nobody_acknowledges
        self._troubled = (
            not self._acknowledged
            or self.corrupt_probability > 0.0
            or any(port.wrong_bit_rate and port.on_bus for port in self._ports)
        )
        if self._acknowledged:
            self._resume()

    def statistics(self) -> BusStatistics:
        """Counters up to the last `advance`."""
        busy_ns = self._busy_ns
        if self._sending is not None:
            busy_ns -= self._bus_ns - self.now_ns
        if self._stalled_since_ns is not None:
            busy_ns += self.now_ns - self._stalled_since_ns
        return BusStatistics(self.now_ns, self._frames, self._error_frames, busy_ns)

    def set_up(self, up: bool) -> None:
        """Set all interfaces up or down."""
        self.up = up
        for adapter in tuple(self.adapters):
            adapter.set_up(up)

    def set_plugged(self, plugged: bool) -> None:
        """Plug all adapters in, or pull them out."""
        self.plugged = plugged
        for adapter in tuple(self.adapters):
            adapter.set_plugged(plugged)

    # Time

    def advance(self, t_ns: int) -> int | None:
        if not self.advancing:
            self.advancing = True
            gap_ns = t_ns - self.advances_to_ns
            self.has_stood_still = self.standstill_ns is not None and gap_ns > self.standstill_ns
            self.advances_to_ns = max(t_ns, self.advances_to_ns)
            try:
                self._run(t_ns)
            finally:
                self.advancing = False
        # Whatever nodes do while a frame is on the bus, nobody can see it before its end.
        due_ns = self._bus_ns
        if due_ns == NEVER_NS and self.queue.heap:
            due_ns = self.queue.heap[0][0]
        return None if due_ns >= NEVER_NS else due_ns + self.slack_ns

    def _run(self, until_ns: int) -> None:
        heap, competing = self.queue.heap, self._competing
        while True:
            bus_ns = self._bus_ns
            # What becomes ready at the very end of a frame still competes for the next slot.
            if heap and (t_ns := heap[0][0]) <= bus_ns:
                if t_ns > until_ns:
                    break
                entry = heappop(heap)
                if t_ns > self.now_ns:
                    self.now_ns = t_ns
                if entry[2] is None:
                    self.offer(entry[3], entry[4], entry[5])
                else:
                    entry[2].fire(t_ns)
            elif bus_ns > until_ns:
                break
            else:
                self.now_ns = bus_ns
                if self._sending is not None:
                    self._end_frame(self._sending, bus_ns)
                if not competing or self._stalled_since_ns is not None:
                    self._bus_ns = NEVER_NS
                    continue
                self._sending = _, _, port, can_id, data = heappop(competing)
                payload = int.from_bytes(data, "big", signed=True)
                duration_ns = wire_bits(can_id, len(data), payload) * self.bit_ns
                if self._troubled:
                    duration_ns = self._troubled_duration_ns(port, duration_ns)
                self._busy_ns += duration_ns
                self._bus_ns = bus_ns + duration_ns
        if until_ns > self.now_ns:
            self.now_ns = until_ns

    # Frames

    def offer(self, port: Port, can_id: int, data: bytes) -> None:
        """The frame is ready: let it compete, unless an earlier one of a fifo still does."""
        if port.competing and port.fifo is not None:
            port.fifo.append((can_id, data))
            return
        self._compete(port, can_id, data)
        port.competing = True
        if self._bus_ns == NEVER_NS and self._stalled_since_ns is None:
            self._bus_ns = self.now_ns

    def _compete(self, port: Port, can_id: int, data: bytes) -> None:
        priority = can_id << 21 if can_id <= STANDARD_ID_MASK else _arbitration_field(can_id)
        self.queue.number = number = self.queue.number + 1
        heappush(self._competing, (priority, number, port, can_id, data))

    def flush(self, port: Port) -> None:
        """Forget all frames of `port` that are not on the bus yet; one that is, is cut off."""
        port.pending = 0
        port.competing = False
        if port.fifo is not None:
            port.fifo.clear()
        self._competing[:] = [entry for entry in self._competing if entry[2] is not port]
        heapify(self._competing)
        heap = self.queue.heap
        heap[:] = [entry for entry in heap if not (entry[2] is None and entry[3] is port)]
        heapify(heap)
        if self._sending is not None and self._sending[2] is port:
            self._sending = None
            self._failed = False
            self._busy_ns -= self._bus_ns - self.now_ns
            self._bus_ns = self.now_ns
        if not self._competing:
            self._resume()
        self._tell_space(port)

    def _end_frame(self, sent: _Entry, now_ns: int) -> None:
        """The frame was on the bus: everybody else hears it."""
        self._sending = None
        if self._failed:
            self._failed = False
            self._transmission_failed(sent)
            return
        _, _, port, can_id, data = sent
        self._frames += 1
        port.sent += 1
        port.pending -= 1
        fifo = port.fifo
        if fifo:
            next_id, next_data = fifo.popleft()
            self._compete(port, next_id, next_data)
        else:
            port.competing = False
        if self._errors_counted:
            self._count_success(port)
        receivers = self._receivers.get(can_id, self._listeners)
        if self.drop_probability:
            receivers = self._those_that_hear(receivers)
        for receiver, handler in receivers:
            if receiver is not port:
                handler(can_id, data, now_ns)
        if port.blocked:
            self._tell_space(port)

    def _tell_space(self, port: Port) -> None:
        if port.blocked:
            port.blocked = False
            if port.on_space is not None:
                port.on_space(self.now_ns)

    # Trouble

    def _troubled_duration_ns(self, port: Port, duration_ns: int) -> int:
        """How long the frame lasts that now starts; decides whether it fails."""
        if port.wrong_bit_rate or self.random.random() < self.corrupt_probability:
            share = self.random.random()
        elif not self._acknowledged:
            share = 1.0
        else:
            return duration_ns
        self._failed = True
        return int(duration_ns * share) + _ERROR_FRAME_BITS * self.bit_ns

    def _those_that_hear(
        self, receivers: tuple[tuple[Port, FrameHandler], ...]
    ) -> tuple[tuple[Port, FrameHandler], ...]:
        hear = self.random.random(len(receivers)) >= self.drop_probability
        for index in np.flatnonzero(~hear):
            receivers[index][0].received_lost += 1
        return tuple(receiver for receiver, hears in zip(receivers, hear, strict=True) if hears)

    def _transmission_failed(self, entry: _Entry) -> None:
        """Error frame: everyone counts it, and the sender tries again."""
        port = entry[2]
        self._error_frames += 1
        self._errors_counted = True
        heappush(self._competing, entry)
        if self._acknowledged or port.wrong_bit_rate:
            port.count_errors(transmit=8)
            for other in self._ports:
                if other is not port and other.on_bus:
                    other.count_errors(receive=1)
        elif port.state is not ControllerState.PASSIVE:
            port.count_errors(transmit=8)
        else:
            # It goes on like this until somebody is there, but counts no further.
            self._stalled_since_ns = self.now_ns

    def _count_success(self, sender: Port) -> None:
        for port in self._ports:
            if port is sender:
                port.count_errors(transmit=-1)
            elif port.on_bus:
                port.count_errors(receive=-1)
        self._errors_counted = any(
            port.transmit_errors or port.receive_errors for port in self._ports
        )

    def _resume(self) -> None:
        """Somebody is there again, or nobody has anything to say."""
        if self._stalled_since_ns is not None:
            self._busy_ns += self.now_ns - self._stalled_since_ns
            self._stalled_since_ns = None
            self._bus_ns = self.now_ns


def _arbitration_field(can_id: int) -> int:
    """What competes for the bus, bit by bit; the lowest wins. 11 bits, then 21 more."""
    remote = 1 if can_id & REMOTE_FLAG else 0
    if can_id & EXTENDED_FLAG:
        # The substitute remote bit and the extension bit are recessive.
        base, extension = can_id >> 18 & STANDARD_ID_MASK, can_id & 0x3FFFF
        return base << 21 | 0b11 << 19 | extension << 1 | remote
    return (can_id & STANDARD_ID_MASK) << 21 | remote << 20
