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

PATIENCE_S = 90.0
"""For whatever must come. A first start compiles the physics, and the machine may be busy."""


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "daemon.commands.terminal.command_line", *arguments]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command run to its end."""
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


class Process:
    """A process, and the lines it prints with their times of arrival (monotonic, s)."""

    def __init__(self, arguments: list[str], **options: Any) -> None:
        """options: of subprocess.Popen."""
        self.process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, **options)
        self._lines: Queue[tuple[float, str | None]] = Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def next_line(self, deadline_s: float | None = None) -> tuple[float, str]:
        """The next line, and when it came. Raises AssertionError at the deadline or the end."""
        deadline_s = time.monotonic() + PATIENCE_S if deadline_s is None else deadline_s
        try:
            at_s, line = self._lines.get(timeout=max(0.0, deadline_s - time.monotonic()))
        except Empty:
            raise AssertionError("nothing more in time") from None
        assert line is not None, "the process has ended"
        return at_s, line

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def end(self) -> int:
        """Ask it to end, as Ctrl-C does. Returns its exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(PATIENCE_S)

    def leave(self) -> None:
        """Whatever has happened, nothing is left of it."""
        if self.process.poll() is None:
            self.kill()
        self._reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put((time.monotonic(), line))
        self._lines.put((time.monotonic(), None))


class Lab(Process):
    """`tentacled emulate` in a process of its own."""

    def __init__(self, directory: Path, *options: str, robot: Path = SOFT_ARM) -> None:
        super().__init__(command("emulate", str(robot), "--runtime-dir", str(directory), *options))
        self.directory = directory
        self.first_line = ""

    def says(self, *wanted: str) -> None:
        """Wait until it has printed these lines, in this order."""
        for line in wanted:
            while self.next_line()[1].rstrip() != line:
                pass

    def inject(self, *faults: str) -> subprocess.CompletedProcess[str]:
        return run("inject", "--runtime-dir", str(self.directory), *faults)


@contextmanager
def lab(directory: Path, *options: str, robot: Path = SOFT_ARM) -> Iterator[Lab]:
    """A running lab, ended however the test ends."""
    one = Lab(directory, *options, robot=robot)
    try:
        one.first_line = one.next_line()[1]  # it speaks when its ports are there
        yield one
    finally:
        one.leave()


Line = dict[str, Any]
Wanted = Callable[[Line], bool]


class Probe(Process):
    """`tentacled probe --json` in a process of its own."""

    def __init__(self, directory: Path, *options: str, robot: Path = SOFT_ARM) -> None:
        where = ["--runtime-dir", str(directory)]
        super().__init__(command("probe", str(robot), *where, "--json", "--every", "0.2", *options))

    def wait_for(self, wanted: Wanted, within_s: float = PATIENCE_S) -> tuple[float, Line]:
        """The next line that is wanted, and when it came."""
        (found,) = self.wait_for_each(wanted, within_s=within_s)
        return found

    def wait_for_each(
        self, *wanted: Wanted, within_s: float = PATIENCE_S
    ) -> list[tuple[float, Line]]:
        """The first line that each of them wants, in whatever order these come."""
        deadline_s = time.monotonic() + within_s
        found: dict[int, tuple[float, Line]] = {}
        line: Line = {}
        while len(found) < len(wanted):
            try:
                at_s, text = self.next_line(deadline_s)
            except AssertionError as error:
                raise AssertionError(f"{error}; the last line was {line}") from None
            line = json.loads(text)["result"]
            for number, wants in enumerate(wanted):
                if number not in found and wants(line):
                    found[number] = at_s, line
        return [found[number] for number in range(len(wanted))]

    def wait_for_events(self, *names: str) -> dict[str, float]:
        """When each of these conditions came, in whatever order."""
        found = self.wait_for_each(*(event(name) for name in names))
        return {name: at_s for name, (at_s, _) in zip(names, found, strict=True)}


@contextmanager
def probe(directory: Path, *options: str, robot: Path = SOFT_ARM) -> Iterator[Probe]:
    """A running probe, ended however the test ends."""
    one = Probe(directory, *options, robot=robot)
    try:
        yield one
    finally:
        one.leave()


def well(line: Line) -> bool:
    """A snapshot in which everything is there.

    Frames that were missed are told for five seconds: on a machine that stands still now and then
    they are no news.
    """
    return (
        operational(line)
        and line["tracker"]["state"] == "tracking"
        and line["tracker"]["tip_mm"] is not None
        and {condition["name"] for condition in line["conditions"]} <= {"frames_missed"}
    )


def operational(line: Line) -> bool:
    """A snapshot in which all drives can be told what to do."""
    return line["kind"] == "snapshot" and all(
        axis["node_state"] == "operational" for axis in line["axes"]
    )


def without(*names: str) -> Wanted:
    """A snapshot in which none of these conditions holds."""
    return lambda line: (
        line["kind"] == "snapshot"
        and not {condition["name"] for condition in line["conditions"]} & set(names)
    )


def event(name: str, subject: str | None = None) -> Wanted:
    """Whether a line says that a condition came, of this subject or of any."""
    return lambda line: (
        line["kind"] == "event"
        and line["name"] == name
        and line["present"]
        and subject in (None, line["subject"])
    )


def soft_arm_over_slcan(directory: Path) -> Path:
    """The shipped robot, with its drives behind the serial adapter."""
    text = SOFT_ARM.read_text()
    text = text.replace("interface: tentacled", "interface: slcan")
    path = directory / "soft_arm.yaml"
    path.write_text(text.replace("lab:can0.sock", "lab:can0"))
    return path
