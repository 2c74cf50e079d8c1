"""All PDOs of a drive together: which of them are running, and what SYNC makes them do."""

from collections.abc import Callable

from drivers.can.frame import REMOTE_FLAG
from drivers.canopen.codec import pdo
from sim_backends.devices.can.port import FrameHandler, Port
from sim_backends.devices.drive.node.emergency import EmergencyProducer
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary
from sim_backends.devices.drive.node.pdo_parameters import MappingRules
from sim_backends.devices.drive.node.rpdo import Rpdo
from sim_backends.devices.drive.node.timers import Timers
from sim_backends.devices.drive.node.tpdo import Tpdo

_PDO_NUMBERS = 0x200
_TPDO_INTERVAL_NS = 12_000
"""What a drive needs longer for each further TPDO after a SYNC."""


class Pdos:
    """on_change(t_ns): which identifiers the drive listens to may have changed."""

    def __init__(
        self,
        objects: ObjectDictionary,
        rules: MappingRules,
        timers: Timers,
        port: Port,
        emergency: EmergencyProducer,
        delay_ns: int,
        on_change: Callable[[int], None],
    ) -> None:
        self._on_change = on_change
        self._operational = False
        numbers = range(_PDO_NUMBERS)
        self._rpdos = [
            Rpdo(objects, offset, rules, timers, emergency, self._reconfigured)
            for offset in numbers
            if (pdo.RPDO_COMMUNICATION + offset, 1) in objects
        ]
        self._tpdos = [
            Tpdo(
                objects,
                offset,
                rules,
                timers,
                port,
                delay_ns + place * _TPDO_INTERVAL_NS,
                self._reconfigured,
            )
            for place, offset in enumerate(
                offset for offset in numbers if (pdo.TPDO_COMMUNICATION + offset, 1) in objects
            )
        ]
        self._active_rpdos: list[Rpdo] = []
        self._active_tpdos: list[Tpdo] = []
        self._event_driven: list[Tpdo] = []

    def operate(self, operational: bool, t_ns: int) -> None:
        """PDOs run only in the NMT state operational."""
        for rpdo in self._active_rpdos:
            rpdo.stop()
        for tpdo in self._active_tpdos:
            tpdo.stop()
        self._operational = operational
        self._active_rpdos = [r for r in self._rpdos if operational and r.parameters.usable]
        self._active_tpdos = [t for t in self._tpdos if operational and t.parameters.usable]
        for rpdo in self._active_rpdos:
            rpdo.configure()
        for tpdo in self._active_tpdos:
            tpdo.configure()
            tpdo.start(t_ns)
        self._event_driven = [tpdo for tpdo in self._active_tpdos if tpdo.follows_events]

    def handlers(self) -> dict[int, FrameHandler]:
        """What is listened to, by identifier."""
        handlers: dict[int, FrameHandler] = {
            rpdo.parameters.cob_id.can_id: rpdo.received for rpdo in self._active_rpdos
        }
        for tpdo in self._active_tpdos:
            cob_id = tpdo.parameters.cob_id
            if cob_id.remote_allowed:
                handlers[cob_id.can_id | REMOTE_FLAG] = tpdo.requested
        return handlers

    def sync(self, counter: int | None, t_ns: int) -> None:
        """A SYNC: everyone samples, then what the master sent before it is applied."""
        for tpdo in self._active_tpdos:
            tpdo.sync(counter, t_ns)
        for rpdo in self._active_rpdos:
            rpdo.sync(t_ns)

    def changed(self, t_ns: int) -> None:
        """Something has happened that event-driven PDOs tell."""
        for tpdo in self._event_driven:
            tpdo.changed(t_ns)

    def silence(self, silent: bool) -> None:
        """By a fault: no TPDO leaves the drive."""
        for tpdo in self._tpdos:
            tpdo.silent = silent

    def _reconfigured(self, t_ns: int) -> None:
        if self._operational:
            self.operate(True, t_ns)
        self._on_change(t_ns)
