"""Error control (CiA 301, 7.2.8.3): who is watched, by whom, and the objects that say so."""

from collections.abc import Callable
from functools import partial

from drivers.can.frame import REMOTE_FLAG
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.nmt import NmtState, encode_heartbeat
from sim_backends.devices.can.events import Timer
from sim_backends.devices.can.port import FrameHandler, Port
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.timers import Timers

# Heartbeats (CiA 301, 7.2.8.3): the drive's own, the masters' it watches, and node guarding.


class HeartbeatProducer:
    """Sends the NMT state every `period_ns`; 0: never. send(data, t_ns)."""

    def __init__(
        self,
        timers: Timers,
        state: Callable[[], NmtState],
        send: Callable[[bytes, int], None],
    ) -> None:
        self._timer = timers.timer(self._beat)
        self._state = state
        self._send = send
        self._period_ns = 0
        self.silent = False
        """By a fault."""

    def start(self, period_ns: int, t_ns: int) -> None:
        """Beat every `period_ns` from now on."""
        self._period_ns = period_ns
        if period_ns:
            self._timer.set(t_ns + period_ns)
        else:
            self._timer.cancel()

    def stop(self) -> None:
        """Beat no more."""
        self._timer.cancel()

    def _beat(self, t_ns: int) -> None:
        self._timer.set(t_ns + self._period_ns)
        if not self.silent:
            self._send(encode_heartbeat(self._state()), t_ns)


class HeartbeatWatch:
    """Watches one other node, from its first heartbeat on.

    on_change(lost, t_ns): it has not been heard for too long, or is heard again.
    """

    def __init__(
        self,
        timers: Timers,
        node: int,
        timeout_ns: int,
        on_change: Callable[[bool, int], None],
    ) -> None:
        self.node = node
        self._timeout_ns = timeout_ns
        self._on_change = on_change
        self.timer: Timer = timers.watch(self._timed_out)
        self.lost = False

    def received(self, _can_id: int, _data: bytes, t_ns: int) -> None:
        """The node is alive."""
        self.timer.set(t_ns + self._timeout_ns)
        if self.lost:
            self.lost = False
            self._on_change(False, t_ns)

    def _timed_out(self, t_ns: int) -> None:
        self.lost = True
        self._on_change(True, t_ns)


class NodeGuarding:
    """Answers the master's guarding requests, and watches that they come (life guarding).

    send(data, t_ns). on_change(lost, t_ns): as for a heartbeat watch.
    """

    def __init__(
        self,
        timers: Timers,
        state: Callable[[], NmtState],
        send: Callable[[bytes, int], None],
        on_change: Callable[[bool, int], None],
    ) -> None:
        self._timer = timers.timer(self._timed_out)
        self._state = state
        self._send = send
        self._on_change = on_change
        self._toggle = False
        self.lost = False
        self.life_time_ns = 0
        """Guard time times life time factor; 0: not watched."""

    def start(self, life_time_ns: int) -> None:
        """Begin anew, with the toggle bit at 0."""
        self._timer.cancel()
        self._toggle = self.lost = False
        self.life_time_ns = life_time_ns

    def requested(self, _can_id: int, _data: bytes, t_ns: int) -> None:
        """The master asks, by a remote frame."""
        self._send(encode_heartbeat(self._state(), self._toggle), t_ns)
        self._toggle = not self._toggle
        if self.life_time_ns:
            self._timer.set(t_ns + self.life_time_ns)
        if self.lost:
            self.lost = False
            self._on_change(False, t_ns)

    def _timed_out(self, t_ns: int) -> None:
        self.lost = True
        self._on_change(True, t_ns)


_NODE_SHIFT = 16
_MILLISECONDS = 0xFFFF
_CONSUMERS = range(1, 128)


class ErrorControl:
    """on_change(lost, t_ns): one of those it watches is lost, or none is any more.

    on_watch_change(t_ns): it listens to other nodes than before. exclusive: heartbeat and node
    guarding cannot be used together.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        timers: Timers,
        port: Port,
        node_id: int,
        state: Callable[[], NmtState],
        on_change: Callable[[bool, int], None],
        on_watch_change: Callable[[int], None],
        *,
        exclusive: bool,
    ) -> None:
        self._timers = timers
        self._can_id = cob_ids.heartbeat(node_id)
        self._on_change = on_change
        self._on_watch_change = on_watch_change
        self._watches: dict[int, HeartbeatWatch] = {}

        def send(data: bytes, t_ns: int) -> None:
            port.send(self._can_id, data, t_ns)

        self.producer = HeartbeatProducer(timers, state, send)
        self._guarding = NodeGuarding(timers, state, send, self._changed)
        self._period = objects.own(0x1017, 0, DataType.UNSIGNED16)
        self._guard_time = objects.own(0x100C, 0, DataType.UNSIGNED16)
        self._life_factor = objects.own(0x100D, 0, DataType.UNSIGNED8)
        self._consumers = [
            objects.own(0x1016, subindex, DataType.UNSIGNED32)
            for subindex in _CONSUMERS
            if (0x1016, subindex) in objects
        ]
        self._period.on_write = self._start_producer
        self._guard_time.on_write = self._life_factor.on_write = self._start_guarding
        for place, consumer in enumerate(self._consumers):
            consumer.check = partial(self._check_consumer, place)
            consumer.on_write = partial(self._consumer_written, place)
        if exclusive:
            self._period.check = lambda value: _refuse(value and self._guard_time.number)
            self._guard_time.check = lambda value: _refuse(value and self._period.number)

    @property
    def lost(self) -> bool:
        """Whether one of those it watches is lost."""
        return any(watch.lost for watch in self._watches.values()) or self._guarding.lost

    def start(self, t_ns: int) -> None:
        """Boot-up: all as the objects say."""
        self._start_producer(t_ns)
        self._start_guarding(t_ns)
        for place in range(len(self._consumers)):
            self._watch(place)

    def stop(self) -> None:
        """No power, or a reset."""
        self.producer.stop()
        self._guarding.start(0)
        for place in range(len(self._consumers)):
            self._forget(place)

    def handlers(self) -> dict[int, FrameHandler]:
        """What is listened to, by identifier."""
        handlers: dict[int, FrameHandler] = {
            cob_ids.heartbeat(watch.node): watch.received for watch in self._watches.values()
        }
        handlers[self._can_id | REMOTE_FLAG] = self._guarding.requested
        return handlers

    def _start_producer(self, t_ns: int) -> None:
        self.producer.start(self._timers.host_ns(self._period.number * 1e-3), t_ns)

    def _start_guarding(self, _t_ns: int) -> None:
        life_time_s = self._guard_time.number * self._life_factor.number * 1e-3
        self._guarding.start(self._timers.host_ns(life_time_s))

    def _consumer_written(self, place: int, t_ns: int) -> None:
        was_lost = self.lost
        self._forget(place)
        self._watch(place)
        self._on_watch_change(t_ns)
        if was_lost:
            self._changed(False, t_ns)

    def _watch(self, place: int) -> None:
        node, milliseconds = _consumer(self._consumers[place].number)
        if node and milliseconds:
            timeout_ns = self._timers.host_ns(milliseconds * 1e-3)
            self._watches[place] = HeartbeatWatch(self._timers, node, timeout_ns, self._changed)

    def _forget(self, place: int) -> None:
        if place in self._watches:
            self._timers.release(self._watches.pop(place).timer)

    def _changed(self, lost: bool, t_ns: int) -> None:
        if lost or not self.lost:
            self._on_change(lost, t_ns)

    def _check_consumer(self, place: int, value: int) -> None:
        node, milliseconds = _consumer(value)
        if value >> 24 or node > cob_ids.HIGHEST_NODE:
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
        watched = {watch.node for at, watch in self._watches.items() if at != place}
        if milliseconds and node in watched:
            raise SdoAbortError(AbortCode.PARAMETER_INCOMPATIBLE)


def _consumer(value: int) -> tuple[int, int]:
    """Node and time in ms of an entry of 0x1016."""
    return value >> _NODE_SHIFT & 0xFF, value & _MILLISECONDS


def _refuse(excluded: int) -> None:
    if excluded:
        raise SdoAbortError(AbortCode.PARAMETER_INCOMPATIBLE)
