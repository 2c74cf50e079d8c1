"""All PDOs of a drive together: which of them are running, and what SYNC makes them do."""

from collections.abc import Callable
from typing import Final

from drivers.can.frame import REMOTE_FLAG
from drivers.canopen.codec import pdo
from drivers.canopen.codec.emcy import PDO_TOO_LONG, PDO_TOO_SHORT, RPDO_TIMEOUT
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.pdo import HIGHEST_SYNCHRONOUS_TYPE, PdoLayout, TransmissionType
from sim_backends.devices.can.port import FrameHandler, Port
from sim_backends.devices.drive.node.emergency import EmergencyProducer
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.pdo_parameters import MappingRules, PdoParameters
from sim_backends.devices.drive.node.timers import Timers

# Receive PDOs: targets from the master, applied at once or with the next SYNC.


_NOTHING: Final = PdoLayout(())


class Rpdo:
    """One receive PDO."""

    def __init__(
        self,
        objects: ObjectDictionary,
        offset: int,
        rules: MappingRules,
        timers: Timers,
        emergency: EmergencyProducer,
        on_change: Callable[[int], None],
        on_timeout: Callable[[int], None],
    ) -> None:
        """on_timeout(t_ns): none came for as long as its event timer says."""
        self.parameters = PdoParameters(objects, offset, True, rules, on_change)
        self._on_timeout = on_timeout
        self._timers = timers
        self._timer = timers.timer(self._timed_out)
        self._emergency = emergency
        self._layout = _NOTHING
        self._size = 0
        self._entries: list[Entry | None] = []
        self._plain: list[tuple[int, Entry]] = []
        """All entries with their places, where any value may be written to any of them."""
        self._hooks: list[Callable[[int], None]] = []
        self._synchronous = False
        self._deadline_ns = 0
        self._latched: bytes | None = None
        self._wrong_length = False

    def configure(self) -> None:
        """Take over the parameters as they are now."""
        mapping = self.parameters.mapping()
        self._layout = PdoLayout(mapped.field for mapped in mapping)
        self._size = self._layout.size
        self._entries = [mapped.entry for mapped in mapping]
        self._plain = [
            (place, entry)
            for place, entry in enumerate(self._entries)
            if entry is not None and _is_plain(entry)
        ]
        if len(self._plain) < len(self._entries):
            self._plain.clear()
        hooks = [e.on_write for e in self._entries if e is not None and e.on_write is not None]
        self._hooks = list(dict.fromkeys(hooks))
        self._synchronous = self.parameters.synchronous
        self._deadline_ns = self._timers.host_ns(self.parameters.event_s)
        self._latched = None

    def stop(self) -> None:
        """Outside of operational nothing is received and nothing is due."""
        self._timer.cancel()
        self._latched = None

    def received(self, _can_id: int, data: bytes, t_ns: int) -> None:
        """The PDO was on the bus."""
        wrong = len(data) != self._size
        if (wrong or self._wrong_length) and not self._length_checked(len(data), t_ns):
            return
        if self._deadline_ns:
            self._timer.set(t_ns + self._deadline_ns)
            self._emergency.clear_error(RPDO_TIMEOUT, t_ns)
        if self._synchronous:
            self._latched = data
        else:
            self._apply(data, t_ns)

    def sync(self, t_ns: int) -> None:
        """A SYNC came: what was received since the last one counts from now on."""
        if self._latched is not None:
            data, self._latched = self._latched, None
            self._apply(data, t_ns)

    def _apply(self, data: bytes, t_ns: int) -> None:
        try:
            values = self._layout.unpack(data)
        except CodecError:
            values = self._layout.unpack(data[: self._layout.size])
        if self._plain:
            for place, entry in self._plain:
                entry.value = values[place]
        else:
            self._write_checked(values)
        for hook in self._hooks:
            hook(t_ns)

    def _write_checked(self, values: tuple[int, ...]) -> None:
        """A value that a master could not write by SDO has no effect here either."""
        for entry, value in zip(self._entries, values, strict=True):
            if entry is not None:
                try:
                    entry.accept(value)
                except SdoAbortError:
                    continue
                entry.value = value

    def _length_checked(self, length: int, t_ns: int) -> bool:
        """Tell of a wrong length, once until it is right again; too long is still processed."""
        code = PDO_TOO_SHORT if length < self._layout.size else PDO_TOO_LONG
        wrong = length != self._layout.size
        if wrong and not self._wrong_length:
            self._emergency.note_error(code, t_ns)
        self._wrong_length = wrong
        return length >= self._layout.size

    def _timed_out(self, t_ns: int) -> None:
        self._emergency.raise_error(RPDO_TIMEOUT, t_ns)
        self._on_timeout(t_ns)


def _is_plain(entry: Entry) -> bool:
    described = entry.description
    return entry.check is None and described.low is None and described.high is None


# Transmit PDOs: the drive's state, sampled at SYNC, on events, or on request.


class Tpdo:
    """One transmit PDO. `delay_ns`: from SYNC until the drive has it ready."""

    def __init__(
        self,
        objects: ObjectDictionary,
        offset: int,
        rules: MappingRules,
        timers: Timers,
        port: Port,
        delay_ns: int,
        on_change: Callable[[int], None],
    ) -> None:
        self.parameters = PdoParameters(objects, offset, False, rules, on_change)
        self._timers = timers
        self._inhibit_timer = timers.timer(self._inhibit_over)
        self._event_timer = timers.timer(self._event_time_over)
        self._port = port
        self._delay_ns = delay_ns
        self._can_id = 0
        self._layout = _NOTHING
        self._readers: list[Callable[[int], int]] = []
        self._type = 0
        self._every_sync = False
        self._syncs = 0
        self._awaited_counter = 0
        self._event_due = False
        self._last_sent: bytes | None = None
        self._sampled = b""
        self.silent = False
        """By a fault."""

    @property
    def follows_events(self) -> bool:
        """Whether a change of what it carries may send it."""
        return not 0 < self._type < TransmissionType.MANUFACTURER_EVENT

    @property
    def _event_driven(self) -> bool:
        return self._type >= TransmissionType.MANUFACTURER_EVENT

    def configure(self) -> None:
        """Take over the parameters as they are now."""
        mapping = self.parameters.mapping()
        self._layout = PdoLayout(mapped.field for mapped in mapping)
        self._readers = [_reader(m.entry) for m in mapping if m.entry is not None]
        self._type = self.parameters.transmission_type
        self._can_id = self.parameters.cob_id.can_id

    def start(self, t_ns: int) -> None:
        """Operational: event-driven PDOs are sent once to begin with."""
        self._syncs = 0
        self._awaited_counter = self.parameters.sync_start
        self._every_sync = self._type == TransmissionType.EVERY_SYNC and not self._awaited_counter
        self._event_due = True
        self._last_sent = None
        if self._event_driven:
            self._send_now(t_ns)

    def stop(self) -> None:
        """No longer operational, or no longer valid."""
        self._inhibit_timer.cancel()
        self._event_timer.cancel()

    def sync(self, counter: int | None, t_ns: int) -> None:
        """A SYNC came: sample, and send if it is this PDO's turn."""
        if self._every_sync:
            data = self.sample(t_ns)
            if not self.silent:
                self._port.send(self._can_id, data, t_ns + self._delay_ns)
        elif self._type <= HIGHEST_SYNCHRONOUS_TYPE:
            if self._its_turn(counter):
                self._event_due = False
                self._send(self.sample(t_ns), t_ns + self._delay_ns)
        elif self._type == TransmissionType.REMOTE_SYNCHRONOUS:
            self._sampled = self.sample(t_ns)

    def changed(self, t_ns: int) -> None:
        """Something that it may carry has changed."""
        self._event_due = True
        if self._event_driven and not self._inhibit_timer.running:
            self._send_if_changed(t_ns)

    def requested(self, _can_id: int, _data: bytes, t_ns: int) -> None:
        """A remote frame asks for it."""
        if self._type != TransmissionType.REMOTE_SYNCHRONOUS:
            self._sampled = self.sample(t_ns)
        self._send(self._sampled, t_ns + self._delay_ns)

    def sample(self, t_ns: int) -> bytes:
        """The PDO as it is now."""
        return self._layout.pack([read(t_ns) for read in self._readers])

    def _its_turn(self, counter: int | None) -> bool:
        if self._type == TransmissionType.SYNCHRONOUS_ACYCLIC:
            return self._event_due
        if self._awaited_counter and counter is not None:
            if counter != self._awaited_counter:
                return False
            self._awaited_counter = 0
        self._syncs += 1
        if self._syncs < self._type:
            return False
        self._syncs = 0
        return True

    def _send(self, data: bytes, t_ns: int) -> None:
        if not self.silent:
            self._port.send(self._can_id, data, t_ns)

    def _send_now(self, t_ns: int) -> None:
        self._last_sent = self.sample(t_ns)
        self._send(self._last_sent, t_ns)
        if self.parameters.inhibit_s:
            self._inhibit_timer.set(t_ns + self._timers.host_ns(self.parameters.inhibit_s))
        if self.parameters.event_s:
            self._event_timer.set(t_ns + self._timers.host_ns(self.parameters.event_s))

    def _send_if_changed(self, t_ns: int) -> None:
        if self.sample(t_ns) != self._last_sent:
            self._send_now(t_ns)

    def _inhibit_over(self, t_ns: int) -> None:
        self._send_if_changed(t_ns)

    def _event_time_over(self, t_ns: int) -> None:
        self._send_now(t_ns)


def _reader(entry: Entry) -> Callable[[int], int]:
    return entry.on_read if entry.on_read is not None else lambda _: entry.number


_PDO_NUMBERS = 0x200
_TPDO_INTERVAL_NS = 12_000
"""What a drive needs longer for each further TPDO after a SYNC."""


class Pdos:
    """on_change(t_ns): which identifiers the drive listens to may have changed.

    on_timeout(t_ns): an RPDO that has a deadline did not come.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        rules: MappingRules,
        timers: Timers,
        port: Port,
        emergency: EmergencyProducer,
        delay_ns: int,
        on_change: Callable[[int], None],
        on_timeout: Callable[[int], None],
    ) -> None:
        self._on_change = on_change
        self._operational = False
        numbers = range(_PDO_NUMBERS)
        self._rpdos = [
            Rpdo(objects, offset, rules, timers, emergency, self._reconfigured, on_timeout)
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
