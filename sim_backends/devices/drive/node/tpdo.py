"""Transmit PDOs: the drive's state, sampled at SYNC, on events, or on request."""

from collections.abc import Callable
from typing import Final

from drivers.canopen.codec.pdo import HIGHEST_SYNCHRONOUS_TYPE, PdoLayout, TransmissionType
from sim_backends.devices.can.port import Port
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary
from sim_backends.devices.drive.node.pdo_parameters import MappingRules, PdoParameters
from sim_backends.devices.drive.node.timers import Timers

_NOTHING: Final = PdoLayout(())


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
