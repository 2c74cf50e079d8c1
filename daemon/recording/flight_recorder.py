"""What the daemon asks of a recorder, and the one of real time, which never waits for the disk."""

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import msgspec

from daemon.messages import Message
from daemon.recording.can_batches import BusBatches, CanBatches
from daemon.recording.channels import (
    RAW_TRACKER,
    TOPICS,
    message_time_ns,
    telemetry_payload,
    tracker_payload,
)
from daemon.recording.record_stream import Begin, Progress, RecordWriter
from daemon.recording.recorder_link import RecorderLink
from daemon.recording.run_files import RUN_FILE
from drivers.can.traffic_tap import TrafficTap

_SEND_EVERY_S: Final = 0.05
_BUFFER_AT_MOST: Final = 8 << 20
_STARTS_WITHIN_S: Final = 15.0  # shorter than a client waits for `arm`: it is to hear why
_ENDS_WITHIN_S: Final = 5.0
_SILENT_TICKS: Final = 100
"""After so many sends without an answer the process counts as frozen: 5 s.

In ticks and not in time, so that a stall of our own loop is not put down to the recorder.
"""


class RecordingError(RuntimeError):
    """A recording could not be started; the text says why."""


class RecorderStatus(NamedTuple):
    """How the recording is doing."""

    recording: bool
    folder: Path | None
    """None: nothing is being recorded."""
    dropped: int
    """Messages that are missing in the recording."""
    failed: str
    """Why nothing is being written at the moment; empty: all is well."""
    free_mb: float | None
    bytes_written: int
    lost: bool = False
    """Nothing more will come of this recording: a new one has to be started."""


class Recorder(Protocol):
    """Takes what happens. No call but `start` and `stop` ever waits, and none of these fails."""

    async def start(
        self,
        folder: Path,
        header: Mapping[str, str],
        t_ns: int,
        wall_ns: int,
        name: str = RUN_FILE,
    ) -> None:
        """Begin a recording of this name in an existing folder.

        header: what the file says of itself. t_ns, wall_ns: one moment on the monotonic clock and
        as a date. Raises RecordingError.
        """
        ...

    def message(self, message: Message) -> None:
        """Telemetry, dated by its own t_ns. Other messages are not recorded."""
        ...

    def tracker_traffic(self, direction: str, data: bytes, t_ns: int) -> None:
        """Bytes on the tracker's line. direction: `from_device` or `to_device`."""
        ...

    def can_tap(self, bus: str) -> TrafficTap:
        """Takes the frames of a bus, with the kernel's flags in their IDs, in all recordings."""
        ...

    def urgent(self) -> None:
        """Bring what is there to the disk now: something went wrong."""
        ...

    async def stop(self) -> None:
        """Finish the file, within a bounded time. Does nothing when there is no recording."""
        ...

    @property
    def status(self) -> RecorderStatus:
        """How it is doing."""
        ...


class FlightRecorder:
    """Messages are encoded at once and sent 20 times a second.

    While the recorder process takes nothing, up to 8 MiB wait; then the newest are dropped, so
    that a recording has one gap and not many. What the process has got is finished by it even
    when this process is killed.
    """

    def __init__(self) -> None:
        self._records = RecordWriter()
        self._batches = CanBatches(self._add)
        self._link: RecorderLink | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._folder: Path | None = None
        self._dropped = 0
        self._progress = Progress()
        self._answered = False
        self._ended = ""
        self._silent_ticks = 0

    @property
    def status(self) -> RecorderStatus:
        failed = self._ended or self._progress.failed
        if not failed and self._link is not None and self._silent_ticks >= _SILENT_TICKS:
            failed = "the recorder process does not answer"
        recording = self._link is not None and not self._link.ended
        silent = self._silent_ticks >= _SILENT_TICKS
        lost = self._link is not None and (self._link.ended or silent or self._progress.lost)
        return RecorderStatus(
            recording,
            self._folder if recording else None,
            self._dropped + self._progress.dropped,
            failed,
            self._progress.free_mb,
            self._progress.bytes_written,
            lost,
        )

    @property
    def pid(self) -> int | None:
        """The recorder process' ID; None: there is none."""
        return None if self._link is None else self._link.pid

    async def start(
        self,
        folder: Path,
        header: Mapping[str, str],
        t_ns: int,
        wall_ns: int,
        name: str = RUN_FILE,
    ) -> None:
        if self._link is not None:
            raise RecordingError(f"already recording in {self._folder}")
        self._reset(folder)
        path = str((folder / name).absolute())
        self._records.begin(Begin(path=path, header=dict(header), wall_offset_ns=wall_ns - t_ns))
        try:
            self._link = RecorderLink(self._records.buffer, self._on_line)
        except OSError as error:
            raise RecordingError(f"cannot start the recorder process: {error}") from error
        self._batches.begin()
        self._tick()
        try:
            async with asyncio.timeout(_STARTS_WITHIN_S):
                while not self._answered:
                    await asyncio.sleep(0.01)
        except TimeoutError:
            self._ended = "the recorder process did not start in time"
        finally:
            if self.status.failed or not self._answered:
                await self._end()
        if self._link is None:
            raise RecordingError(self.status.failed)

    def message(self, message: Message) -> None:
        topic = TOPICS.get(type(message))
        if self._link is not None and topic is not None:
            self._add(topic, message_time_ns(message), telemetry_payload(message))

    def tracker_traffic(self, direction: str, data: bytes, t_ns: int) -> None:
        if self._link is not None:
            self._add(RAW_TRACKER, t_ns, tracker_payload(direction, data))

    def can_tap(self, bus: str) -> BusBatches:
        return self._batches.of(bus)

    def urgent(self) -> None:
        if self._link is not None and not self._link.ended:
            self._batches.flush()
            self._records.sync()
            self._link.send()

    async def stop(self) -> None:
        if self._link is None:
            return
        self._batches.flush()
        self._records.end(self._dropped)
        if not await self._end() and not self.status.failed:
            self._ended = (
                "the recorder process did not finish the file: it is repaired at next start"
            )

    def _add(self, topic: str, t_ns: int, payload: bytes) -> None:
        link, buffer = self._link, self._records.buffer
        if link is None or link.ended or len(buffer) > _BUFFER_AT_MOST:
            self._dropped += 1
        else:
            self._records.message(topic, t_ns, payload)

    def _tick(self) -> None:
        """Send what has come together since the last time."""
        if self._link is None or self._link.ended:
            return
        self._timer = asyncio.get_running_loop().call_later(_SEND_EVERY_S, self._tick)
        self._silent_ticks += 1
        self._batches.flush()
        if self._records.buffer:
            self._link.send()

    def _on_line(self, line: bytes) -> None:
        """An answer of the process; empty: there will be no more."""
        self._answered, self._silent_ticks = True, 0
        if line:
            with suppress(msgspec.MsgspecError):
                self._progress = msgspec.json.decode(line, type=Progress)
        elif self._link is not None:
            self._ended = self._progress.failed or "the recorder process has ended by itself"

    async def _end(self) -> bool:
        """No more is taken from now on; the process gets the rest. Whether it ended well."""
        link, self._link = self._link, None
        self._batches.end()
        if self._timer is not None:
            self._timer.cancel()
        return link is not None and await link.finish(_ENDS_WITHIN_S)

    def _reset(self, folder: Path) -> None:
        self._records = RecordWriter()
        self._folder = folder
        self._dropped = 0
        self._progress = Progress()
        self._answered = False
        self._ended = ""
        self._silent_ticks = 0
