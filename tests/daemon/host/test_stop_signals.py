"""Ctrl-C, SIGTERM and SIGHUP are one way down, also where the terminal has gone with the SIGHUP."""

import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PATIENCE_S = 60.0

WAITS = """
import asyncio, sys
from pathlib import Path
from daemon.host.clock import run_in_real_time
from daemon.host.stop_signals import StopSignals

async def main():
    stop = StopSignals()
    print("ready", flush=True)
    await stop.wait(60.0)
    for _ in range(3):
        print("on the way down", flush=True)
        print("on the way down", file=sys.stderr, flush=True)
    Path(sys.argv[1]).write_text("all was kept")

run_in_real_time(main())
"""

IS_INTERRUPTED = """
import signal, sys, time
from pathlib import Path
from daemon.host.stop_signals import all_like_ctrl_c

before = [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)]
try:
    with all_like_ctrl_c():
        print("ready", flush=True)
        time.sleep(60.0)
except KeyboardInterrupt:
    print("interrupted", flush=True)
    Path(sys.argv[1]).write_text("all was kept")
assert [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)] == before
"""

STUBBORN = """
import asyncio
from daemon.host.clock import run_in_real_time

async def stubborn():
    while True:
        try:
            await asyncio.sleep(60.0)
        except asyncio.CancelledError:
            pass

async def main():
    task = asyncio.create_task(stubborn())
    await asyncio.sleep(0.01)
    print("done", flush=True)

import daemon.host.clock
daemon.host.clock._CLOSES_WITHIN_S = 0.5
run_in_real_time(main())
"""


@pytest.mark.parametrize("program", [WAITS, IS_INTERRUPTED], ids=["told", "interrupted"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_each_of_them_leads_down_in_order(
    tmp_path: Path, program: str, number: signal.Signals
) -> None:
    kept = tmp_path / "kept"
    with _started(program, kept) as process:
        process.send_signal(number)
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, errors
    assert kept.read_text() == "all was kept"


def test_ctrl_backslash_leads_down_as_well_and_the_second_one_is_taken_as_it_is_meant(
    tmp_path: Path,
) -> None:
    kept = tmp_path / "kept"
    with _started(WAITS, kept) as process:
        process.send_signal(signal.SIGQUIT)
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
    assert kept.read_text() == "all was kept"
    hangs = WAITS.replace("for _ in range(3)", "await asyncio.sleep(60.0)\n    for _ in range(3)")
    with _started(hangs, kept) as process:
        process.send_signal(signal.SIGQUIT)
        time.sleep(0.2)
        process.send_signal(signal.SIGQUIT)
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == -signal.SIGQUIT


def test_a_background_job_that_ignores_ctrl_c_can_still_be_told_to_end(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    ignoring = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    with _started(ignoring + IS_INTERRUPTED, kept) as process:
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, errors
    assert kept.read_text() == "all was kept"


@pytest.mark.parametrize("program", [WAITS, IS_INTERRUPTED], ids=["told", "interrupted"])
def test_who_was_told_to_survive_hang_ups_does(tmp_path: Path, program: str) -> None:
    kept = tmp_path / "kept"
    with _started(
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + program, kept
    ) as (process):
        process.send_signal(signal.SIGHUP)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.5)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0


@pytest.mark.parametrize("program", [WAITS, IS_INTERRUPTED], ids=["told", "interrupted"])
def test_a_terminal_that_is_closed_does_not_come_between(tmp_path: Path, program: str) -> None:
    """Its shell is gone and so is its terminal: what is printed then must not be an error."""
    kept = tmp_path / "kept"
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(ROOT)
        os.execv(sys.executable, [sys.executable, "-c", program, str(kept)])
    deadline_s, said = time.monotonic() + PATIENCE_S, b""
    while not said.endswith(b"ready\r\n"):
        assert time.monotonic() < deadline_s
        said += os.read(terminal, 1024)
    time.sleep(0.2)  # until the call that wrote it has returned
    os.close(terminal)  # the kernel sends SIGHUP to the session's leader
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    assert kept.read_text() == "all was kept"


def test_the_process_ends_even_if_a_task_does_not() -> None:
    done = subprocess.run(
        [sys.executable, "-c", STUBBORN],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == "done\n"
    assert "ended by force" in done.stderr


def _started(program: str, kept: Path) -> "subprocess.Popen[str]":
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(kept)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process
