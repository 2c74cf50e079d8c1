"""The drive's object dictionary: values with types, access rights and limits, and their hooks."""

from collections.abc import Callable, Mapping
from typing import Final

from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType, Value, decode_value, encode_value
from sim_backends.devices.drive.node.eds import DeviceDescription, ObjectDescription

MAX_OBJECT_BYTES: Final = 1024

Key = tuple[int, int]
"""Index and sub-index."""

_COMMUNICATION: Final = range(0x1000, 0x2000)


class SdoAbortError(Exception):
    """An access that the drive refuses."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(code.name)
        self.code = code


class Entry:
    """One object. What belongs to it hooks itself in.

    on_read(t_ns): the value now, where it is not simply kept here. check(value): raises
    SdoAbortError where the value must not be written. on_write(t_ns): it has been.
    """

    __slots__ = ("check", "default", "description", "on_read", "on_write", "value")

    def __init__(self, description: ObjectDescription, default: Value) -> None:
        self.description = description
        self.default = default
        self.value = default
        self.on_read: Callable[[int], int] | None = None
        self.check: Callable[[int], None] | None = None
        self.on_write: Callable[[int], None] | None = None

    @property
    def number(self) -> int:
        """The value of an object that is a number."""
        return self.value  # type: ignore[return-value] # asked for in every cycle

    def deliver(self, value: int) -> None:
        """Leave the factory with another value than the EDS says."""
        self.default = self.value = value

    def read(self, t_ns: int) -> Value:
        """The value now."""
        return self.value if self.on_read is None else self.on_read(t_ns)

    def accept(self, value: int) -> None:
        """Raises SdoAbortError where the drive refuses this value."""
        described = self.description
        if described.high is not None and value > described.high:
            raise SdoAbortError(AbortCode.VALUE_TOO_HIGH)
        if described.low is not None and value < described.low:
            raise SdoAbortError(AbortCode.VALUE_TOO_LOW)
        if self.check is not None:
            self.check(value)

    def write(self, value: Value, t_ns: int) -> None:
        """Change the value. Raises SdoAbortError where the drive refuses it."""
        if isinstance(value, int):
            self.accept(value)
        self.value = value
        if self.on_write is not None:
            self.on_write(t_ns)


class ObjectDictionary:
    """All objects of a drive."""

    def __init__(self, device: DeviceDescription, node_id: int) -> None:
        self.dummies = device.dummies
        self._node_id = node_id
        self._entries = {
            (described.index, described.subindex): Entry(described, self._default(described))
            for described in device.objects
        }
        self._indices = {index for index, _ in self._entries}

    def __contains__(self, key: Key) -> bool:
        return key in self._entries

    def indices(self, within: range) -> list[int]:
        """All indices in a range, in order."""
        return sorted(index for index in self._indices if index in within)

    def look_up(self, index: int, subindex: int) -> Entry:
        """The object that a master means. Raises SdoAbortError where there is none."""
        entry = self._entries.get((index, subindex))
        if entry is None:
            missing_index = index not in self._indices
            raise SdoAbortError(AbortCode.NO_OBJECT if missing_index else AbortCode.NO_SUBINDEX)
        return entry

    def own(self, index: int, subindex: int, data_type: DataType, default: int = 0) -> Entry:
        """The object for the drive's own use; one that no master sees where the EDS has none."""
        entry = self._entries.get((index, subindex))
        if entry is not None and entry.description.data_type.size is not None:
            return entry
        hidden = ObjectDescription(
            index, subindex, "", data_type, False, False, False, None, None, default, False
        )
        return Entry(hidden, default)

    def show(
        self, index: int, subindex: int, data_type: DataType, read: Callable[[int], int]
    ) -> None:
        """Let a master read what `read(t_ns)` gives, wrapped where the EDS has another type."""
        entry = self.own(index, subindex, data_type)
        shown = entry.description.data_type
        entry.on_read = read if shown is data_type else lambda t_ns: _wrapped(shown, read(t_ns))

    def upload(self, index: int, subindex: int, t_ns: int) -> bytes:
        """What a master reads. Raises SdoAbortError."""
        entry = self.look_up(index, subindex)
        if not entry.description.readable:
            raise SdoAbortError(AbortCode.WRITE_ONLY)
        return encode_value(entry.description.data_type, entry.read(t_ns))

    def writable(self, index: int, subindex: int) -> Entry:
        """The object that a master wants to write. Raises SdoAbortError."""
        entry = self.look_up(index, subindex)
        if not entry.description.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        return entry

    def download(self, index: int, subindex: int, data: bytes, sized: bool, t_ns: int) -> None:
        """Write what a master has sent; not `sized`: of 4 bytes as many as the object has.

        Raises SdoAbortError.
        """
        entry = self.writable(index, subindex)
        data_type = entry.description.data_type
        size = data_type.size
        if size is None:
            if len(data) > MAX_OBJECT_BYTES:
                raise SdoAbortError(AbortCode.TOO_LONG)
        elif not sized and len(data) >= size:
            data = data[:size]
        elif len(data) != size:
            raise SdoAbortError(AbortCode.TOO_LONG if len(data) > size else AbortCode.TOO_SHORT)
        entry.write(decode_value(data_type, data), t_ns)

    def settings(self, communication: bool) -> dict[Key, Value]:
        """The values that a master can write, of the communication profile or of all else."""
        return {
            key: entry.value
            for key, entry in self._entries.items()
            if entry.description.writable and (key[0] in _COMMUNICATION) == communication
        }

    def reset(self, communication: bool, stored: Mapping[Key, Value]) -> None:
        """As after power-on: `stored` values, and defaults. No hook is called."""
        for key, entry in self._entries.items():
            if (key[0] in _COMMUNICATION) == communication:
                entry.value = stored.get(key, entry.default)

    def _default(self, described: ObjectDescription) -> Value:
        default = described.default
        if described.plus_node_id and isinstance(default, int):
            return default + self._node_id
        return default


def _wrapped(data_type: DataType, value: int) -> int:
    """As a drive with a smaller counter would show it."""
    bits = 8 * (data_type.size or 0)
    value &= (1 << bits) - 1
    return value - (1 << bits) if data_type.signed and value >> bits - 1 else value
