"""Receive PDOs: targets from the master, applied at once or with the next SYNC."""

from collections.abc import Callable
from typing import Final

from drivers.canopen.codec.emcy import PDO_TOO_LONG, PDO_TOO_SHORT, RPDO_TIMEOUT
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.pdo import PdoLayout
from sim_backends.devices.drive.node.emergency import EmergencyProducer
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.pdo_parameters import MappingRules, PdoParameters
from sim_backends.devices.drive.node.timers import Timers

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
    ) -> None:
        self.parameters = PdoParameters(objects, offset, True, rules, on_change)
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


def _is_plain(entry: Entry) -> bool:
    described = entry.description
    return entry.check is None and described.low is None and described.high is None
