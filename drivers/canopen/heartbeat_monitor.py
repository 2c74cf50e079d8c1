"""Whether a node is alive, from its heartbeats. Timing begins with the first one."""

from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import NmtState, decode_heartbeat


class HeartbeatMonitor:
    """The heartbeats of one node."""

    def __init__(self, timeout_ns: int) -> None:
        self.state: NmtState | None = None
        """What the node last told; None while it has told nothing, or is lost."""
        self.boot_ups = 0
        self._timeout_ns = timeout_ns
        self._heard_ns = 0

    def receive(self, data: bytes, t_ns: int) -> NmtState | None:
        """A heartbeat or boot-up came. Returns the state it tells; None for nonsense."""
        try:
            state = decode_heartbeat(data).state
        except CodecError:
            return None
        self.state, self._heard_ns = state, t_ns
        if state is NmtState.BOOT_UP:
            self.boot_ups += 1
        return state

    def is_lost(self, t_ns: int) -> bool:
        """Whether a node that has been heard is heard no more."""
        return self.state is not None and t_ns - self._heard_ns > self._timeout_ns

    def forget(self) -> None:
        """Nothing heard so far counts."""
        self.state = None
