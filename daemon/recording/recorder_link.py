"""The daemon's end of the recorder process: started, fed without waiting, and ended in time."""

import asyncio
import contextlib
import fcntl
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Final

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
