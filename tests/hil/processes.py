"""tentacled's own processes, as an operator would start them."""

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from tests import SOFT_ARM

STARTS_WITHIN_S = 60.0  # a first start compiles the physics


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "daemon.cli", *arguments]


def run(*arguments: str, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
    """A command run to its end."""
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=timeout_s, check=False
    )


class Lab:
    """`tentacled emulate` in a process of its own."""

    def __init__(self, directory: Path, *options: str, robot: Path = SOFT_ARM) -> None:
        self.directory = directory
        self.process = subprocess.Popen(
            command("emulate", str(robot), "--runtime-dir", str(directory), *options),
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.first_line = self.process.stdout.readline()

    def inject(self, *faults: str) -> subprocess.CompletedProcess[str]:
        return run("inject", "--runtime-dir", str(self.directory), *faults)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(timeout=10)


@contextmanager
def lab(directory: Path, *options: str, robot: Path = SOFT_ARM) -> Iterator[Lab]:
    """A running lab, ended however the test ends."""
    one = Lab(directory, *options, robot=robot)
    try:
        yield one
    finally:
        if one.process.poll() is None:
            one.kill()
        assert one.process.stdout is not None
        one.process.stdout.close()


class Probe:
    """`tentacled probe --json` in a process of its own, its lines with their times of arrival."""

    def __init__(self, directory: Path, *options: str, robot: Path = SOFT_ARM) -> None:
        where = ["--runtime-dir", str(directory)]
        self.process = subprocess.Popen(
            command("probe", str(robot), *where, "--json", "--every", "0.2", *options),
            stdout=subprocess.PIPE,
            text=True,
        )
        self._lines: Queue[tuple[float, dict[str, Any]]] = Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def wait_for(
        self, wanted: Callable[[dict[str, Any]], bool], within_s: float = 20.0
    ) -> tuple[float, dict[str, Any]]:
        """The next line that is wanted, and when it came (monotonic, s)."""
        deadline = time.monotonic() + within_s
        last: dict[str, Any] = {}
        while True:
            try:
                at_s, last = self._lines.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                raise AssertionError(f"not within {within_s} s; the last line was {last}") from None
            if wanted(last):
                return at_s, last

    def wait_for_events(self, *names: str, within_s: float = 20.0) -> dict[str, float]:
        """When each of these conditions came, in whatever order."""
        came: dict[str, float] = {}
        deadline = time.monotonic() + within_s
        while len(came) < len(names):
            at_s, line = self.wait_for(
                lambda line: any(event(name)(line) for name in names),
                deadline - time.monotonic(),
            )
            came.setdefault(line["name"], at_s)
        return came

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(timeout=10)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put((time.monotonic(), json.loads(line)))


@contextmanager
def probe(directory: Path, *options: str, robot: Path = SOFT_ARM) -> Iterator[Probe]:
    """A running probe, ended however the test ends."""
    one = Probe(directory, *options, robot=robot)
    try:
        yield one
    finally:
        if one.process.poll() is None:
            one.process.kill()
            one.process.wait()
        assert one.process.stdout is not None
        one._reader.join()
        one.process.stdout.close()


def well(line: dict[str, Any]) -> bool:
    """A snapshot in which everything is there."""
    return (
        line["kind"] == "snapshot"
        and line["tracker"]["state"] == "tracking"
        and line["tracker"]["tip_mm"] is not None
        and all(axis["node_state"] == "operational" for axis in line["axes"])
        and line["conditions"] == []
    )


def event(name: str, present: bool = True) -> Callable[[dict[str, Any]], bool]:
    """Whether a line says that a condition came (or went)."""
    return lambda line: (
        line["kind"] == "event" and line["name"] == name and line["present"] is present
    )


def soft_arm_over_slcan(directory: Path) -> Path:
    """The shipped robot, with its drives behind the serial adapter."""
    text = SOFT_ARM.read_text()
    text = text.replace("interface: tentacled", "interface: slcan")
    path = directory / "soft_arm.yaml"
    path.write_text(text.replace("lab:can0.sock", "lab:can0"))
    return path
