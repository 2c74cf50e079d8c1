"""`tentacled bridge openigtlink` as a process, heard by pyigtl's own client in another."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.daemon.remote.conftest import tmp_path as tmp_path
from tests.hil.processes import PATIENCE_S, Process, command, run

pytest.importorskip("pyigtl", reason="pip install '.[test]'")

Told = dict[str, Any]


@contextmanager
def fake_daemon(folder: Path) -> Iterator[Process]:
    """One that publishes the same tip over and over."""
    words = [sys.executable, "-m", "tests.daemon.remote.serve", str(folder), "close"]
    one = Process(words, stdin=subprocess.PIPE)
    try:
        assert one.next_line()[1] == "ready\n"
        yield one
    finally:
        one.leave()
        assert one.process.stdin is not None
        one.process.stdin.close()


@contextmanager
def bridge(folder: Path, *words: str) -> Iterator[tuple[Process, int]]:
    one = Process(
        command("bridge", "openigtlink", "--runtime-dir", str(folder), "--port", "0", *words),
        stderr=subprocess.STDOUT,
    )
    try:
        line = one.next_line()[1]
        assert line.startswith("OpenIGTLink at 127.0.0.1:"), line
        yield one, int(line.split(":")[1].split(";")[0])
    finally:
        one.leave()


@contextmanager
def witness(port: int, *devices: str) -> Iterator[Callable[[Callable[[Told], bool]], Told]]:
    """What pyigtl hears: asks for the next that is wanted."""
    words = [sys.executable, "-m", "tests.daemon.bridges.witness_pyigtl", str(port), *devices]
    one = Process(words, stdin=subprocess.PIPE)

    def wait_for(wanted: Callable[[Told], bool]) -> Told:
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            told: Told = json.loads(one.next_line(deadline_s)[1])
            if wanted(told):
                return told

    try:
        yield wait_for
    finally:
        one.leave()
        assert one.process.stdin is not None
        one.process.stdin.close()


def test_pyigtl_hears_tip_and_state_and_that_the_daemon_has_gone(tmp_path: Path) -> None:
    with bridge(tmp_path) as (process, port):
        assert process.next_line()[1].startswith("waiting: no daemon is running")
        with witness(port, "TipToBase", "State") as wait_for:
            assert "not connected" in wait_for(lambda told: told["device"] == "State")["text"]
            with fake_daemon(tmp_path):
                wait_for(lambda told: told.get("text") == "STANDBY (simulated)")
                told = wait_for(lambda told: told["kind"] == "TRANSFORM")
                assert told["matrix"][0] == pytest.approx([1.0, 0.0, 0.0, 1.1])
                assert [row[3] for row in told["matrix"]] == pytest.approx([1.1, 2.1, 103.4, 1.0])
            wait_for(lambda told: "not connected" in told.get("text", ""))
        assert process.end() == 0


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    with bridge(tmp_path) as (_, port):
        told = run("bridge", "openigtlink", "--runtime-dir", str(tmp_path), "--port", str(port))
        assert told.returncode == 69 and f"port {port} cannot be served" in told.stderr


def test_contradictions_on_the_command_line_are_told_at_once(tmp_path: Path) -> None:
    told = run("bridge", "openigtlink", "--runtime-dir", str(tmp_path), "--user", "ann")
    assert told.returncode == 64 and "go with --connect" in told.stderr
