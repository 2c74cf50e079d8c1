"""The report of a run that goes on: `python -m daemon.workbench.report.report_process RUN`.

Reads the recording as it grows, beside the process that writes it, so that at the end there is only
the drawing left to do. Is told by single bytes on its standard input what is wanted, and answers
with a line. Leaves when that input ends, also because who started it has died.
"""

import contextlib
import gc
import os
import select
import sys
from pathlib import Path
from typing import Final

from daemon.host.own_processes import end_with_parent
from daemon.recording.run_files import REPORT_FILE
from daemon.recording.run_reader import Fingerprint, UnreadableRunError
from daemon.workbench.report.report import report_html
from daemon.workbench.report.report_beside import HASH
from daemon.workbench.report.report_data import GrowingRun
from daemon.workbench.report.two_processes import in_two_processes

_LOOK_EVERY_S: Final = 0.2


class ReportProcess:
    """Bytes in, report out."""

    def __init__(self, folder: Path, wishes: int, answers: int) -> None:
        """wishes, answers: descriptors."""
        self._folder = folder
        self._wishes = wishes
        self._answers = answers
        self._fingerprint = Fingerprint()
        self._run = GrowingRun(folder, self._fingerprint.take)

    def run(self) -> None:
        """Until there is nothing to wish any more. Raises UnreadableRunError, OSError."""
        while True:
            ready, _, _ = select.select([self._wishes], [], [], _LOOK_EVERY_S)
            if not ready:
                # There may be nothing yet; and what is wrong is told when somebody wants it.
                with contextlib.suppress(UnreadableRunError, OSError):
                    self._run.catch_up()
                continue
            wish = os.read(self._wishes, 1)
            if not wish:
                return
            os.write(self._answers, self._answer(wish).encode() + b"\n")

    def _answer(self, wish: bytes) -> str:
        if wish == HASH:
            self._run.catch_up()
            return self._fingerprint.hexdigest()
        page = report_html(self._run.data(), in_two_processes)
        (self._folder / REPORT_FILE).write_text(page, encoding="utf-8")
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
