"""What the daemon asks of a recorder, and the one of real time, which never waits for the disk."""

import asyncio
import contextlib
import fcntl
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import msgspec

from daemon.messages import Message
from daemon.recording.format.can_batches import BusBatches, CanBatches
from daemon.recording.format.channels import (
    RAW_TRACKER,
    TOPICS,
    message_time_ns,
    telemetry_payload,
    tracker_payload,
)
from daemon.recording.format.record_stream import Begin, RecorderProgress, RecordWriter
from daemon.recording.run_folder import RUN_FILE
from drivers.can.link import TrafficTap

# The daemon's end of the recorder process: started, fed without waiting, and ended in time.


_COMMAND: Final = (sys.executable, "-m", "daemon.recording.recorder_process")
_PIPE_BYTES: Final = 1 << 20
_WRITE_AT_MOST: Final = 1 << 17
_READ_BYTES: Final = 1 << 16
_POLL_S: Final = 0.01
_KILLED_WITHIN_S: Final = 1.0


class RecorderLink:
    """One process. What is in `buffer` goes to it as fast as it takes it."""

    def __init__(self, buffer: bytearray, on_line: Callable[[bytes], None]) -> None:
        """on_line: gets the process' answers, line by line, and an empty one at their end.

        Raises OSError.
        """
        self._buffer = buffer
        self._on_line = on_line
        self._loop = asyncio.get_running_loop()
        self._waiting = False
        self._partial = b""
        self.ended = False
        """Its output has come to its end, which means that it is going."""
        # A session of its own: a terminal's Ctrl-C is for the daemon.
        self._process = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout
        self._to = self._stdin.fileno()
        self._from = self._stdout.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        with contextlib.suppress(OSError):  # more than the user's share: the default will do
            fcntl.fcntl(self._to, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self._loop.add_reader(self._from, self._readable)

    @property
    def pid(self) -> int:
        """The process' ID."""
        return self._process.pid

    def send(self) -> None:
        """Hand over what the pipe takes now; the rest follows when there is room."""
        if not self._waiting:
            self._write()

    async def finish(self, within_s: float) -> bool:
        """Hand over the rest and wait for the process to end by itself.

        False: it did not end well, or not in time and was ended by force.
        """
        try:
            async with asyncio.timeout(within_s):
                while self._buffer:
                    self.send()
                    await asyncio.sleep(_POLL_S)
                self._close_input()
                # Its output is read to the end: the last line tells how it went.
                while not self.ended or self._process.poll() is None:
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            self._process.kill()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_KILLED_WITHIN_S):
                    while self._process.poll() is None:
                        await asyncio.sleep(_POLL_S)
        finally:
            self._close()
        return self._process.returncode == 0

    def _write(self) -> None:
        taken = 0
        try:
            with memoryview(self._buffer) as view:
                taken = os.write(self._to, view[:_WRITE_AT_MOST])
        except BlockingIOError:
            pass
        except OSError:  # it has gone; the end of its output says so too
            taken = len(self._buffer)
        del self._buffer[:taken]
        if self._buffer and not self._waiting:
            self._loop.add_writer(self._to, self._write)
        elif self._waiting and not self._buffer:
            self._loop.remove_writer(self._to)
        self._waiting = bool(self._buffer)

    def _readable(self) -> None:
        try:
            data = os.read(self._from, _READ_BYTES)
        except BlockingIOError:
            return
        if not data:
            self.ended = True
            self._loop.remove_reader(self._from)
            self._buffer.clear()
            self._on_line(b"")
            return
        *lines, self._partial = (self._partial + data).split(b"\n")
        for line in lines:
            self._on_line(line)

    def _close_input(self) -> None:
        if not self._stdin.closed:
            self._loop.remove_writer(self._to)
            self._waiting = False
            # The buffer of the file object is empty: it was never written to.
            self._stdin.close()

    def _close(self) -> None:
        self._close_input()
        self._loop.remove_reader(self._from)
        self._stdout.close()
        if self._process.poll() is None:
            self._process.kill()


_SEND_EVERY_S: Final = 0.05
_BUFFER_AT_MOST: Final = 8 << 20
_STARTS_WITHIN_S: Final = 15.0  # shorter than a client waits for `arm`: it is to hear why
_ENDS_WITHIN_S: Final = 5.0
_SILENT_TICKS: Final = 600
"""After so many sends without an answer the process counts as frozen: 30 s. A disk that others keep
busy takes 5 to 20 s for what is to be safe on it; what comes meanwhile waits, and none is lost.

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
        self._progress = RecorderProgress()
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
                self._progress = msgspec.json.decode(line, type=RecorderProgress)
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
        self._progress = RecorderProgress()
        self._answered = False
        self._ended = ""
        self._silent_ticks = 0
