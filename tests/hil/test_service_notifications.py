"""The daemon as a service: what systemd would hear of it, and when it would hear nothing."""

import os
import signal
import socket
import sys
import time
from pathlib import Path

import pytest

from tests import SOFT_ARM
from tests.hil.daemon_rig import short_folder
from tests.hil.processes import PATIENCE_S, Process

pytestmark = pytest.mark.hil

WEDGED = """
import ctypes, signal, sys, threading
from daemon.commands.terminal.command_line import main

sleep = ctypes.PyDLL(None).sleep  # does not let go of the interpreter
told = threading.Event()

def wedge():
    told.wait()
    sleep(3)

threading.Thread(target=wedge, daemon=True).start()
signal.signal(signal.SIGUSR1, lambda number, frame: told.set())
sys.exit(main(sys.argv[1:]))
"""
TIMEOUT_S = 1.0


class Manager:
    """systemd's end of the socket."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.settimeout(0.1)

    def heard(self, word: str, within_s: float = PATIENCE_S) -> float:
        """When it came. Raises AssertionError."""
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            if any(text.startswith(word) for text in self.within(0.0)):
                return time.monotonic()
        raise AssertionError(f"no {word} within {within_s} s")

    def within(self, duration_s: float) -> list[str]:
        """All that comes in this time, and for a tenth of a second longer."""
        found: list[str] = []
        end_s = time.monotonic() + duration_s
        while True:
            try:
                found.append(self._socket.recv(4096).decode())
            except TimeoutError:
                if time.monotonic() >= end_s:
                    return found
            else:
                if time.monotonic() >= end_s:
                    return found

    def close(self) -> None:
        self._socket.close()


def test_it_is_up_fed_silent_while_it_is_wedged_and_on_its_way_down() -> None:
    with short_folder() as folder:
        manager = Manager(folder / "notify")
        environment = {
            **os.environ,
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": str(round(TIMEOUT_S * 1e6)),
        }
        where = ["--runtime-dir", str(folder / "d"), "--runs", str(folder / "runs")]
        words = [sys.executable, "-c", WEDGED, "run", str(SOFT_ARM), *where, "--no-real-time"]
        daemon = Process(words, env=environment)
        try:
            manager.heard("READY=1")
            assert "WATCHDOG=1" in manager.within(TIMEOUT_S)
            texts = manager.within(TIMEOUT_S)
            assert texts.count("WATCHDOG=1") >= 3
            os.kill(daemon.process.pid, signal.SIGUSR1)
            manager.within(0.2)
            assert "WATCHDOG=1" not in manager.within(TIMEOUT_S)
            manager.heard("WATCHDOG=1")
            daemon.process.send_signal(signal.SIGTERM)
            manager.heard("STOPPING=1")
            assert daemon.process.wait(PATIENCE_S) == 0
        finally:
            daemon.leave()
            manager.close()
