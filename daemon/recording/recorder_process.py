"""The recorder process: `python -m daemon.recording.recorder_process`, started by the daemon.

Reads a record stream from its standard input and writes the recording. Ends when the stream ends,
also because the daemon has died: the file is finished either way. Says how it is doing on its
standard output, and never waits for anybody to read that.
"""

import contextlib
import logging
import os
import select
import signal
import sys
from pathlib import Path
from typing import Final

import msgspec

from daemon.host.clock import MonotonicClock
from daemon.host.logs import logging_to_stderr
from daemon.recording.format.record_stream import (
    BEGIN,
    CHANNEL,
    END,
    SYNC,
    Begin,
    Record,
    RecorderProgress,
    RecordReader,
    declared_channel,
    dropped_count,
)
from daemon.recording.run_folder import free_mb
from daemon.recording.run_writer import RunWriter
from drivers.clock import Clock

_log = logging.getLogger("daemon.recording.recorder_process")

FLUSH_EVERY_NS: Final = 150_000_000
_SYNC_EVERY_NS: Final = 1_000_000_000
_TELL_EVERY_NS: Final = 500_000_000
_READ_BYTES: Final = 1 << 18


class RecorderProcess:
    """Stream in, file out."""

    def __init__(self, source: int, answers: int, clock: Clock) -> None:
        """source, answers: descriptors of the record stream and of the progress lines."""
        self._source = source
        self._answers = answers
        self._clock = clock
        self._reader = RecordReader()
        self._topics: dict[int, str] = {}
        self._writer: RunWriter | None = None
        self._dropped_before = 0
        self._flushed_ns = self._synced_ns = self._reported_ns = clock.now_ns()

    def run(self) -> int:
        """Until the stream ends. Returns the exit code."""
        try:
            while True:
                ready, _, _ = select.select([self._source], [], [], FLUSH_EVERY_NS * 1e-9)
                if ready:
                    data = os.read(self._source, _READ_BYTES)
                    if not data:
                        break
                    for record in self._reader.feed(data):
                        self._take(record)
                self._keep_time(self._clock.now_ns())
            return self._finish()
        except OSError as error:
            self._tell(f"cannot write the recording: {error.strerror}: {error.filename}")
            return 1

    def _take(self, record: Record) -> None:
        if record.number == BEGIN:
            begin = msgspec.json.decode(record.content, type=Begin)
            self._writer = RunWriter(Path(begin.path), begin.header, begin.wall_offset_ns)
            self._tell()
        elif record.number == CHANNEL:
            number, topic = declared_channel(record.content)
            self._topics[number] = topic
        elif record.number == END:
            self._dropped_before = dropped_count(record.content)
        elif self._writer is not None and record.number == SYNC:
            self._writer.sync()
        elif self._writer is not None:
            self._writer.write(self._topics[record.number], record.t_ns, record.content)

    def _keep_time(self, now_ns: int) -> None:
        if self._writer is None:
            return
        if now_ns - self._synced_ns >= _SYNC_EVERY_NS:
            self._synced_ns = self._flushed_ns = now_ns
            self._writer.sync()
        elif now_ns - self._flushed_ns >= FLUSH_EVERY_NS:
            self._flushed_ns = now_ns
            self._writer.flush()
        if now_ns - self._reported_ns >= _TELL_EVERY_NS:
            self._reported_ns = now_ns
            self._tell()

    def _finish(self) -> int:
        complete = self._writer is None or self._writer.finish(self._dropped_before)
        self._tell()
        return 0 if complete else 1

    def _tell(self, failed: str = "") -> None:
        progress = RecorderProgress(failed=failed)
        if self._writer is not None:
            progress = RecorderProgress(
                bytes_written=self._writer.bytes_written,
                free_mb=free_mb(self._writer.path.parent),
                dropped=self._writer.dropped,
                failed=failed or self._writer.failed,
                lost=self._writer.deleted,
            )
        with contextlib.suppress(OSError):  # nobody reads, or nobody is there
            os.write(self._answers, msgspec.json.encode(progress) + b"\n")


def main() -> int:
    # When to end is the daemon's decision, and is told by the end of the stream.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # a real-time daemon's children inherit its priority
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    source, answers = sys.stdin.fileno(), sys.stdout.fileno()
    os.set_blocking(answers, False)
    with logging_to_stderr("recorder"):
        return _run(RecorderProcess(source, answers, MonotonicClock()))


def _run(process: RecorderProcess) -> int:
    try:
        return process.run()
    except Exception:
        _log.exception("the recorder has ended by an error of its own")
        return 1


if __name__ == "__main__":
    sys.exit(main())
