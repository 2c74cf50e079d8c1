"""The report of a run that goes on: `python -m daemon.workbench.report.report_process RUN`.

Reads the recording as it grows, beside the process that writes it, so that at the end there is only
the drawing left to do. Is told by single bytes on its standard input what is wanted, and answers
with a line. Leaves when that input ends, also because who started it has died.
"""

import contextlib
import gc
import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from daemon.files import write_whole
from daemon.host.processes import end_with_parent
from daemon.recording.run_folder import REPORT_FILE
from daemon.recording.run_parts import control_hash
from daemon.recording.run_reader import Fingerprint, UnreadableRunError
from daemon.workbench.report.report import report_html
from daemon.workbench.report.report_data import GrowingRun
from daemon.workbench.report.two_processes import in_two_processes

# The end of the report's process where the run is: started with it, asked after it, and ended.


HASH: Final = b"h"
"""Request for the control hash of what has been recorded."""
REPORT: Final = b"r"
"""Request for the report. Answered by an empty line when it is written."""

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
        digest = self._answer(HASH)
        return digest or control_hash(self._folder)

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

    def _answer(self, request: bytes) -> str | None:
        """None: there is none, and there will be no other."""
        if self._process is None:
            return None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        line = b""
        with suppress(OSError):
            self._process.stdin.write(request)
            if select.select([self._process.stdout], [], [], _ANSWERS_WITHIN_S)[0]:
                line = self._process.stdout.readline()
        if not line.endswith(b"\n"):
            self.end()
            return None
        return line.decode().strip()


_LOOK_EVERY_S: Final = 0.2


class ReportProcess:
    """Bytes in, report out."""

    def __init__(self, folder: Path, requests: int, answers: int) -> None:
        """wishes, answers: descriptors."""
        self._folder = folder
        self._requests = requests
        self._answers = answers
        self._fingerprint = Fingerprint()
        self._run = GrowingRun(folder, self._fingerprint.take)

    def run(self) -> None:
        """Until there is nothing to wish any more. Raises UnreadableRunError, OSError."""
        while True:
            ready, _, _ = select.select([self._requests], [], [], _LOOK_EVERY_S)
            if not ready:
                # There may be nothing yet; and what is wrong is told when somebody wants it.
                with contextlib.suppress(UnreadableRunError, OSError):
                    self._run.catch_up()
                continue
            request = os.read(self._requests, 1)
            if not request:
                return
            os.write(self._answers, self._answer(request).encode() + b"\n")

    def _answer(self, request: bytes) -> str:
        if request == HASH:
            self._run.catch_up()
            return self._fingerprint.hexdigest()
        page = report_html(self._run.data(), in_two_processes)
        write_whole(self._folder / REPORT_FILE, page.encode())
        return ""


def main() -> int:
    end_with_parent()
    gc.disable()  # what is read does not refer to itself
    try:
        ReportProcess(Path(sys.argv[1]), sys.stdin.fileno(), sys.stdout.fileno()).run()
    except (UnreadableRunError, OSError):
        return 1  # who asked tries it without us, and tells what is wrong
    return 0


if __name__ == "__main__":
    sys.exit(main())
