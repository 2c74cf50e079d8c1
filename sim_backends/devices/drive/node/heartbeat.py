"""Heartbeats (CiA 301, 7.2.8.3): the drive's own, the masters' it watches, and node guarding."""

from collections.abc import Callable

from drivers.canopen.codec.nmt import NmtState, encode_heartbeat
from sim_backends.devices.can.events import Timer
from sim_backends.devices.drive.node.timers import Timers


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
