"""The drive as a CANopen node: all services of CiA 301, put together."""

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.cob_ids import ALL_NODES
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import (
    BUS_OFF_RECOVERED,
    CAN_PASSIVE,
    HEARTBEAT_LOST,
    RPDO_TIMEOUT,
)
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import NmtCommand, NmtState, decode_nmt_command, encode_heartbeat
from sim_backends.devices.can.port import ControllerState, FrameHandler, Port
from sim_backends.devices.drive.node.emergency import SHORT_EMERGENCY_BYTES, EmergencyProducer
from sim_backends.devices.drive.node.error_control import ErrorControl
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary
from sim_backends.devices.drive.node.pdo_parameters import MappingRules
from sim_backends.devices.drive.node.pdos import Pdos
from sim_backends.devices.drive.node.sdo_server import SdoServer
from sim_backends.devices.drive.node.sync import SyncConsumer
from sim_backends.devices.drive.node.timers import Timers

# The NMT slave (CiA 301, 7.3.2): which state the node is in, and what the master makes of it.


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


CONNECTION_ENDED: Final = 0x8100
"""Generic communication error: how a fault says that the master has ended the connection."""

_TALKING: Final = (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL)


class _Behaviour:
    """0x1029:1: what a communication error does to the NMT state."""

    PRE_OPERATIONAL: Final = 0
    NO_CHANGE: Final = 1
    STOPPED: Final = 2


class CommunicationEvents(Protocol):
    """What the drive is told."""

    def reset_requested(self, application: bool, t_ns: int) -> None:
        """The master resets the node, or its communication only."""
        ...

    def connection_ended(self, code: int, t_ns: int) -> None:
        """Nobody leads the axes any more: the node has left operational, or set-points do not
        come. `code` says why, as in EMCY."""
        ...

    def sync_lost(self, t_ns: int) -> None:
        """No SYNC for more than two periods."""
        ...

    def sync_late(self, late: bool, t_ns: int) -> None:
        """The last SYNC came too late, or in time."""
        ...


class CommunicationQuirks(NamedTuple):
    """Ways of a product that its node has; see `quirks.Quirks`."""

    emcy_short: bool
    guarding_excludes_heartbeat: bool
    late_sync_holds: bool
    mapping_rules: MappingRules


class Communication:
    """The node's services. sdo_delay_ns(): how long the next SDO answer takes. sync_delay_ns:
    from SYNC until the first TPDO is ready."""

    def __init__(
        self,
        objects: ObjectDictionary,
        timers: Timers,
        port: Port,
        node_id: int,
        quirks: CommunicationQuirks,
        events: CommunicationEvents,
        sdo_delay_ns: Callable[[], int],
        sync_delay_ns: int,
        sync_lost_after_periods: float,
    ) -> None:
        self._port = port
        self._node_id = node_id
        self._events = events
        self._end_code = CONNECTION_ENDED
        self._was_off = False
        self._behaviour = objects.own(0x1029, 1, DataType.UNSIGNED8)
        port.on_state = self._controller_state_changed
        self.nmt = NmtSlave(node_id, self._nmt_changed, events.reset_requested)
        self.emergency = EmergencyProducer(objects, timers, port, node_id)
        if quirks.emcy_short:
            self.emergency.bytes_sent = SHORT_EMERGENCY_BYTES
        self.error_control = ErrorControl(
            objects,
            timers,
            port,
            node_id,
            lambda: self.nmt.state,
            self._watched_changed,
            self._listen,
            exclusive=quirks.guarding_excludes_heartbeat,
        )
        self.pdos = Pdos(
            objects,
            quirks.mapping_rules,
            timers,
            port,
            self.emergency,
            sync_delay_ns,
            self._listen,
            lambda t_ns: events.connection_ended(RPDO_TIMEOUT, t_ns),
        )
        self.sync = SyncConsumer(
            objects,
            timers,
            self.emergency,
            self.pdos.sync,
            events.sync_lost,
            events.sync_late if quirks.late_sync_holds else None,
            sync_lost_after_periods,
        )
        self.sync.cob_id.on_write = self._listen
        self.sdo = SdoServer(objects, port, cob_ids.sdo_response(node_id), sdo_delay_ns)

    def boot_up(self, t_ns: int) -> None:
        """All as the objects say; the boot-up message, then pre-operational."""
        self.sync.restart()
        self.send_boot_up(t_ns)
        self.error_control.start(t_ns)
        self.nmt.enter(NmtState.PRE_OPERATIONAL, t_ns)

    def fall_silent(self, t_ns: int) -> None:
        """Nothing is heard or said from now on, as at the beginning of a reset."""
        self.nmt.enter(INITIALISING, t_ns)
        self.error_control.stop()
        self.sdo.stop()
        self.sync.restart()

    def send_boot_up(self, t_ns: int) -> None:
        """A boot loader may send one of its own."""
        data = encode_heartbeat(NmtState.BOOT_UP)
        self._port.send(cob_ids.heartbeat(self._node_id), data, t_ns)

    def _nmt_changed(self, old: NmtState, t_ns: int) -> None:
        state = self.nmt.state
        self.pdos.operate(state is NmtState.OPERATIONAL, t_ns)
        self.emergency.allow(state in _TALKING, t_ns)
        self._listen(t_ns)
        if old is NmtState.OPERATIONAL:
            self._events.connection_ended(self._end_code, t_ns)

    def _listen(self, _t_ns: int) -> None:
        """Listen to what matters in the present state, and to nothing else."""
        state = self.nmt.state
        handlers: dict[int, FrameHandler] = {}
        if state is not INITIALISING:
            handlers.update(self.error_control.handlers())
            handlers.update(self.pdos.handlers())
            if state in _TALKING:
                handlers[self.sync.cob_id.number & 0x7FF] = self.sync.received
                handlers[cob_ids.sdo_request(self._node_id)] = self.sdo.received
            handlers[cob_ids.NMT] = self.nmt.received
        self._port.listen(handlers)

    def _error(self, code: int, t_ns: int) -> None:
        """Tell of it, then do as 0x1029 says; leaving operational does the rest (0x6007)."""
        self.emergency.raise_error(code, t_ns)
        state, behaviour = self.nmt.state, self._behaviour.number
        self._end_code = code
        if behaviour == _Behaviour.STOPPED and state is not INITIALISING:
            self.nmt.enter(NmtState.STOPPED, t_ns)
        elif behaviour == _Behaviour.PRE_OPERATIONAL and state is NmtState.OPERATIONAL:
            self.nmt.enter(NmtState.PRE_OPERATIONAL, t_ns)
        self._end_code = CONNECTION_ENDED

    def _watched_changed(self, lost: bool, t_ns: int) -> None:
        if lost:
            self._error(HEARTBEAT_LOST, t_ns)
        else:
            self.emergency.clear_error(HEARTBEAT_LOST, t_ns)

    def _controller_state_changed(self, state: ControllerState, t_ns: int) -> None:
        if state is ControllerState.OFF:
            self._was_off = True
        elif self._was_off:
            self._was_off = False
            self._error(BUS_OFF_RECOVERED, t_ns)
            self.emergency.clear_error(BUS_OFF_RECOVERED, t_ns)
        elif state is ControllerState.PASSIVE:
            self.emergency.raise_error(CAN_PASSIVE, t_ns)
        else:
            self.emergency.clear_error(CAN_PASSIVE, t_ns)
