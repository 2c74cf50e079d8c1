"""The recorder of virtual time: writes within the process, because waiting costs nothing there."""

from collections.abc import Mapping
from pathlib import Path

from daemon.messages import Message
from daemon.recording.flight_recorder import RecorderStatus, RecordingError
from daemon.recording.format.can_batches import BusBatches, CanBatches
from daemon.recording.format.channels import (
    RAW_TRACKER,
    TOPICS,
    message_time_ns,
    telemetry_payload,
    tracker_payload,
)
from daemon.recording.run_folder import RUN_FILE, free_mb
from daemon.recording.run_writer import RunWriter


class DirectRecorder:
    """The same calls give the same file, byte for byte."""

    def __init__(self) -> None:
        self._writer: RunWriter | None = None
        self._batches = CanBatches(self._write)
        self._folder: Path | None = None
        """Of the present recording, or of the last one."""
        self._status = RecorderStatus(False, None, 0, "", None, 0)
        self._free_mb: float | None = None
        self._measured_at_bytes = -1
        """So long was the file when the room on the disk was looked at."""

    async def start(
        self,
        folder: Path,
        header: Mapping[str, str],
        t_ns: int,
        wall_ns: int,
        name: str = RUN_FILE,
    ) -> None:
        if self._writer is not None:
            raise RecordingError(f"already recording in {self._writer.path.parent}")
        try:
            self._writer = RunWriter(folder / name, header, wall_ns - t_ns)
        except OSError as error:
            raise RecordingError(f"cannot record in {folder}: {error.strerror}") from error
        self._folder = folder
        self._batches.begin()

    def message(self, message: Message) -> None:
        topic = TOPICS.get(type(message))
        if self._writer is not None and topic is not None:
            self._writer.write(topic, message_time_ns(message), telemetry_payload(message))

    def tracker_traffic(self, direction: str, data: bytes, t_ns: int) -> None:
        if self._writer is not None:
            self._writer.write(RAW_TRACKER, t_ns, tracker_payload(direction, data))

    def can_tap(self, bus: str) -> BusBatches:
        return self._batches.of(bus)

    def urgent(self) -> None:
        if self._writer is not None:
            self._batches.flush()
            self._writer.sync()

    async def stop(self) -> None:
        if self._writer is not None:
            self._batches.flush()
            self._batches.end()
            self._writer.finish()
            self._status = self._described(self._writer, recording=False)
            self._writer = None

    @property
    def status(self) -> RecorderStatus:
        if self._writer is None:
            return self._status
        return self._described(self._writer, recording=True)

    def _write(self, topic: str, t_ns: int, payload: bytes) -> None:
        if self._writer is not None:
            self._writer.write(topic, t_ns, payload)

    def _described(self, writer: RunWriter, recording: bool) -> RecorderStatus:
        written = writer.bytes_written
        if written != self._measured_at_bytes:
            self._measured_at_bytes, self._free_mb = written, free_mb(writer.path.parent)
        return RecorderStatus(
            recording,
            self._folder if recording else None,
            writer.dropped,
            writer.failed,
            self._free_mb,
            written,
        )
