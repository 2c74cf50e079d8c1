"""The NMT slave (CiA 301, 7.3.2): which state the node is in, and what the master makes of it."""

from collections.abc import Callable
from typing import Final

from drivers.canopen.codec.cob_ids import ALL_NODES
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import NmtCommand, NmtState, decode_nmt_command

INITIALISING: Final = NmtState.BOOT_UP
"""While the node boots; the boot-up message is sent on leaving it."""

_STATE_AFTER: Final = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}


class NmtSlave:
    """on_change(old, t_ns): the state is another one now. on_reset(application, t_ns): restart,
    the whole application or its communication only."""

    def __init__(
        self,
        node_id: int,
        on_change: Callable[[NmtState, int], None],
        on_reset: Callable[[bool, int], None],
    ) -> None:
        self._node_id = node_id
        self._on_change = on_change
        self._on_reset = on_reset
        self.state = INITIALISING

    def received(self, _can_id: int, data: bytes, t_ns: int) -> None:
        """An NMT command was on the bus."""
        try:
            command, node = decode_nmt_command(data)
        except CodecError:
            return
        if node not in (ALL_NODES, self._node_id):
            return
        if command in _STATE_AFTER:
            self.enter(_STATE_AFTER[command], t_ns)
        else:
            self._on_reset(command is NmtCommand.RESET_NODE, t_ns)

    def enter(self, state: NmtState, t_ns: int) -> None:
        """Go to another state."""
        old, self.state = self.state, state
        if old is not state:
            self._on_change(old, t_ns)
