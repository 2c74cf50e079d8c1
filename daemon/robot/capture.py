"""Writes a bus' traffic to a capture file that Wireshark and tshark read."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from drivers.can.capture import capture_header, capture_record
from drivers.clock import WallClock

_BUFFER_BYTES: Final = 1 << 16


class CanCapture:
    """One bus, one file. A `TrafficTap`; frames are in the file after `close`."""

    def __init__(self, path: Path, clock: WallClock) -> None:
        """Raises OSError."""
        self._file = path.open("wb", buffering=_BUFFER_BYTES)
        self._file.write(capture_header())
        # Frames are dated by the monotonic clock; the file's readers want the date.
        self._to_wall_ns = clock.wall_time_ns() - clock.now_ns()

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        self._file.write(capture_record(t_ns + self._to_wall_ns, can_id, data))

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        for can_id, data in frames:
            self.received(can_id, data, t_ns)

    def close(self) -> None:
        """Write what is left."""
        self._file.close()
