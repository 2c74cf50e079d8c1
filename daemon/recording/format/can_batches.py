"""Bus traffic in batches: a recording with a message per frame would be mostly overhead."""

import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Final

from daemon.recording.format.channels import CAN_RECORD, RAW_CAN

Write = Callable[[str, int, bytes], None]
"""Takes topic, monotonic time in ns and payload of a complete batch."""

_LONGEST_NS: Final = 50_000_000
_FIELDS: Final = 4
"""Of a record: time, identifier, length and data."""
_FIELDS_AT_MOST: Final = 512 * _FIELDS


class BusBatches:
    """Collects the frames of one bus, as its `TrafficTap`.

    A batch has its first frame's time, and is at most 50 ms long. Batches end by their frames' own
    times, not by a clock.
    """

    __slots__ = ("_ends_ns", "_fields", "_first_ns", "_topic", "_write", "taking")

    def __init__(self, bus: str, write: Write) -> None:
        self.taking = False
        """Otherwise frames pass by."""
        self._topic = RAW_CAN + bus
        self._write = write
        # Of all records, one after the other: packed together they cost half.
        self._fields: list[int | bytes] = []
        self._first_ns = self._ends_ns = 0

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        if self.taking:
            if t_ns >= self._ends_ns or len(self._fields) >= _FIELDS_AT_MOST:
                self._begin(t_ns)
            self._fields += (t_ns, can_id, len(data), data)

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        if self.taking:
            fields = self._fields
            for can_id, data in frames:
                if t_ns >= self._ends_ns or len(fields) >= _FIELDS_AT_MOST:
                    self._begin(t_ns)
                fields += (t_ns, can_id, len(data), data)

    def flush(self) -> None:
        """End the batch."""
        fields = self._fields
        if fields:
            payload = _records(len(fields) // _FIELDS).pack(*fields)
            self.clear()
            self._write(self._topic, self._first_ns, payload)

    def clear(self) -> None:
        """Forget what is in the batch."""
        self._fields.clear()
        self._ends_ns = 0

    def _begin(self, t_ns: int) -> None:
        self.flush()
        self._first_ns, self._ends_ns = t_ns, t_ns + _LONGEST_NS


class CanBatches:
    """The batches of all buses, for the recordings that a recorder makes one after the other."""

    def __init__(self, write: Write) -> None:
        self._write = write
        self._buses: dict[str, BusBatches] = {}
        self._taking = False

    def of(self, bus: str) -> BusBatches:
        """Those of one bus; the same ones whenever they are asked for."""
        batches = self._buses.get(bus)
        if batches is None:
            batches = self._buses[bus] = BusBatches(bus, self._write)
            batches.taking = self._taking
        return batches

    def begin(self) -> None:
        """Take frames from now on."""
        self._take(True)

    def end(self) -> None:
        """Take no more, and forget what was not flushed."""
        self._take(False)

    def flush(self) -> None:
        """End all batches."""
        for batches in self._buses.values():
            batches.flush()

    def _take(self, taking: bool) -> None:
        self._taking = taking
        for batches in self._buses.values():
            batches.taking = taking
            batches.clear()


@cache
def _records(count: int) -> struct.Struct:
    """So many records in a row; `count` is never large."""
    return struct.Struct("<" + CAN_RECORD.format.lstrip("<") * count)
