"""The end of the report's process where the run is: started with it, asked after it, and ended."""

import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from daemon.recording.run_files import REPORT_FILE, RUN_FILE
from daemon.recording.run_reader import control_hash

HASH: Final = b"h"
"""Wish for the control hash of what is recorded by now."""
REPORT: Final = b"r"
"""Wish for the report. Answered by an empty line when it is written."""

_COMMAND: Final = (sys.executable, "-m", "daemon.workbench.report.report_process")
_ANSWERS_WITHIN_S: Final = 120.0


class ReportBeside:
    """What it does not do, for whatever reason, is done here."""

    def __init__(self, folder: Path) -> None:
        """folder: the run's, which may still be empty."""
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None

    def begin(self) -> None:
        """Start the process: it does in the meantime what can be done."""
        with suppress(OSError):
            # A session of its own: a terminal's Ctrl-C is for us.
            self._process = subprocess.Popen(
                [*_COMMAND, str(self._folder)],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )

    def control_hash(self) -> str:
        """Of the recording, which is complete. Raises UnreadableRunError, OSError."""
        told = self._answer(HASH)
        return told or control_hash(self._folder / RUN_FILE)

    def write(self) -> Path:
        """Write the report. Returns where it is. Raises UnreadableRunError, OSError."""
        if self._answer(REPORT) is not None:
            return self._folder / REPORT_FILE
        from daemon.workbench.report.report import write_report  # slow to come

        return write_report(self._folder)

    def end(self) -> None:
        """At once, whatever it is doing."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _answer(self, wish: bytes) -> str | None:
        """None: there is none, and there will be no other."""
        if self._process is None:
            return None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        line = b""
        with suppress(OSError):
            self._process.stdin.write(wish)
            if select.select([self._process.stdout], [], [], _ANSWERS_WITHIN_S)[0]:
                line = self._process.stdout.readline()
        if not line.endswith(b"\n"):
            self.end()
            return None
        return line.decode().strip()
