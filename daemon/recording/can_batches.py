"""Bus traffic in batches: a recording with a message per frame would be mostly overhead."""

import struct
from collections.abc import Callable
from functools import cache
from typing import Final

from daemon.recording.channels import CAN_RECORD, RAW_CAN

_LONGEST_NS: Final = 50_000_000
_FIELDS: Final = 4
"""Of a record: time, identifier, length and data."""
_FIELDS_AT_MOST: Final = 512 * _FIELDS


class CanBatches:
    """Collects each bus' frames. A batch has its first frame's time, and is at most 50 ms long."""

    def __init__(self, write: Callable[[str, int, bytes], None]) -> None:
        """write: takes topic, monotonic time in ns and payload of a complete batch."""
        self._write = write
        self._batches: dict[str, _Batch] = {}

    def add(self, bus: str, can_id: int, data: bytes, t_ns: int) -> None:
        """Take a frame. Batches end by their frames' own times, not by a clock."""
        batch = self._batches.get(bus)
        if batch is None:
            batch = self._batches[bus] = _Batch(RAW_CAN + bus)
        fields = batch.fields
        if not fields:
            batch.begin(t_ns)
        elif t_ns >= batch.ends_ns or len(fields) >= _FIELDS_AT_MOST:
            self._end(batch)
            batch.begin(t_ns)
        fields += (t_ns, can_id, len(data), data)

    def flush(self) -> None:
        """End all batches."""
        for batch in self._batches.values():
            if batch.fields:
                self._end(batch)

    def _end(self, batch: "_Batch") -> None:
        fields = batch.fields
        payload = _records(len(fields) // _FIELDS).pack(*fields)
        fields.clear()
        self._write(batch.topic, batch.first_ns, payload)


class _Batch:
    """fields: of all records, one after the other. Packed together they cost half."""

    __slots__ = ("ends_ns", "fields", "first_ns", "topic")

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.fields: list[int | bytes] = []
        self.first_ns = self.ends_ns = 0

    def begin(self, t_ns: int) -> None:
        """The first frame comes."""
        self.first_ns, self.ends_ns = t_ns, t_ns + _LONGEST_NS


@cache
def _records(count: int) -> struct.Struct:
    """So many records in a row; `count` is never large."""
    return struct.Struct("<" + CAN_RECORD.format.lstrip("<") * count)
