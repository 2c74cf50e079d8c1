"""Bus traffic in batches: a recording with a message per frame would be mostly overhead."""

from collections.abc import Callable
from typing import Final

from daemon.recording.channels import CAN_RECORD, RAW_CAN

_LONGEST_NS: Final = 50_000_000
_RECORDS_AT_MOST: Final = 512


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
        elif batch.records and t_ns - batch.first_ns >= _LONGEST_NS:
            self._end(batch)
        if not batch.records:
            batch.first_ns = t_ns
        batch.records += CAN_RECORD.pack(t_ns, can_id, len(data), data)
        if len(batch.records) >= _RECORDS_AT_MOST * CAN_RECORD.size:
            self._end(batch)

    def flush(self) -> None:
        """End all batches."""
        for batch in self._batches.values():
            if batch.records:
                self._end(batch)

    def _end(self, batch: "_Batch") -> None:
        payload = bytes(batch.records)
        batch.records.clear()
        self._write(batch.topic, batch.first_ns, payload)


class _Batch:
    __slots__ = ("first_ns", "records", "topic")

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.records = bytearray()
        self.first_ns = 0
