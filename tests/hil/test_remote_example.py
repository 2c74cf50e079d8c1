"""The remote API's Python example, run as printed, against a daemon beside its emulated lab."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import SOFT_ARM
from tests.docs.blocks import blocks_of
from tests.hil.daemon_rig import Daemon, short_folder
from tests.hil.processes import PATIENCE_S, Process, lab, run

pytestmark = pytest.mark.hil

FOLLOWING = 40
"""Lines from which it can be seen that it follows."""


def example() -> str:
    """The program, as its page has it."""
    return blocks_of("docs/remote-api.md", "python")[0].text


@pytest.mark.long
def test_the_python_example_follows_a_circle_as_printed() -> None:
    with short_folder() as root:
        folder = root / "tentacled" / "soft_arm"
        folder.mkdir(parents=True, mode=0o700)
        program = root / "example.py"
        program.write_text(example())
        with lab(folder):
            daemon, user = Daemon(folder, SOFT_ARM), None
            try:
                daemon.wait_until_it_speaks()
                wait_until_ready(folder)
                user = Process(
                    [sys.executable, "-u", str(program)],
                    stderr=subprocess.PIPE,
                    env={**os.environ, "XDG_RUNTIME_DIR": str(root)},
                )
                check_that_it_follows(user)
            finally:
                for process in filter(None, (user, daemon)):
                    process.leave()


def wait_until_ready(folder: Path) -> None:
    """As whoever types it sees in the status."""
    deadline_s = time.monotonic() + PATIENCE_S
    while '"state":"ready"' not in run("status", "--runtime-dir", str(folder), "--json").stdout:
        assert time.monotonic() < deadline_s


def check_that_it_follows(user: Process) -> None:
    """It prints small errors, until Ctrl-C."""
    errors: list[float] = []
    while len(errors) < FOLLOWING:
        found = re.fullmatch(r"running ([0-9.]+)", user.next_line()[1].strip())
        errors += [float(found[1])] if found else []
    assert max(errors) < 5.0
    assert user.process.stderr is not None
    user.process.send_signal(signal.SIGINT)
    with user.process.stderr as said:
        complaints = said.read().splitlines()
    assert complaints[-1:] == ["KeyboardInterrupt"]
